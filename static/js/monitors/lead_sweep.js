/**
 * How early a planned test can be warned of, by which method, at what cost: a sweep over leads, as a job.
 *
 * Exports  showSweep(element, {query, api, navigate})     query: dataset, job (a past sweep)
 */

import { decimals } from "../forms/decimals.js";
import { createFields } from "../forms/form.js";
import { reason } from "../lib/api.js";
import { loadCatalog } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { createJobProgress } from "../lib/job_progress.js";
import { tableHead } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { figure, interval, moment, percent } from "../lib/numbers.js";
import { empty, errorLine, link, pageOf } from "../lib/view_states.js";
import { leadsFigure } from "./figures.js";

const TITLE = "How early can it warn";
const LISTS = ["tests", "methods", "leads_s", "reactions_s"];
const NUMBERS = ["epsilon", "guarantee", "n_unsafe", "n_monitors", "n_test", "seed"];

export function showSweep(element, { query, api, navigate }) {
  return loadingView(element, { title: TITLE, text: "Looking up datasets and past sweeps", build });

  async function build({ keep, again }) {
    const catalog = await loadCatalog(api);
    const id = query.get("job");
    if (!id) return pageOf(TITLE, [], await form({ catalog, api, query, navigate }));
    const job = await api.get(`/jobs/${id}`);
    const actions = [link("Another sweep", "#/monitors/sweep")];
    if (job.status === "done") return pageOf(TITLE, actions, found(job));
    const progress = createJobProgress({
      api,
      job,
      title: "Training and flying monitors of every method and lead",
      done: again,
      back: () => navigate("#/monitors/sweep"),
    });
    return pageOf(TITLE, actions, keep(progress).element);
  }
}

async function form({ catalog, api, query, navigate }) {
  const [datasets, jobs] = await Promise.all([api.get("/datasets"), api.get("/jobs")]);
  const { schema, default: usual } = catalog.recipes.sweep;
  const fields = createFields(schema, usual, { catalog, path: "sweep", hidden: LISTS });
  const source = testChoice(usual.tests, datasets, query.get("dataset"));
  const methods = checkboxes("Methods", usual.methods);
  const leads = h("input", { type: "text", inputmode: "decimal", id: "sweep-leads", value: usual.leads_s.join(" ") });
  const failure = errorLine();
  const go = h("button", { class: "button button-primary", type: "submit", ...needs("POST /sweeps") }, "Sweep");
  const asForm = h(
    "form",
    { class: "form", novalidate: true, onsubmit: send, onchange: follow, "aria-label": TITLE, "data-keeps-input": true },
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "1  Planned test"),
      h("div", { class: "field" }, h("label", { for: "sweep-source" }, "of which aircraft and manoeuvre"), source.element),
      h("div", { class: "field-grid" }, fields.element("imperfections")),
    ),
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "2  Methods and warning lead times"),
      methods.element,
      h(
        "div",
        { class: "field" },
        h("label", { for: "sweep-leads" }, "warning lead times ", h("span", { class: "unit" }, "[s]")),
        leads,
        h("p", { class: "hint" }, "up to twenty, with spaces between them"),
      ),
    ),
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "3  How much"),
      h("div", { class: "field-grid" }, NUMBERS.map(fields.element), fields.element("ceiling")),
    ),
    failure.element,
    h(
      "div",
      { class: "row" },
      go,
      h("span", { class: "hint" }, "Each monitor is trained on failures of its own; a monitor takes about a tenth of a second."),
    ),
  );
  follow();
  return [asForm, past(jobs.filter(({ kind }) => kind === "sweep"))];

  /** A dataset's own recipe says which imperfections its flights have. */
  function follow() {
    fields.element("imperfections").hidden = source.isDataset();
  }

  async function send(event) {
    event.preventDefault();
    if (!fields.check()) return;
    const { tests, imperfections, ...rest } = fields.read();
    const asked = { ...rest, methods: methods.read(), leads_s: decimals(leads.value).map(Number) };
    if (!asked.methods.length) return failure.show("Choose one method at least.");
    go.disabled = true;
    try {
      const job = await api.post("/sweeps", {
        ...asked,
        ...(source.isDataset() ? { dataset: source.dataset() } : { tests: source.tests() ?? tests, imperfections }),
      });
      navigate(`#/monitors/sweep?job=${job.id}`);
    } catch (error) {
      fields.point(error.message);
      failure.show(reason(error));
      go.disabled = false;
    }
  }
}

/** One of the program's planned tests, all of them, or that of a stored dataset. */
function testChoice(tests, datasets, chosen) {
  const simulated = datasets.filter(({ recipe }) => Object.keys(recipe).length);
  const element = h(
    "select",
    { id: "sweep-source" },
    h("option", { value: "" }, `${tests.join(", ")}: rudder doublets of 1 s halves`),
    tests.map((name) => h("option", { value: `test:${name}` }, `${name}: rudder doublet of 1 s halves`)),
    simulated.length
      ? h(
          "optgroup",
          { label: "the planned test of a dataset" },
          simulated.map(({ id, name }) => h("option", { value: `dataset:${id}` }, name)),
        )
      : null,
  );
  if (simulated.some(({ id }) => id === chosen)) element.value = `dataset:${chosen}`;
  const after = (kind) => (element.value.startsWith(kind) ? element.value.slice(kind.length) : null);
  return {
    element,
    isDataset: () => after("dataset:") !== null,
    dataset: () => after("dataset:"),
    tests: () => (after("test:") === null ? null : [after("test:")]),
  };
}

