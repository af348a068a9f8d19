/**
 * The paper's study: five methods on one planned test.
 *
 * Exports  showComparison(element, {query, api, navigate})     query: dataset, job (a past study)
 */

import { createFields } from "../forms/form.js";
import { datasetChoice } from "../forms/planned_test.js";
import { reason } from "../lib/api.js";
import { choiceName } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { scrolledTable } from "../lib/lists.js";
import { needs } from "../lib/me.js";
import { figure, interval, percent } from "../lib/numbers.js";
import { errorLine } from "../lib/view_states.js";
import { methodsFigure } from "./figures.js";
import { figureFiles, pastStudies, showStudyPage } from "./study_page.js";

const TITLE = "Compare five methods";
const ADDRESS = "#/monitors/compare";
const SHOWN = [0.05, 0.1, 0.2, 0.3];

export function showComparison(element, context) {
  return showStudyPage(element, context, {
    title: TITLE,
    guide: "first-monitor#which-method",
    address: ADDRESS,
    loading: "Loading datasets and past comparisons",
    working: "Training and testing monitors of five methods",
    another: "New comparison",
    form,
    result,
  });
}

async function form({ catalog, api, query, navigate }) {
  const [datasets, jobs] = await Promise.all([api.get("/datasets"), api.get("/jobs")]);
  const { schema, default: usual } = catalog.recipes.study;
  const simulated = datasets.filter(({ recipe }) => Object.keys(recipe).length);
  const source = datasetChoice({
    api,
    catalog,
    datasets: simulated,
    chosen: query.get("dataset") ?? simulated[0]?.id,
    asFlown: false,
  });
  const sizes = createFields(schema, usual, { catalog, path: "study", hidden: ["dataset"] });
  const failure = errorLine();
  const go = h("button", { class: "button button-primary", type: "submit", ...needs("POST /studies") }, "Compare");
  const asForm = h(
    "form",
    { class: "form", novalidate: true, onsubmit: send, "aria-label": TITLE, "data-keeps-input": true },
    source.element,
    source.size,
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "2  Size"),
      h("div", { class: "field-grid" }, ["n_monitors", "n_test"].map(sizes.element)),
      sizes.element("monitor"),
    ),
    failure.element,
    h(
      "div",
      { class: "row" },
      go,
      h(
        "span",
        { class: "hint" },
        "All methods use the same failures and the same fresh flights.",
      ),
    ),
  );
  return [asForm, pastComparisons(jobs.filter(({ kind }) => kind === "study"))];

  async function send(event) {
    event.preventDefault();
    if (![source.check(), sizes.check()].every(Boolean)) return;
    go.disabled = true;
    try {
      const job = await api.post("/studies", { ...sizes.read(), dataset: source.read() });
      navigate(`${ADDRESS}?job=${job.id}`);
    } catch (error) {
      if (!source.point(error.message)) sizes.point(error.message);
      failure.show(reason(error));
      go.disabled = false;
    }
  }
}

const pastComparisons = (jobs) =>
  pastStudies(jobs, {
    title: "Past comparisons",
    address: ADDRESS,
    words: ({ n_monitors, n_test }) => `${n_monitors} monitors of each method, ${n_test} flights each`,
    none: ["No comparison yet", "Press Compare to run the first one. It takes about a minute with the numbers above."],
  });

function result(job, catalog) {
  const { result: study, request } = job;
  const { methods, ranking, recipe } = study;
  const { properties } = catalog.recipes.monitor.schema;
  const chosen = (key) => choiceName(properties[key], request.monitor[key]);
  const words =
    `${recipe.n_monitors} monitors of each method, each calibrated on ${recipe.dataset.n_unsafe} failures and tested on ${recipe.n_test} fresh flights; ` +
    `${percent(study.unsafe_rate)} of flights unsafe; warning lead time ${figure(study.lead_s)} s; calibration ${chosen("calibration")}; scaling of the channels ${chosen("scaling")}. The method with most safe flights without a false alarm comes first. The ranking holds for this aircraft and manoeuvre only.`;
  return [
    h("p", {}, words),
    h(
      "div",
      { class: "figures" },
      ["power", "miss"].map((what) =>
        h("section", { class: "panel" }, methodsFigure(methods, ranking, what)),
      ),
    ),
    table(methods, ranking),
    figureFiles(job, "The same figures as files, in the paper's form."),
  ];
}

function table(methods, ranking) {
  const { epsilon } = methods[ranking[0]];
  const columns = [...new Set(SHOWN.map((shown) => nearest(epsilon, shown)))];
  const heads = columns.map((k) => [`missed / no false alarm at ε = ${figure(epsilon[k])}`, true]);
  const rows = ranking.map((name) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, name),
      columns.map((k) => cell(methods[name], k)),
    ),
  );
  return scrolledTable({
    heads: [["Method"], ...heads],
    rows,
    caption:
      "Missed: share of failing flights without a timely alert. No false alarm: share of safe flights without an alert. The 95 % intervals include the scatter between monitors.",
  });
}

function cell(method, k) {
  const [miss, power] = [percent(method.miss_rate[k], 0), percent(method.power[k], 0)];
  return h(
    "td",
    { class: "number" },
    h("strong", {}, `${miss} / ${power}`),
    h("br"),
    h(
      "span",
      { class: "hint" },
      `${interval(method.miss_interval[k], 0)} / ${interval(method.power_interval[k], 0)}`,
    ),
  );
}

function nearest(values, wanted) {
  return values.reduce(
    (best, value, k) => (Math.abs(value - wanted) < Math.abs(values[best] - wanted) ? k : best),
    0,
  );
}
