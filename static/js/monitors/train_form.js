/**
 * Train a monitor: the form, then the job, then the monitor's page.
 *
 * query: dataset (train on it), like (begin with the recipe of that monitor), recording (begin with what the server proposes)
 */

import { createForm, fieldset, foldedPanel, group, labelled, optionalName, select } from "../forms/controls.js";
import { createFields } from "../forms/form.js";
import { datasetChoice, scatterOf } from "../forms/planned_test.js";
import { reason } from "../lib/api.js";
import { aircraftCondition, loadCatalog, methodOf } from "../lib/catalog.js";
import { errorLine, formatted, h, link, loadingView, pageOf, panel, put, sentences } from "../lib/dom.js";
import { counted, figure, percent } from "../lib/numbers.js";
import { proposalOf } from "../recordings/training_offer.js";

const TITLE = "Train a monitor";
const DOUBT = 0.05; // of a promise with 95 % confidence
const MAIN = ["t_early", "epsilon"];
const BEST = "best";
const TEST = {
  title: "test flights",
  type: "integer",
  minimum: 0,
  maximum: 100000,
  default: 2000,
  description: "fresh flights that measure misses and false alarms; 0 for none.",
};

export function showTraining(element, { query, api, navigate }) {
  const [begun, flown] = [query.get("like"), query.get("recording")];
  const loads = [loadCatalog, "/datasets", () => begun && api.get(`/monitors/${begun}`), () => flown && recordedTest(api, flown)];
  return loadingView(element, { title: TITLE, text: "Loading aircraft and manoeuvres", loads, build });

  function build({ keep }, catalog, datasets, like, recorded) {
    const stage = h("div.stack");
    const origin = recorded && createRecordedOrigin({ catalog, recorded, changed: fill });
    const trained = ({ monitor }) =>
      navigate(recorded ? `#/recordings/${recorded.recording.id}?monitor=${monitor}` : `#/monitors/${monitor}`);
    fill();
    return pageOf(TITLE, [], origin?.element, stage);

    function fill() {
      const recipe = like ?? origin?.recipe() ?? null;
      const form = trainForm({ api, catalog, datasets, like: recipe, chosen: query.get("dataset"), keep, trained });
      stage.replaceChildren(...(origin && recipe === null ? [] : [form]));
    }
  }
}

/** like: {recipe, dataset_recipe} to begin with, or null.   chosen: id of the dataset to begin with, or null. */
function trainForm({ api, catalog, datasets, like, chosen, keep, trained }) {
  const { schema, [like ? "default" : "usual"]: usual } = catalog.recipes.monitor;
  const withTest = { ...schema, properties: { ...schema.properties, n_test: TEST } };
  const fields = createFields(withTest, { ...usual, ...like?.recipe }, { catalog, path: "monitor" });
  const source = datasetChoice({ api, catalog, datasets, chosen, initial: like?.dataset_recipe });
  const best = h("option", { value: BEST }, "the best on separate flights (recommended)");
  const method = select(
    [
      ...catalog.methods.map(({ kind, label }) => [kind, label]),
      ["", "predictor and score chosen below"],
    ],
    { id: "method", name: "method", oninput: choose },
  );
  const steps = h("span.hint");
  let couldChoose = like !== null; // its method is kept
  const named = optionalName("name of the monitor", "monitor-name");
  const served = h("p.hint.served");
  const advanced = fields.keys.filter((key) => !MAIN.includes(key));
  const families = advanced.filter((key) => schema.properties[key]?.["x-family"]);
  const { element, form } = createForm({
    title: TITLE,
    word: "Train",
    route: "POST /monitors",
    fields: [source, fields, group({ name: named })],
    content: [
      source.element,
      fieldset(
        "2  Warning lead time and miss rate",
        h("div.field-grid", MAIN.map(fields.element), source.size, labelled("method", method).element, named.element),
        served,
      ),
      foldedPanel(
        "Predictor, score, groups, promise, calibration, test flights",
        h("div.columns", families.map(fields.element)),
        h("div.field-grid", advanced.filter((key) => !families.includes(key)).map(fields.element)),
      ),
    ],
    beside: [
      link("Cancel", "#/monitors"),
      steps,
    ],
    send: () => api.post("/monitors", { ...recipe(), dataset: source.read(), ...named.read() }),
    follow: { api, keep, title: ({ request }) => `Training “${request.name}”`, done: trained },
  });
  for (const event of ["input", "change"]) form.addEventListener(event, follow);
  follow();
  return element;

  /** Separate flights choose the method where the recipe names none. */
  function recipe() {
    const { predictor, score, n_test: tests, ...rest } = fields.read();
    const flown = source.isOwn() ? {} : { n_test: tests };
    return method.value === BEST ? { ...flown, ...rest } : { predictor, score, ...flown, ...rest };
  }

  function choose() {
    const { predictor, score } = catalog.methods.find(({ kind }) => kind === method.value) ?? {};
    if (predictor) fields.put("predictor", predictor);
    if (score) fields.put("score", score);
  }

  function follow({ target = null } = {}) {
    const [isOwn, canChoose] = [source.isOwn(), source.choosesMethod()];
    const isNew = canChoose && !couldChoose;
    const isByHand = /[.](predictor|score)/.test(target?.name ?? "");
    const isBest = isNew || (canChoose && method.value === BEST && !isByHand);
    if (canChoose) method.prepend(best);
    else best.remove();
    const { kind, label } = catalog.methods[0];
    put(method.querySelector(`[value="${kind}"]`), canChoose ? label : `${label} (recommended)`);
    couldChoose = canChoose;
    fields.element("n_test").hidden = isOwn;
    put(steps, `${source.isSimulated() ? "Simulates, trains" : "Trains"} and tests. You can leave the page meanwhile.`);
    method.value = isBest ? BEST : (methodOf(catalog, fields.read())?.kind ?? "");
    const { words, isEnough } = servedWords(source.failures(), fields.read(), isOwn && catalog.calibrating_share);
    served.textContent = words;
    served.classList.toggle("error", !isEnough);
  }
}

