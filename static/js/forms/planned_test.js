/**
 * The planned test of a form: a stored dataset, or the recipe of one to simulate.
 *
 * Exports
 *   createTestFields({api, catalog, initial, asFlown}) -> {fields, main, folded, size}   parts of a dataset's recipe
 *   datasetChoice({api, catalog, datasets, chosen, initial, asFlown}) -> Choice
 *     chosen: id of the stored dataset to begin with
 *     initial: a recipe to begin with; else the default with noise, jitter, imperfections of a real
 *     flight and the usual number of failures, unless asFlown is false
 *   scatterOf(recipes, name) -> {key: value}     the pilot's scatter of a recipe; name: "default" | "as_flown"
 *
 * Choice   element, size (the editor of n_unsafe), read() -> id | recipe, check(), point(message),
 *          failures() -> number of unsafe rollouts | null
 */

import { reason } from "../lib/api.js";
import { aircraftName, kindName, limitWords } from "../lib/catalog.js";
import { formatted, h } from "../lib/dom.js";
import { needs } from "../lib/me.js";
import { figure, moment, percent } from "../lib/numbers.js";
import { followUnits } from "../lib/units.js";
import { button, errorLine } from "../lib/view_states.js";
import { createFields } from "./form.js";

const SIZE = "n_unsafe";
/** Set by the monitor where the test is simulated for one; a field only on the Datasets page. */
const GROUPS = "groups";

export function createTestFields({ api, catalog, initial, asFlown = true }) {
  const { schema, default: clean, usual } = catalog.recipes.dataset;
  const fields = createFields(
    schema,
    { ...(asFlown && !initial ? usual : clean), ...initial },
    { catalog, path: "dataset", unfolded: ["limits"] },
  );
  const properties = schema.properties;
  const families = fields.keys.filter((key) => key !== GROUPS && properties[key]["x-family"]);
  const rest = fields.keys.filter(
    (key) => ![...families, SIZE, GROUPS, "limits"].includes(key),
  );
  const objects = rest.filter((key) => properties[key].properties);
  const size = fields.element(SIZE);
  if (!properties[SIZE].description)
    size.append(
      h(
        "p",
        { class: "hint" },
        "Failures to simulate for calibration; more failures allow a smaller epsilon and less scatter",
      ),
    );
  const main = h(
    "div",
    { class: "columns test-columns" },
    families.map(fields.element),
    fields.element("limits"),
  );
  const folded = h(
    "details",
    { class: "fold" },
    h("summary", {}, "Sampling, noise, imperfections, seed, budget"),
    h(
      "div",
      { class: "field-grid" },
      rest.filter((key) => !objects.includes(key)).map(fields.element),
    ),
    imperfectionsChoice(fields, catalog.recipes.dataset),
    objects.map(fields.element),
  );
  beginWithUsualTest(fields, main, catalog);
  main.append(amplitudeSuggestion(fields, api));
  return { fields, main, folded, size };
}

/** A new aircraft brings its control law, manoeuvre and limits, except those changed by hand. */
function beginWithUsualTest(fields, element, catalog) {
  const byHand = new Set();
  element.addEventListener("change", ({ target, isTrusted }) => {
    const part = target.name?.split(".")[1];
    if (part !== "aircraft" && isTrusted) byHand.add(part);
    if (target.name !== "dataset.aircraft.kind") return;
    const usual = catalog.families.aircraft.entries[target.value].usual_test;
    const { maneuver } = fields.read();
    const scatter = Object.keys(scatterOf(catalog.recipes.dataset, "as_flown"));
    const flown = Object.fromEntries(scatter.map((key) => [key, maneuver[key]]));
    const begun = { ...usual, maneuver: { ...usual.maneuver, ...flown } };
    for (const [key, value] of Object.entries(begun)) if (!byHand.has(key)) fields.put(key, value);
  });
}

/** The pilot's scatter: parameters of a manoeuvre that differ between a flown and a clean recipe. */
export function scatterOf(recipes, name) {
  const clean = recipes.default.maneuver;
  const differing = Object.keys(clean).filter((key) => recipes.as_flown.maneuver[key] !== clean[key]);
  return Object.fromEntries(differing.map((key) => [key, recipes[name].maneuver[key]]));
}

