/** Lead-time study: how early each method can warn on a planned test, and at what cost.   query: dataset, job (a past sweep) */

import { checkbox, createForm, fieldset, foldedPanel, group, labelled, select, sharedField, textInput } from "../forms/controls.js";
import { createFields } from "../forms/form.js";
import { isSimulated, loadCatalog } from "../lib/catalog.js";
import { empty, guideLink, h, link, loadingView, pageOf, panel, table } from "../lib/dom.js";
import { createJobProgress } from "../lib/job_progress.js";
import { decimals, figure, interval, moment, percent } from "../lib/numbers.js";
import { leadsFigure } from "./figures.js";

const TITLE = "Lead-time study";
const ADDRESS = "#/monitors/sweep";
const LISTS = ["tests", "methods", "leads_s", "reactions_s"];
const NUMBERS = ["epsilon", "guarantee", "n_unsafe", "n_monitors", "n_test", "seed", "ceiling"];

export function showSweep(element, { query, api, navigate }) {
  return loadingView(element, { title: TITLE, text: "Loading past studies", loads: [loadCatalog], build });

  async function build({ keep, again }, catalog) {
    const help = guideLink("method#how-early", TITLE);
    const id = query.get("job");
    if (!id) return pageOf(TITLE, [help], await begin(catalog));
    const job = await api.get(`/jobs/${id}`);
    const actions = [link("New study", ADDRESS), help];
    if (job.status === "done") return pageOf(TITLE, actions, result(job.result), figureFiles(job));
    const progress = createJobProgress({ api, job, title: "Training and testing the monitors", done: again, back: () => navigate(ADDRESS) });
    return pageOf(TITLE, actions, keep(progress).element);
  }

  async function begin(catalog) {
    const [datasets, jobs] = await Promise.all([api.get("/datasets"), api.get("/jobs?kind=sweep")]);
    return [formOf({ catalog, datasets: datasets.filter(isSimulated), chosen: query.get("dataset"), send }), pastStudies(jobs)];
  }

  async function send(request) {
    const job = await api.post("/sweeps", request);
    navigate(`${ADDRESS}?job=${job.id}`);
  }
}

function pastStudies(jobs) {
  const words = ({ tests, methods, leads_s: leads }) => `${tests.join(", ")}; ${methods.length} methods at ${leads.map((lead) => figure(lead)).join(", ")} s`;
  const rows = jobs.map(({ id, status, created, request }) => h("li", h("a", { href: `${ADDRESS}?job=${id}` }, moment(created)), ` ${status}, ${words(request)}`));
  const none = empty("No study yet", "The first one takes about a minute with the numbers above.");
  return panel("Past studies", rows.length ? h("ul", rows) : none);
}

function figureFiles({ id, result }) {
  const files = Object.entries(result.figures).map(([name, address]) => h("li", h("a", { href: address, download: name }, name)));
  return panel("For a report", h("ul", { "data-job": id }, files));
}

function formOf({ catalog, datasets, chosen, send }) {
  const { schema, default: usual } = catalog.recipes.sweep;
  const fields = createFields(schema, usual, { catalog, path: "sweep", hidden: LISTS });
  const source = testChoice(usual.tests, datasets, chosen);
  const isDataset = () => datasets.some(({ id }) => id === source.value);
  const boxes = Object.keys(catalog.sweep_methods).map((name) =>
    checkbox({ value: name, checked: usual.methods.includes(name) }),
  );
  const asked = () => boxes.filter(({ checked }) => checked).map(({ value }) => value);
  const leads = textInput({ inputmode: "decimal", id: "sweep-leads", value: usual.leads_s.join(" ") });
  const leadField = labelled("warning lead times", leads, { unit: "s", hint: "up to twenty, separated by spaces" });
  const methods = methodChoice(boxes, catalog.sweep_methods);
  const checks = () => [[methods, asked().length ? "" : "Choose at least one method."]];
  source.addEventListener("change", follow);
  follow();
  return createForm({
    title: TITLE,
    word: "Start the study",
    route: "POST /sweeps",
    fields: [fields, group({ "sweep.leads_s": leadField, "sweep.methods": methods }, checks)],
    content: [
      fieldset(
        "1  Planned test",
        labelled("aircraft and manoeuvre", source).element,
        h("div.field-grid", fields.element("imperfections")),
      ),
      fieldset("2  Methods and warning lead times", methods.element, leadField.element),
      fieldset("3  Size", h("div.field-grid", NUMBERS.map(fields.element))),
    ],
    beside: h("span.hint", "Each monitor has its own training failures and takes about 0.1 s."),
    send: () => send(read()),
  }).element;

  /** A dataset's recipe has its own imperfections. */
  function follow() {
    fields.element("imperfections").hidden = isDataset();
  }

  function read() {
    const { tests, imperfections, ...rest } = fields.read();
    const planned = { tests: source.value ? [source.value] : tests, imperfections };
    return {
      ...rest,
      ...(isDataset() ? { dataset: source.value } : planned),
      methods: asked(),
      leads_s: decimals(leads.value).map(Number),
    };
  }
}

