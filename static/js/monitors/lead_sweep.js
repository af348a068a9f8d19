/**
 * How early a planned test can be warned of, by which method, at what cost: a sweep over leads, as a job.
 *
 * Exports  showSweep(element, {query, api, navigate})     query: dataset, job (a past sweep)
 */

import { decimals } from "../forms/decimals.js";
import { createFields } from "../forms/form.js";
import { reason } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { scrolledTable } from "../lib/lists.js";
import { needs } from "../lib/me.js";
import { figure, interval, moment, percent } from "../lib/numbers.js";
import { errorLine } from "../lib/view_states.js";
import { leadsFigure } from "./figures.js";
import { figureFiles, pastStudies, showStudyPage } from "./study_page.js";

const TITLE = "How early can it warn";
const ADDRESS = "#/monitors/sweep";
const LISTS = ["tests", "methods", "leads_s", "reactions_s"];
const NUMBERS = ["epsilon", "guarantee", "n_unsafe", "n_monitors", "n_test", "seed"];

export function showSweep(element, context) {
  return showStudyPage(element, context, {
    title: TITLE,
    address: ADDRESS,
    loading: "Looking up datasets and past sweeps",
    working: "Training and flying monitors of every method and lead",
    another: "Another sweep",
    form,
    found,
  });
}

async function form({ catalog, api, query, navigate }) {
  const [datasets, jobs] = await Promise.all([api.get("/datasets"), api.get("/jobs")]);
  const { schema, default: usual } = catalog.recipes.sweep;
  const fields = createFields(schema, usual, { catalog, path: "sweep", hidden: LISTS });
  const source = testChoice(usual.tests, datasets, query.get("dataset"));
  const methods = checkboxes("Methods", usual.methods, catalog.sweep_methods);
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
  return [asForm, pastSweeps(jobs.filter(({ kind }) => kind === "sweep"))];

  /** A dataset's own recipe says which imperfections its flights have. */
  function follow() {
    fields.element("imperfections").hidden = source.isDataset();
  }

  async function send(event) {
    event.preventDefault();
    if (!fields.check()) return;
    const { tests, imperfections, ...rest } = fields.read();
    const asked = {
      ...rest,
      ...source.read({ tests, imperfections }),
      methods: methods.read(),
      leads_s: decimals(leads.value).map(Number),
    };
    if (!asked.methods.length) return failure.show("Choose one method at least.");
    go.disabled = true;
    try {
      const job = await api.post("/sweeps", asked);
      navigate(`${ADDRESS}?job=${job.id}`);
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
    tests.map((name) => h("option", { value: name }, `${name}: rudder doublet of 1 s halves`)),
    simulated.length
      ? h(
          "optgroup",
          { label: "the planned test of a dataset" },
          simulated.map(({ id, name, created }) => h("option", { value: id }, `${name} (${moment(created)})`)),
        )
      : null,
  );
  const isDataset = () => simulated.some(({ id }) => id === element.value);
  if (simulated.some(({ id }) => id === chosen)) element.value = chosen;
  return {
    element,
    isDataset,
    read: (planned) =>
      isDataset() ? { dataset: element.value } : { ...planned, ...(element.value && { tests: [element.value] }) },
  };
}

/** words: of each name, as the form for a monitor has them. */
function checkboxes(legend, names, words) {
  const boxes = names.map((name) => h("input", { type: "checkbox", value: name, checked: true }));
  const element = h(
    "fieldset",
    { class: "stack-tight" },
    h("legend", {}, legend),
    boxes.map((box, k) => {
      const hint = h("span", { class: "hint", id: `method-words-${k}` }, words[box.value]);
      box.setAttribute("aria-describedby", hint.id);
      return h("div", { class: "row" }, h("label", { class: "row" }, box, box.value), hint);
    }),
  );
  return { element, read: () => boxes.filter(({ checked }) => checked).map(({ value }) => value) };
}

const pastSweeps = (jobs) =>
  pastStudies(jobs, {
    title: "Past sweeps",
    address: ADDRESS,
    words: ({ tests, methods, leads_s }) =>
      `${tests.join(", ")}; ${methods.length} methods at ${leads_s.map((lead) => figure(lead)).join(", ")} s`,
    none: ["No sweep yet", "The first one takes about a minute with the numbers as they are."],
  });

function found(job) {
  const { recipe, tests, false_alarms_alike: alike } = job.result;
  const words =
    `${recipe.n_monitors} monitors of each method and lead, each calibrated on ${recipe.n_unsafe} failures and flown on ${recipe.n_test} fresh flights; ` +
    `promised miss rate ${figure(recipe.epsilon)} ${recipe.guarantee === "average" ? "on average" : "with 95 % confidence"}.`;
  return [
    h("p", {}, words),
    Object.entries(tests).map(([name, test]) => planned(name, test, recipe, alike)),
    figureFiles(job),
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
  const heads = [
    ["Lead [s]", true],
    ["Method"],
    ["missed", true],
    ["no false alarm", true],
    [`… where just ${figure(recipe.epsilon)} is missed`, true],
  ];
  return scrolledTable({
    heads: [...heads, ...reactions],
    rows,
    caption: `Missed: of failing flights. No false alarm: of safe flights (power). By reaction time: share of the failures that the alert prevents where just ${percent(alike, 0)} of the safe flights have one, and below it at the promised miss rate.`,
  });
}
