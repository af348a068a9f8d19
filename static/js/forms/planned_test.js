/**
 * The planned test of a form: a stored dataset, or the recipe of one to simulate.
 *
 * Exports
 *   createTestFields({catalog, initial}) -> {fields, main, folded, size}   parts of a dataset's recipe
 *   datasetChoice({catalog, datasets, chosen, initial, only}) -> Choice
 *     chosen: id of the stored dataset to begin with
 *
 * Choice   element, size (the editor of n_unsafe), read() -> id | recipe, check(), point(message),
 *          failures() -> number of unsafe rollouts | null
 */

import { aircraftName, kindName, limitWords } from "../lib/catalog.js";
import { formatted, h } from "../lib/dom.js";
import { figure } from "../lib/numbers.js";
import { createFields } from "./form.js";

const SIZE = "n_unsafe";

export function createTestFields({ catalog, initial }) {
  const { schema, default: usual } = catalog.recipes.dataset;
  const fields = createFields(
    schema,
    { ...usual, ...initial },
    { catalog, path: "dataset", unfolded: ["specification"] },
  );
  const properties = schema.properties;
  const families = fields.keys.filter((key) => properties[key]["x-family"]);
  const rest = fields.keys.filter(
    (key) => !families.includes(key) && ![SIZE, "specification"].includes(key),
  );
  const objects = rest.filter((key) => properties[key].properties);
  const size = fields.element(SIZE);
  if (!properties[SIZE].description)
    size.append(
      h(
        "p",
        { class: "hint" },
        "Failures to simulate and calibrate on; more give a smaller epsilon and less scatter",
      ),
    );
  const main = h(
    "div",
    { class: "columns test-columns" },
    families.map(fields.element),
    fields.element("specification"),
  );
  const folded = h(
    "details",
    { class: "fold" },
    h("summary", {}, "Sampling, noise, seed, budget"),
    h(
      "div",
      { class: "field-grid" },
      rest.filter((key) => !objects.includes(key)).map(fields.element),
    ),
    objects.map(fields.element),
  );
  suggestLaw(fields, main, catalog);
  return { fields, main, folded, size };
}

/** A new aircraft brings the law that was made for it, until a law is chosen by hand. */
function suggestLaw(fields, element, catalog) {
  let byHand = false;
  element.addEventListener("change", ({ target, isTrusted }) => {
    if (target.name === "dataset.control_law.kind" && isTrusted) byHand = true;
    if (target.name !== "dataset.aircraft.kind" || byHand) return;
    const usual = catalog.recipes.dataset.default;
    const family = target.value.split("_")[0];
    const own = Object.keys(catalog.families.control_law.entries).find((kind) =>
      kind.startsWith(`${family}_`),
    );
    fields.kind(
      "control_law",
      target.value === usual.aircraft.kind ? usual.control_law.kind : (own ?? "none"),
    );
  });
}

export function datasetChoice({ catalog, datasets, chosen, initial }) {
  const { fields, main, folded, size } = createTestFields({ catalog, initial });
  const select = h(
    "select",
    { "aria-label": "stored dataset" },
    datasets.map(({ id, name, n_unsafe }) =>
      h("option", { value: id }, `${name} (${n_unsafe} failures)`),
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
      { class: "row", role: "radiogroup", "aria-label": "where the rollouts come from" },
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
  turn();
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
    const { aircraft, maneuver, specification } = dataset.recipe;
    const test = `${aircraftName(catalog, aircraft)}, ${kindName(catalog, "maneuver", maneuver)}`;
    const limits = limitWords(catalog, specification);
    const counts = `${dataset.n_unsafe} unsafe and ${dataset.n_safe_met} safe rollouts`;
    const text = `${test}, limit ${limits}; ${counts}, a sample each ${figure(dataset.dt)} s.`;
    words.replaceChildren(formatted(text));
  }
}
