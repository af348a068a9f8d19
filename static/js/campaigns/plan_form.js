/** Plan a campaign, or add points at another flight condition.   query: name of a new campaign */

import { createForm, fieldset, foldedPanel, group, labelled, textInput } from "../forms/controls.js";
import { createFields } from "../forms/form.js";
import { createTestFields } from "../forms/planned_test.js";
import { loadCatalog } from "../lib/catalog.js";
import { guideLink, h, link, loadingView, pageOf } from "../lib/dom.js";
import { decimals } from "../lib/numbers.js";

const STEPS = "0.4 0.6 0.8 1";

export function showPlanning(element, { id, query, api, navigate }) {
  const isNew = id === "new";
  const title = isNew ? "Plan a campaign" : "Add a flight condition";
  const loads = [loadCatalog, () => !isNew && api.get(`/campaigns/${id}`)];
  return loadingView(element, { title, text: "Loading aircraft and manoeuvres", loads, build });

  function build(_, catalog, campaign) {
    const heading = campaign ? `${campaign.name}: ${title.toLowerCase()}` : title;
    const form = formOf({ api, catalog, campaign, navigate, title, given: query.get("name") ?? "" });
    return pageOf(heading, [guideLink("campaigns#on-the-page", "how to plan")], form);
  }
}

function formOf({ api, catalog, campaign, navigate, title, given }) {
  const test = createTestFields({ api, catalog, initial: campaign ? campaign.conditions.at(-1).test : undefined });
  const { schema, default: usual } = catalog.recipes.clearance;
  const clearance = createFields(schema, usual, { catalog, path: "clearance" });
  const name = textInput({ maxlength: 200, required: true, value: given });
  const condition = textInput({ maxlength: 200, placeholder: campaign ? "Mach 0.6, 5,000 ft" : "optional" });
  const steps = textInput({ inputmode: "decimal", value: STEPS });
  const passes = textInput({ inputmode: "decimal", value: "1" });
  const criteria = textInput({ maxlength: 1000, placeholder: "optional" });
  const named = labelled("name of the campaign", name);
  const stepField = labelled("steps, as shares of the amplitude", steps, { hint: "increasing, separated by spaces" });
  const passField = labelled("pass below this share of a limit", passes, { hint: "1 is the limit itself" });
  const where = campaign ? "condition" : "conditions.0";
  const own = {
    ...(campaign ? {} : { name: named }),
    [`${where}.name`]: labelled("flight condition", condition, { hint: "points are cleared only from steps flown at the same condition" }),
    [`${where}.steps`]: stepField,
    [`${where}.passes_below`]: passField,
    [`${where}.criteria`]: labelled("other pass criteria", criteria, { hint: "in words, judged by a person" }),
  };
  const numbersOf = ({ value }) => decimals(value).map(Number);
  const wrongNumbers = (input, needed) => (input.value.trim() && !numbersOf(input).some(Number.isNaN) ? "" : `“${input.value}” was given: give ${needed}.`);
  const checks = () => [
    [named, campaign || name.value.trim() ? "" : "No name was given: name the campaign."],
    [stepField, wrongNumbers(steps, `numbers such as ${STEPS}`)],
    [passField, wrongNumbers(passes, "a number such as 0.9")],
  ];
  const back = campaign ? `#/campaigns/${campaign.id}` : "#/campaigns";
  return createForm({
    title,
    word: campaign ? "Add points" : "Plan the campaign",
    route: campaign ? "POST /campaigns/{}/conditions" : "POST /campaigns",
    fields: [group({ ...own, amplitudes: stepField }, checks), test.fields, clearance],
    content: [
      fieldset(
        "1  The last point",
        h("p.hint", "The planned test at full amplitude. Earlier points use shares of this amplitude. Set the imperfections, noise and jitter expected in flight."),
        test.main,
        test.folded,
      ),
      fieldset("2  Points", h("div.field-grid", Object.values(own).map((field) => field.element))),
      !campaign &&
        foldedPanel("How clearances are calibrated", h("div.field-grid", clearance.keys.map(clearance.element))),
    ],
    beside: link("Cancel", back),
    send,
  }).element;

  async function send() {
    const planned = {
      name: condition.value.trim(),
      dataset: test.fields.read(),
      steps: numbersOf(steps),
      passes_below: numbersOf(passes)[0],
      criteria: criteria.value.trim(),
    };
    const made = campaign
      ? await api.post(`/campaigns/${campaign.id}/conditions`, planned)
      : await api.post("/campaigns", { name: name.value.trim(), conditions: [planned], clearance: clearance.read() });
    navigate(`#/campaigns/${made.id}`);
  }
}