/** Two buttons: noise, jitter and imperfections of a real flight, or none. */
function imperfectionsChoice(fields, recipes) {
  const ways = [
    ["As in a real flight", "as_flown"],
    ["None", "default"],
  ];
  const buttons = ways.map(([text, name]) =>
    button(text, () => put(name), { class: "button button-small" }),
  );
  const words = h("span", { class: "hint" }, "Noise, jitter and imperfections");
  return h("div", { class: "row" }, words, buttons);

  function put(name) {
    fields.put("maneuver", { ...fields.read().maneuver, ...scatterOf(recipes, name) });
    for (const key of Object.keys(recipes.default))
      if (key !== "maneuver" && !same(recipes.default[key], recipes.as_flown[key]))
        fields.put(key, recipes[name][key]);
  }
}

function same(a, b) {
  return JSON.stringify(a) === JSON.stringify(b);
}

/** A button that fills in the amplitude at which a quarter of the rollouts exceed a limit. */
function amplitudeSuggestion(fields, api) {
  const words = h("span", { class: "hint", role: "status" });
  const failure = errorLine();
  const go = button("Suggest amplitude", suggest, { class: "button button-small", ...needs("POST /datasets/amplitude") });
  return h("div", { class: "field suggestion" }, h("div", { class: "row" }, go, words), failure.element);

  async function suggest() {
    failure.show("");
    if (!fields.check()) return;
    go.disabled = true;
    words.textContent = "Flying a pilot run…";
    try {
      const suggestion = await api.post("/datasets/amplitude", fields.read());
      fields.put("maneuver", suggestion.maneuver);
      words.textContent = `${figure(suggestion.amplitude_deg)} deg: ${percent(suggestion.share, 0)} of ${suggestion.n_rollouts} pilot rollouts exceed a limit`;
    } catch (error) {
      words.textContent = "";
      failure.show(reason(error));
    } finally {
      go.disabled = false;
    }
  }
}

export function datasetChoice({ api, catalog, datasets, chosen, initial, asFlown }) {
  const { fields, main, folded, size } = createTestFields({ api, catalog, initial, asFlown });
  const select = h(
    "select",
    { "aria-label": "stored dataset" },
    datasets.map(({ id, name, n_unsafe, created }) =>
      h("option", { value: id }, `${name} (${n_unsafe} failures, ${moment(created)})`),
    ),
  );
  const stored = datasets.some(({ id }) => id === chosen);
  if (stored) select.value = chosen;
  const ways = ["simulate", "stored"].map((value) =>
    h("input", {
      type: "radio",
      name: "source",
      value,
      id: `source-${value}`,
      checked: (value === "stored") === stored,
      disabled: value === "stored" && datasets.length === 0,
      onchange: turn,
    }),
  );
  const words = h("p", { class: "hint" });
  const choice = h("div", { class: "field" }, select, words);
  const simulated = h("div", { class: "stack" }, main, folded);
  const element = h(
    "fieldset",
    { class: "panel stack" },
    h("legend", {}, "1  The planned test"),
    h(
      "div",
      { class: "row", role: "radiogroup", "aria-label": "source of the rollouts" },
      h("label", { class: "radio" }, ways[0], "Simulate a new test"),
      h(
        "label",
        { class: "radio" },
        ways[1],
        datasets.length ? "Use a stored dataset" : "Use a stored dataset (there is none yet)",
      ),
    ),
    choice,
    simulated,
  );
  select.addEventListener("change", turn);
  followUnits(words, turn);
  return {
    element,
    size,
    read: () => (fromStore() ? select.value : fields.read()),
    check: () => fromStore() || fields.check(),
    point: (message) => !fromStore() && fields.point(message),
    failures: () =>
      fromStore() ? datasets.find(({ id }) => id === select.value).n_unsafe : fields.read()[SIZE],
  };

  function fromStore() {
    return ways[1].checked;
  }

  function turn() {
    choice.hidden = !fromStore();
    simulated.hidden = size.hidden = fromStore();
    const dataset = datasets.find(({ id }) => id === select.value);
    if (!dataset) return;
    const { aircraft, maneuver, limits } = dataset.recipe;
    const test = `${aircraftName(catalog, aircraft)}, ${kindName(catalog, "maneuver", maneuver)}`;
    const limitText = limitWords(catalog, limits);
    const counts = `${dataset.n_unsafe} unsafe and ${dataset.n_safe_met} safe rollouts`;
    const text = `${test}, limit ${limitText}; ${counts}, one sample every ${figure(dataset.dt)} s.`;
    words.replaceChildren(formatted(text));
  }
}
