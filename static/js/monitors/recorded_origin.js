/** Train a monitor for a recording: what the server proposes, and the question which aircraft was flown. */

import { labelled, select } from "../forms/controls.js";
import { scatterOf } from "../forms/planned_test.js";
import { reason } from "../lib/api.js";
import { aircraftCondition } from "../lib/catalog.js";
import { errorLine, formatted, h, panel, sentences } from "../lib/dom.js";
import { proposalOf } from "../recordings/training_offer.js";

export async function recordedTest(api, id) {
  const recording = await api.get(`/recordings/${encodeURIComponent(id)}`);
  const refused = (error) => ({ recording, proposal: null, problem: reason(error) });
  return proposalOf(api, id).then((proposal) => ({ recording, proposal, problem: "" }), refused);
}

export function createRecordedOrigin({ catalog, recorded, changed }) {
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
  const { usual_test: test, default: aircraft } = catalog.families.aircraft.entries[kind];
  const usual = { ...dataset.usual, ...test, aircraft: { kind, ...aircraft } };
  usual.maneuver = { ...usual.maneuver, ...scatterOf(dataset, "as_flown") };
  for (const [key, value] of Object.entries(shown)) usual[key] = isSame(usual[key], value) ? { ...usual[key], ...value } : value;
  return usual;
}

/** Whether both are objects of one kind, of which the second may leave parameters out. */
function isSame(usual, shown) {
  const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
  return isObject(usual) && isObject(shown) && (shown.kind ?? usual.kind) === usual.kind;
}
