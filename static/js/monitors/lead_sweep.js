/**
 * Lead-time study: how early each method can warn on a planned test, and at what cost.
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

const TITLE = "Lead-time study";
const ADDRESS = "#/monitors/sweep";
const LISTS = ["tests", "methods", "leads_s", "reactions_s"];
const NUMBERS = ["epsilon", "guarantee", "n_unsafe", "n_monitors", "n_test", "seed"];

export function showSweep(element, context) {
  return showStudyPage(element, context, {
    title: TITLE,
    guide: "method#how-early",
    address: ADDRESS,
    loading: "Loading datasets and past studies",
    working: "Training and testing monitors of each method and lead time",
    another: "New study",
    form,
    result,
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
  const go = h("button", { class: "button button-primary", type: "submit", ...needs("POST /sweeps") }, "Start the study");
  const asForm = h(
    "form",
    { class: "form", novalidate: true, onsubmit: send, onchange: follow, "aria-label": TITLE, "data-keeps-input": true },
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "1  Planned test"),
      h("div", { class: "field" }, h("label", { for: "sweep-source" }, "aircraft and manoeuvre"), source.element),
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
        h("p", { class: "hint" }, "up to twenty, separated by spaces"),
      ),
    ),
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "3  Size"),
      h("div", { class: "field-grid" }, NUMBERS.map(fields.element), fields.element("ceiling")),
    ),
    failure.element,
    h(
      "div",
      { class: "row" },
      go,
      h("span", { class: "hint" }, "Each monitor has its own training failures and takes about 0.1 s."),
    ),
  );
  follow();
  return [asForm, pastSweeps(jobs.filter(({ kind }) => kind === "sweep"))];

  /** A dataset's recipe has its own imperfections. */
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
    if (!asked.methods.length) return failure.show("Choose at least one method.");
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

/** One of the program's planned tests, all of them, or the test of a stored dataset. */
function testChoice(tests, datasets, chosen) {
  const simulated = datasets.filter(({ recipe }) => Object.keys(recipe).length);
  const element = h(
    "select",
    { id: "sweep-source" },
    h("option", { value: "" }, `${tests.join(", ")}: rudder doublets with 1 s halves`),
    tests.map((name) => h("option", { value: name }, `${name}: rudder doublet with 1 s halves`)),
    simulated.length
      ? h(
          "optgroup",
          { label: "planned test of a dataset" },
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

/** words: hint of each name. */
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
    title: "Past studies",
    address: ADDRESS,
    words: ({ tests, methods, leads_s }) =>
      `${tests.join(", ")}; ${methods.length} methods at ${leads_s.map((lead) => figure(lead)).join(", ")} s`,
    none: ["No study yet", "Press Start the study to run the first one. It takes about a minute with the numbers above."],
  });

function result(job) {
  const { recipe, tests, false_alarms_alike: alike } = job.result;
  const words =
    `${recipe.n_monitors} monitors of each method and lead, each calibrated on ${recipe.n_unsafe} failures and tested on ${recipe.n_test} fresh flights; ` +
    `promised miss rate ${figure(recipe.epsilon)} ${recipe.guarantee === "average" ? "on average" : "with 95 % confidence"}.`;
  return [
    h("p", {}, words),
    Object.entries(tests).map(([name, test]) => planned(name, test, recipe, alike)),
    figureFiles(job),
  ];
}

function planned(name, test, recipe, alike) {
  const hopeless = test.hopeless_s.map((lead) => figure(lead)).join(", ");
  return h(
    "section",
    { class: "stack", "data-test": name },
    h("h2", {}, name),
    h(
      "p",
      {},
      `${percent(test.unsafe_share, 0)} of the flights fail; 1 in 20 of these fails within ${figure(test.earliest_s)} s of the first input.`,
    ),
    hopeless
      ? h(
          "p",
          { class: "warning" },
          h("strong", {}, `No method can warn ${hopeless} s ahead: `),
          "almost every safe flight has an alert. Use a shorter lead time, or clear the point before it is flown.",
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
    ["Lead time [s]", true],
    ["Method"],
    ["missed", true],
    ["no false alarm", true],
    [`… at ${percent(recipe.epsilon, 0)} missed`, true],
  ];
  return scrolledTable({
    heads: [...heads, ...reactions],
    rows,
    caption: `Missed: share of failing flights. No false alarm: share of safe flights. By reaction time: share of failures prevented if ${percent(alike, 0)} of the safe flights have an alert; below it, at the promised miss rate.`,
  });
}
