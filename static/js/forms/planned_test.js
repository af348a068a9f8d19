/**
 * The planned test of a form: a stored dataset, or the recipe of one to simulate.
 *
 * initial: a recipe to begin with; else the default with noise, jitter, imperfections of a real flight and the usual
 *     number of failures
 * datasetChoice(...) -> {element, size (editor of n_unsafe), read() -> id | recipe, check(), editors,
 *     failures() -> number of unsafe rollouts that calibrate | null, isOwn() -> whether it is one of own rollouts,
 *     choosesMethod() -> whether methods can be tried on it, isSimulated()}
 *     chosen: id of the stored dataset to begin with
 */

import { needs, reason } from "../lib/api.js";
import { isSimulated, limitsOfMonitor, testModel, testWords } from "../lib/catalog.js";
import { button, errorLine, formatted, h } from "../lib/dom.js";
import { counted, figure, followUnits, moment, percent } from "../lib/numbers.js";
import { fieldset, fold, inWords, radioGroup, select } from "./controls.js";
import { createFields } from "./form.js";

const SIZE = "n_unsafe";
/** Set by the monitor where the test is simulated for one; a field only on the Datasets page. */
const GROUPS = "groups";
/** Objects that are shown open. */
const OPEN = ["condition", "limits"];
/** Objects beside them, folded. */
const BESIDE = ["margins"];

const MODELS = [
  ["dataset", "Linear, lateral motion"],
  ["nonlinear", "Nonlinear, six degrees of freedom"],
  ["jsbsim", "JSBSim"],
];

/** withGroups: with the field of the groups of failing rollouts. */
export function createTestFields({ api, catalog, initial = null, withGroups = false }) {
  const value = testModel(catalog, initial ?? {});
  const ways = MODELS.map(([name, words]) => [name, words, missing(catalog.recipes[name])]);
  const model = radioGroup({ name: "model", ways, value, onchange: () => turn(), label: "model of the aircraft" });
  const [main, folded, size] = [h("div.stack"), h("div"), h("div")];
  let fields;
  turn(initial);
  const shown = {
    read: () => fields.read(),
    check: () => fields.check(),
    get editors() {
      return fields.editors;
    },
  };
  return { fields: shown, main: h("div.stack", model.element, main), folded, size };

  function turn(begun = null) {
    const parts = fieldsOf({ api, catalog, model: model.value(), initial: begun, withGroups });
    fields = parts.fields;
    main.replaceChildren(parts.main);
    folded.replaceChildren(parts.folded);
    size.replaceChildren(parts.size);
  }
}

/** What a way shows where the server lacks what simulates it. */
const missing = ({ needs: name }) => (name ? { disabled: true, beside: h("span.hint", ` needs ${name} on the server: pip install '${name}'`) } : {});

function fieldsOf({ api, catalog, model, initial, withGroups }) {
  const recipe = catalog.recipes[model];
  const { schema, default: clean, usual } = recipe;
  const begun = { ...(initial ? clean : usual), ...initial };
  const fields = createFields(schema, begun, { catalog, path: "dataset", unfolded: OPEN });
  const { properties } = schema;
  const families = fields.keys.filter((key) => key !== GROUPS && properties[key]["x-family"]);
  const open = [...OPEN, ...BESIDE].filter((key) => key in properties);
  const rest = fields.keys.filter((key) => ![...families, ...open, SIZE, GROUPS].includes(key));
  const objects = rest.filter((key) => properties[key].properties);
  const chosen = families.filter((key) => !hasOneMember(properties[key], catalog));
  const main = h("div.columns.test-columns", [...chosen, ...open].map(fields.element));
  const folded = fold(
    "Sampling, noise, imperfections, seed, budget",
    h("div.field-grid", rest.filter((key) => !objects.includes(key)).map(fields.element)),
    imperfectionsChoice(fields, recipe),
    objects.map(fields.element),
    withGroups && fields.element(GROUPS),
  );
  beginWithUsualTest(fields, main, catalog, model);
  if ("margins" in properties) disableLimitsByMargins(fields, main);
  main.append(amplitudeSuggestion(fields, api));
  return { fields, main, folded, size: fields.element(SIZE) };
}

/** Whether a test has no choice in a family: one member, without parameters. */
function hasOneMember(property, catalog) {
  const { entries } = catalog.families[property["x-family"]];
  const kinds = property.properties?.kind?.enum ?? Object.keys(entries);
  return kinds.length === 1 && Object.keys(entries[kinds[0]].schema.properties).length === 0;
}

/** Limits are disabled while a stability margin labels the rollouts instead. */
function disableLimitsByMargins(fields, element) {
  const limits = fields.element("limits");
  const note = h("p.hint", { role: "status" }, "Stability margins label the rollouts instead: these limits do not count.");
  limits.append(note);
  const turn = () => {
    const isByMargins = Object.values(fields.read().margins).some((least) => least !== null);
    limits.disabled = isByMargins;
    note.hidden = !isByMargins;
  };
  element.addEventListener("input", turn);
  turn();
}

/**
 * A new aircraft or manoeuvre brings its usual test with this model: control law, manoeuvre, limits, condition or pilot,
 * except those changed by hand; one of JSBSim the altitude and Mach number that suit it.
 */