function checkboxes(legend, names) {
  const boxes = names.map((name) => h("input", { type: "checkbox", value: name, checked: true }));
  const element = h(
    "fieldset",
    { class: "stack-tight" },
    h("legend", {}, legend),
    h(
      "div",
      { class: "row" },
      boxes.map((box) => h("label", { class: "row" }, box, box.value)),
    ),
  );
  return { element, read: () => boxes.filter(({ checked }) => checked).map(({ value }) => value) };
}

function past(jobs) {
  const rows = jobs.map(({ id, status, created, request }) =>
    h(
      "li",
      {},
      h("a", { href: `#/monitors/sweep?job=${id}` }, moment(created)),
      ` ${status}, ${request.tests.join(", ")}; ${request.methods.length} methods at ${request.leads_s.map((lead) => figure(lead)).join(", ")} s`,
    ),
  );
  const content = rows.length
    ? h("ul", {}, rows)
    : empty("No sweep yet", "The first one takes about a minute with the numbers as they are.");
  return h("section", { class: "panel stack" }, h("h2", { class: "panel-title" }, "Past sweeps"), content);
}

function found({ result, id }) {
  const { recipe, tests } = result;
  const words =
    `${recipe.n_monitors} monitors of each method and lead, each calibrated on ${recipe.n_unsafe} failures and flown on ${recipe.n_test} fresh flights; ` +
    `promised miss rate ${figure(recipe.epsilon)} ${recipe.guarantee === "average" ? "on average" : "with 95 % confidence"}.`;
  const files = Object.entries(result.figures).map(([name, address]) =>
    h("li", {}, h("a", { href: address, download: name }, name)),
  );
  return [
    h("p", {}, words),
    Object.entries(tests).map(([name, test]) => planned(name, test, recipe, result.false_alarms_alike)),
    h(
      "section",
      { class: "panel" },
      h("h2", { class: "panel-title" }, "For a report"),
      h("ul", { "data-job": id }, files),
    ),
  ];
}

/** What was found on one planned test. */
function planned(name, test, recipe, alike) {
  const hopeless = test.hopeless_s.map((lead) => figure(lead)).join(", ");
  return h(
    "section",
    { class: "stack", "data-test": name },
    h("h2", {}, name),
    h(
      "p",
      {},
      `${percent(test.unsafe_share, 0)} of the flights fail, one in 20 of these within ${figure(test.earliest_s)} s of the first input.`,
    ),
    hopeless
      ? h(
          "p",
          { class: "warning" },
          h("strong", {}, `${hopeless} s ahead no method has power left: `),
          "hardly a safe flight passes without an alert. Ask for a shorter lead, or clear the point before it is flown.",
        )
      : null,
    h(
      "div",
      { class: "figures" },
      ["power_at_epsilon", "prevented_alike"].map((what) =>
        h("section", { class: "panel" }, leadsFigure(test, recipe, what, alike)),
      ),
    ),
    table(test, recipe, alike),
  );
}

function table({ cells }, recipe, alike) {
  const reactions = recipe.reactions_s.map((time) => [`${figure(time)} s`, true]);
  const rows = cells.map((cell) =>
    h(
      "tr",
      {},
      h("td", { class: "number" }, figure(cell.lead)),
      h("th", { scope: "row" }, cell.method),
      h("td", { class: "number" }, percent(cell.miss_rate), h("br"), h("span", { class: "hint" }, interval(cell.miss_interval))),
      h("td", { class: "number" }, percent(cell.power), h("br"), h("span", { class: "hint" }, interval(cell.power_interval))),
      h("td", { class: "number" }, percent(cell.power_at_epsilon)),
      cell.prevented_alike.map((share, k) =>
        h("td", { class: "number" }, percent(share, 0), h("br"), h("span", { class: "hint" }, percent(cell.prevented[k], 0))),
      ),
    ),
  );
  const heads = [["Lead [s]", true], ["Method"], ["missed", true], ["no false alarm", true], [`… where just ${figure(recipe.epsilon)} is missed`, true]];
  return h(
    "div",
    { class: "table-scroll panel" },
    h(
      "table",
      { class: "table" },
      h(
        "caption",
        { class: "hint" },
        `Missed: of failing flights. No false alarm: of safe flights (power). By reaction time: share of the failures that the alert prevents where just ${percent(alike, 0)} of the safe flights have one, and below it at the promised miss rate.`,
      ),
      tableHead([...heads, ...reactions]),
      h("tbody", {}, rows),
    ),
  );
}
