/**
 * The paper's study: five methods on one planned test, as a job with its figures.
 *
 * Exports  showComparison(element, {query, api, navigate})     query: dataset, job (a past study)
 */

import { createFields } from "../forms/form.js";
import { datasetChoice } from "../forms/planned_test.js";
import { reason } from "../lib/api.js";
import { choiceName, loadCatalog } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { createJobProgress } from "../lib/job_progress.js";
import { tableHead } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { figure, interval, moment, percent } from "../lib/numbers.js";
import { empty, errorLine, link, pageOf } from "../lib/view_states.js";
import { methodsFigure } from "./figures.js";

const TITLE = "Compare five methods";
const SHOWN = [0.05, 0.1, 0.2, 0.3];

export function showComparison(element, { query, api, navigate }) {
  return loadingView(element, {
    title: TITLE,
    text: "Looking up datasets and past comparisons",
    build,
  });

  async function build({ keep, again }) {
    const catalog = await loadCatalog(api);
    const id = query.get("job");
    if (!id) return pageOf(TITLE, [], await form({ catalog, api, query, navigate }));
    const job = await api.get(`/jobs/${id}`);
    const actions = [link("Another comparison", "#/monitors/compare")];
    if (job.status === "done") return pageOf(TITLE, actions, study(job, catalog));
    return pageOf(
      TITLE,
      actions,
      keep(
        createJobProgress({
          api,
          job,
          title: "Training and flying monitors of five methods",
          done: again,
          back: () => navigate("#/monitors/compare"),
        }),
      ).element,
    );
  }
}

async function form({ catalog, api, query, navigate }) {
  const [datasets, jobs] = await Promise.all([api.get("/datasets"), api.get("/jobs")]);
  const { schema, default: usual } = catalog.recipes.study;
  const source = datasetChoice({
    api,
    catalog,
    datasets: datasets.filter(({ recipe }) => Object.keys(recipe).length),
    chosen: query.get("dataset") ?? datasets[0]?.id,
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
      h("legend", {}, "2  How much"),
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
        "Each method trains the same number of monitors on the same failures and flies the same fresh flights.",
      ),
    ),
  );
  return [asForm, past(jobs.filter(({ kind }) => kind === "study"))];

  async function send(event) {
    event.preventDefault();
    if (![source.check(), sizes.check()].every(Boolean)) return;
    go.disabled = true;
    try {
      const job = await api.post("/studies", { ...sizes.read(), dataset: source.read() });
      navigate(`#/monitors/compare?job=${job.id}`);
    } catch (error) {
      if (!source.point(error.message)) sizes.point(error.message);
      failure.show(reason(error));
      go.disabled = false;
    }
  }
}

function past(jobs) {
  const rows = jobs.map(({ id, status, created, request }) =>
    h(
      "li",
      {},
      h("a", { href: `#/monitors/compare?job=${id}` }, moment(created)),
      ` ${status}, ${request.n_monitors} monitors of each method, ${request.n_test} flights each`,
    ),
  );
  const content = rows.length
    ? h("ul", {}, rows)
    : empty(
        "No comparison yet",
        "The first one takes about a minute with the numbers as they are.",
      );
  return h(
    "section",
    { class: "panel stack" },
    h("h2", { class: "panel-title" }, "Past comparisons"),
    content,
  );
}

function study({ result, request, id }, catalog) {
  const { methods, ranking, recipe } = result;
  const { properties } = catalog.recipes.monitor.schema;
  const chosen = (key) => choiceName(properties[key], request.monitor[key]);
  const words =
    `${recipe.n_monitors} monitors of each method, each calibrated on ${recipe.dataset.n_unsafe} failures and flown on ${recipe.n_test} fresh flights; ` +
    `${percent(result.unsafe_rate)} of flights unsafe; warning lead time ${figure(result.lead_s)} s; calibration ${chosen("calibration")}; scaling of the channels ${chosen("scaling")}. Largest mean share of safe flights without a false alarm (power) first. The ranking belongs to this aircraft and manoeuvre.`;
  const files = Object.entries(result.figures).map(([name, address]) =>
    h("li", {}, h("a", { href: address, download: name }, name)),
  );
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
    h(
      "section",
      { class: "panel" },
      h("h2", { class: "panel-title" }, "For a report"),
      h("p", { class: "hint" }, "The same figures as files, in the paper's form."),
      h("ul", { "data-job": id }, files),
    ),
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
  return h(
    "div",
    { class: "table-scroll panel" },
    h(
      "table",
      { class: "table" },
      h(
        "caption",
        { class: "hint" },
        "Missed: share of failing flights without a timely alert. No false alarm: share of safe flights without an alert (power). Each with its 95 % interval, which allows for the scatter between monitors.",
      ),
      tableHead([["Method"], ...heads]),
      h("tbody", {}, rows),
    ),
  );
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