function beginWithUsualTest(fields, element, catalog, model) {
  const byHand = new Set();
  element.addEventListener("change", ({ target, isTrusted }) => {
    const [, part, name] = target.name?.split(".") ?? [];
    if (isTrusted) byHand.add(part).add(`${part}.${name}`);
    const suits = Object.entries((name === "model" && catalog.recipes[model].conditions[target.value]) || {});
    const kept = suits.filter(([key]) => !byHand.has(`condition.${key}`));
    if (kept.length) fields.put("condition", { ...fields.read().condition, ...Object.fromEntries(kept) });
    if (name !== "kind") return;
    const begun = { ...catalog.families[part]?.entries[target.value]?.usual_tests?.[model] };
    if (begun.maneuver) begun.maneuver = { ...begun.maneuver, ...flownBefore() };
    for (const [key, value] of Object.entries(begun)) if (!byHand.has(key)) fields.put(key, value);
  });

  function flownBefore() {
    const { maneuver } = fields.read();
    const scatter = Object.keys(scatterOf(catalog.recipes.dataset, "as_flown"));
    return Object.fromEntries(scatter.map((key) => [key, maneuver[key]]));
  }
}

/** The pilot's scatter: parameters of a manoeuvre that differ between a flown and a clean recipe. */
export function scatterOf(recipes, name) {
  const clean = recipes.default.maneuver;
  const differing = Object.keys(clean).filter((key) => recipes.as_flown.maneuver[key] !== clean[key]);
  return Object.fromEntries(differing.map((key) => [key, recipes[name].maneuver[key]]));
}

function imperfectionsChoice(fields, recipes) {
  const put = (name) => {
    fields.put("maneuver", { ...fields.read().maneuver, ...scatterOf(recipes, name) });
    for (const key of Object.keys(recipes.default))
      if (key !== "maneuver" && !isSame(recipes.default[key], recipes.as_flown[key])) fields.put(key, recipes[name][key]);
  };
  const small = (words, name) => button(words, () => put(name), { class: "button button-small" });
  const words = h("span.hint", "Noise, jitter and imperfections");
  return h("div.row", words, small("As in a real flight", "as_flown"), small("None", "default"));
}

const isSame = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** A button that fills in the amplitude at which a quarter of the rollouts exceed a limit. */
function amplitudeSuggestion(fields, api) {
  const words = h("span.hint", { role: "status" });
  const failure = errorLine();
  const go = button("Suggest amplitude", suggest, { class: "button button-small", ...needs("POST /datasets/amplitude") });
  return h("div.field.suggestion", h("div.row", go, words), failure.element);

  async function suggest() {
    failure.show("");
    if (!fields.check()) return;
    go.disabled = true;
    words.textContent = "Flying a pilot run…";
    try {
      const found = await api.post("/datasets/amplitude", fields.read());
      fields.put("maneuver", found.maneuver);
      words.textContent = `${figure(found.amplitude_deg)} deg: ${percent(found.share, 0)} of ${found.n_rollouts} pilot rollouts exceed a limit`;
    } catch (error) {
      words.textContent = "";
      failure.show(inWords(fields.editors, reason(error)));
    }
    go.disabled = false;
  }
}

export function datasetChoice({ api, catalog, datasets, chosen, initial = null }) {
  const { fields, main, folded, size } = createTestFields({ api, catalog, initial });
  const choice = select(
    datasets.map(({ id, name, n_unsafe: n, created }) => [id, `${name} (${counted(n, "failure")}, ${moment(created)})`]),
    { "aria-label": "stored dataset", onchange: turn, value: chosen },
  );
  const isNone = datasets.length === 0;
  const ways = [
    ["simulate", "Simulate a new test"],
    ["stored", isNone ? "Use a stored dataset (there is none yet)" : "Use a stored dataset", { disabled: isNone }],
  ];
  const value = datasets.some(({ id }) => id === chosen) ? "stored" : "simulate";
  const source = radioGroup({ name: "source", ways, value, onchange: turn, label: "source of the rollouts" });
  const words = h("p.hint");
  const stored = h("div.field", choice, words);
  const simulated = h("div.stack", main, folded);
  const element = fieldset("1  The planned test", source.element, stored, simulated);
  const fromStore = () => source.value() === "stored";
  const dataset = () => datasets.find(({ id }) => id === choice.value);
  followUnits(words, turn);
  return {
    element,
    size,
    read: () => (fromStore() ? choice.value : fields.read()),
    check: () => fromStore() || fields.check(),
    get editors() {
      return fromStore() ? new Map() : fields.editors;
    },
    failures,
    isOwn,
    choosesMethod: () => isOwn() || testModel(catalog, fromStore() ? dataset().recipe : fields.read()) !== "dataset",
    isSimulated: () => !fromStore(),
  };

  function isOwn() {
    return fromStore() && !isSimulated(dataset());
  }

  function failures() {
    if (!fromStore()) return fields.read()[SIZE];
    return isOwn() ? Math.floor(dataset().n_unsafe * catalog.calibrating_share) : dataset().n_unsafe;
  }

  function turn() {
    stored.hidden = !fromStore();
    simulated.hidden = size.hidden = fromStore();
    if (!dataset()) return;
    const { n_unsafe: unsafe, n_safe_met: safe, dt } = dataset();
    const test = isSimulated(dataset()) ? testWords(catalog, dataset()) : "Own rollouts, split by flight";
    const counts = `${unsafe} unsafe and ${safe} safe rollouts, one sample every ${figure(dt)} s`;
    words.replaceChildren(formatted(`${test}, limits: ${limitsOfMonitor(catalog, dataset())}; ${counts}.`));
  }
}
