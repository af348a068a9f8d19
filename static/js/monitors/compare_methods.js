/** The paper's study: its five methods and the rules of others on one planned test.   query: dataset, job (a past study) */

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
const OTHERS =
  "Rules of others with the thresholds of their authors, without any promise. Above, each is calibrated on the same failures as the monitors, as it is flown.";

export function showComparison(element, context) {
  return showStudyPage(element, context, {
    title: "Compare methods",
    kind: "study",
    guide: "method#who-else-warns",
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
  const { monitor, ...others } = schema.properties;
  const { predictor, score, ...settings } = monitor.properties; // those are what is compared
  const kept = { ...schema, properties: { ...others, monitor: { ...monitor, properties: settings } } };
  const sizes = createFields(kept, usual, { catalog, path: "study", hidden: ["dataset"] });
  return {
    path: "/studies",
    word: "Compare",
    fields: [source, sizes],
    content: [
      source.element,
      source.size,
      fieldset("2  Size", h("div.field-grid", ["n_monitors", "n_test"].map(sizes.element)), sizes.element("monitor")),
    ],
    beside: "The paper's five methods and four rules of others. All use the same failures and the same fresh flights.",
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
  return [h("p", words), h("div.figures", panels), rates(methods, ranking), ownThresholds(study.others)];
}

function rates(methods, ranking) {
  const { epsilon } = methods[ranking[0]];
  const places = [...new Set(SHOWN.map((shown) => nearest(epsilon, shown)))];
  const titleOf = (k) => `missed / no false alarm at ε = ${figure(epsilon[k])}`;
  const columns = places.map((k) => [titleOf(k), (name) => shares(methods[name], k), "number"]);
  return table({ columns: [["Method", (name) => name, "name"], ...columns], items: ranking, caption: CAPTION });
}

/** k: of an epsilon; without, the shares are single numbers. */
function shares(method, k) {
  const at = (key) => (k === undefined ? method[key] : method[key][k]);
  const hint = `${interval(at("miss_interval"), 0)} / ${interval(at("power_interval"), 0)}`;
  return [h("strong", `${percent(at("miss_rate"), 0)} / ${percent(at("power"), 0)}`), h("br"), h("span.hint", hint)];
}

/** others: by name; absent in a study of an earlier version. */
function ownThresholds(others) {
  const columns = [
    ["Rule", ([name]) => name, "name"],
    ["assumes that", ([, { assumption }]) => assumption],
    ["missed / no false alarm", ([, own]) => shares(own), "number"],
  ];
  return others && table({ columns, items: Object.entries(others), caption: OTHERS });
}

function nearest(values, wanted) {
  const distances = values.map((value) => Math.abs(value - wanted));
  return distances.indexOf(Math.min(...distances));
}