/** Fewest failures that are enough for an epsilon. */
export function neededFor(epsilon, guarantee = "average") {
  const n = guarantee === "average" ? 1 / epsilon - 1 : Math.log(DOUBT) / Math.log1p(-epsilon);
  return Math.ceil(n - 1e-9);
}

/** share: of the dataset's failures that calibrate; false where all do. */
function servedWords(n, { epsilon, guarantee }, share) {
  if (!(epsilon > 0 && epsilon < 1) || n === null) return { words: "", isEnough: true };
  const needed = neededFor(epsilon, guarantee);
  const words =
    n >= needed
      ? `${share ? "Up to " : ""}${counted(n, "failure")}${share ? ` calibrate, ${percent(share, 0)} of the dataset's` : ""}: enough for ε ≥ ${figure(guarantee === "average" ? 1 / (n + 1) : 1 - DOUBT ** (1 / n))}.`
      : `ε = ${figure(epsilon)} needs at least ${needed} unsafe rollouts, and ${share ? `${n}, ${percent(share, 0)} of the dataset's, calibrate` : `${n} are set`}: raise ε or the number of rollouts.`;
  return { words, isEnough: n >= needed };
}

async function recordedTest(api, id) {
  const recording = await api.get(`/recordings/${encodeURIComponent(id)}`);
  const refused = (error) => ({ recording, proposal: null, problem: reason(error) });
  return proposalOf(api, id).then((proposal) => ({ recording, proposal, problem: "" }), refused);
}

function createRecordedOrigin({ catalog, recorded, changed }) {
  const { recording, proposal, problem } = recorded;
  const failure = errorLine();
  failure.show(problem);
  const known = Object.values(catalog.families.aircraft.entries).map((entry) => [entry.kind, aircraftCondition(entry)]);
  const choice = select([["", "choose the aircraft"], ...known], { id: "recorded-aircraft", onchange: changed });
  const hint = "The form opens with this aircraft's usual test and what the recording shows.";
  const field = labelled("Which aircraft was flown?", choice, { hint });
  const element = panel(
    ["For the recording ", h("a", { href: `#/recordings/${recording.id}` }, recording.name)],
    [proposal && sentences(proposal.reasons.map(formatted)), field.element, failure.element],
    { class: "panel stack-tight recorded-origin", "aria-label": "From a recording" },
  );
  return { element, recipe };

  function recipe() {
    if (!choice.value) return null;
    const { dataset = {}, ...monitor } = proposal?.recipe ?? {};
    const { usual: recipeOf, default: clean } = catalog.recipes.monitor;
    return { recipe: { ...(recipeOf ?? clean), ...monitor }, dataset_recipe: testOf(catalog, choice.value, dataset) };
  }
}

/** The usual test of the aircraft, with what the recording shows in place of it. */
function testOf(catalog, kind, shown) {
  const { dataset } = catalog.recipes;
  const { usual_tests: tests, default: aircraft } = catalog.families.aircraft.entries[kind];
  const usual = { ...dataset.usual, ...tests.dataset, aircraft: { kind, ...aircraft } };
  usual.maneuver = { ...usual.maneuver, ...scatterOf(dataset, "as_flown") };
  for (const [key, value] of Object.entries(shown)) usual[key] = isSame(usual[key], value) ? { ...usual[key], ...value } : value;
  return usual;
}

/** Whether both are objects of one kind, of which the second may leave parameters out. */
function isSame(usual, shown) {
  const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
  return isObject(usual) && isObject(shown) && (shown.kind ?? usual.kind) === usual.kind;
}
