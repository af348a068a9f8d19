/** The paper's study: five methods on one planned test.   query: dataset, job (a past study) */

import { fieldset } from "../forms/controls.js";
import { createFields } from "../forms/form.js";
import { datasetChoice } from "../forms/planned_test.js";
import { choiceName } from "../lib/catalog.js";
import { h, table } from "../lib/dom.js";
import { figure, interval, percent } from "../lib/numbers.js";
import { methodsFigure } from "./figures.js";
import { showStudyPage } from "./study_page.js";

const SHOWN = [0.05, 0.1, 0.2, 0.3];
const CAPTION =
  "Missed: share of failing flights without a timely alert. No false alarm: share of safe flights without an alert. The 95 % intervals include the scatter between monitors.";

export function showComparison(element, context) {
  return showStudyPage(element, context, {
    title: "Compare five methods",
    kind: "study",
    guide: "first-monitor#which-method",
    address: "#/monitors/compare",
    hint: "The same figures as files, in the paper's form.",
    requestWords: ({ n_monitors, n_test }) => `${n_monitors} monitors of each method, ${n_test} flights each`,
    form,
    result,
  });
}

function form({ catalog, api, datasets, chosen }) {
  const { schema, default: usual } = catalog.recipes.study;
  const source = datasetChoice({ api, catalog, datasets, chosen: chosen ?? datasets[0]?.id, asFlown: false });
  const sizes = createFields(schema, usual, { catalog, path: "study", hidden: ["dataset"] });
  return {
    path: "/studies",
    word: "Compare",
    fields: [source, sizes],
    content: [
      source.element,
      source.size,
      fieldset("2  Size", h("div.field-grid", ["n_monitors", "n_test"].map(sizes.element)), sizes.element("monitor")),
    ],
    beside: "All methods use the same failures and the same fresh flights.",
    read: () => ({ ...sizes.read(), dataset: source.read() }),
  };
}

function result({ result: study, request }, catalog) {
  const { methods, ranking, recipe } = study;
  const { properties } = catalog.recipes.monitor.schema;
  const chosen = (key) => choiceName(properties[key], request.monitor[key]);
  const words =
    `${recipe.n_monitors} monitors of each method, each calibrated on ${recipe.dataset.n_unsafe} failures and tested on ${recipe.n_test} fresh flights; ` +
    `${percent(study.unsafe_rate)} of flights unsafe; warning lead time ${figure(study.lead_s)} s; calibration ${chosen("calibration")}; scaling of the channels ${chosen("scaling")}. ` +
    "The method with most safe flights without a false alarm comes first. The ranking holds for this aircraft and manoeuvre only.";
  const panels = ["power", "miss"].map((what) => h("section.panel", methodsFigure(methods, ranking, what)));
  return [h("p", words), h("div.figures", panels), rates(methods, ranking)];
}

function rates(methods, ranking) {
  const { epsilon } = methods[ranking[0]];
  const places = [...new Set(SHOWN.map((shown) => nearest(epsilon, shown)))];
  const titleOf = (k) => `missed / no false alarm at ε = ${figure(epsilon[k])}`;
  const columns = places.map((k) => [titleOf(k), (name) => shares(methods[name], k), "number"]);
  return table({ columns: [["Method", (name) => name, "name"], ...columns], items: ranking, caption: CAPTION });
}

function shares(method, k) {
  const hint = `${interval(method.miss_interval[k], 0)} / ${interval(method.power_interval[k], 0)}`;
  return [h("strong", `${percent(method.miss_rate[k], 0)} / ${percent(method.power[k], 0)}`), h("br"), h("span.hint", hint)];
}

function nearest(values, wanted) {
  const distances = values.map((value) => Math.abs(value - wanted));
  return distances.indexOf(Math.min(...distances));
}