/** One of the program's planned tests, all of them, or the test of a stored dataset. */
function testChoice(tests, datasets, chosen) {
  const stored = datasets.map(({ id, name, created }) => h("option", { value: id }, `${name} (${moment(created)})`));
  return select(
    [
      ["", `${tests.join(", ")}: rudder doublets with 1 s halves`],
      ...tests.map((name) => [name, `${name}: rudder doublet with 1 s halves`]),
      stored.length && h("optgroup", { label: "planned test of a dataset" }, stored),
    ],
    { id: "sweep-source", value: chosen },
  );
}

function methodChoice(boxes, words) {
  const rows = boxes.map((box, k) => {
    const hint = h("span.hint", { id: `method-words-${k}` }, words[box.value]);
    box.setAttribute("aria-describedby", hint.id);
    return h("div.row", h("label.row", box, box.value), hint);
  });
  return sharedField("fieldset.stack-tight", boxes[0], [h("legend", "Methods"), rows], { words: "methods" });
}

function result({ recipe, tests, false_alarms_alike: alike }) {
  const words =
    `${recipe.n_monitors} monitors of each method and warning lead time, each calibrated on ${recipe.n_unsafe} failures and tested on ${recipe.n_test} fresh flights; ` +
    `promised miss rate ${figure(recipe.epsilon)} ${recipe.guarantee === "average" ? "on average" : "with 95 % confidence"}.`;
  return [h("p", words), Object.entries(tests).map(([name, test]) => planned(name, test, recipe, alike))];
}

function planned(name, test, recipe, alike) {
  const hopeless = test.hopeless_s.map((lead) => figure(lead)).join(", ");
  const figures = ["power_at_epsilon", "prevented_alike"].map((what) =>
    h("section.panel", leadsFigure(test, recipe, what, alike)),
  );
  return h(
    "section.stack",
    { "data-test": name },
    h("h2", name),
    h("p", `${percent(test.unsafe_share, 0)} of the flights fail; 1 in 20 of these fails within ${figure(test.earliest_s)} s of the first input.`),
    hopeless &&
      h(
        "p.warning",
        h("strong", `No method can warn ${hopeless} s ahead: `),
        "almost every safe flight has an alert. Use a shorter warning lead time, or clear the point before it is flown.",
      ),
    h("div.figures", figures),
    foldedPanel("All figures, by lead time and method", rates(test, recipe, alike)),
  );
}

function rates({ cells }, recipe, alike) {
  const above = (share, below) => [share, h("br"), h("span.hint", below)];
  const reactions = recipe.reactions_s.map((time, k) => [
    `${figure(time)} s`,
    (cell) => above(percent(cell.prevented_alike[k], 0), percent(cell.prevented[k], 0)),
    "number",
  ]);
  const columns = [
    ["Warning lead time [s]", (cell) => figure(cell.lead), "number"],
    ["Method", ({ method }) => method, "name"],
    ["missed", (cell) => above(percent(cell.miss_rate), interval(cell.miss_interval)), "number"],
    ["no false alarm", (cell) => above(percent(cell.power), interval(cell.power_interval)), "number"],
    [`… at ${percent(recipe.epsilon, 0)} missed`, (cell) => percent(cell.power_at_epsilon), "number"],
    ...reactions,
  ];
  const caption = `Missed: share of failing flights. No false alarm: share of safe flights. By reaction time: share of failures prevented if ${percent(alike, 0)} of the safe flights have an alert; below it, at the promised miss rate.`;
  return table({ columns, items: cells, caption, panel: false });
}
