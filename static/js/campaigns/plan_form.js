/**
 * Plan a campaign, or add points at another flight condition.
 *
 * Exports  showPlanning(element, {id, query, api, navigate})     id: "new", or the campaign's
 *     query: name of a new campaign
 */

import { decimals } from "../forms/decimals.js";
import { createFields } from "../forms/form.js";
import { createTestFields } from "../forms/planned_test.js";
import { reason } from "../lib/api.js";
import { loadCatalog } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { errorLine, link, pageOf } from "../lib/view_states.js";

const STEPS = "0.4 0.6 0.8 1";

export function showPlanning(element, { id, query, api, navigate }) {
  const isNew = id === "new";
  const title = isNew ? "Plan a campaign" : "Add a flight condition";
  return loadingView(element, { title, text: "Loading aircraft and manoeuvres", build });

  async function build() {
    const [catalog, campaign] = await Promise.all([loadCatalog(api), isNew ? null : api.get(`/campaigns/${id}`)]);
    return pageOf(campaign ? `${campaign.name}: ${title.toLowerCase()}` : title, [guideLink("campaigns#on-the-page", "how to plan")], form({ api, catalog, campaign, navigate, title, given: query?.get("name") ?? "" }));
  }
}

function form({ api, catalog, campaign, navigate, title, given }) {
  const test = createTestFields({ api, catalog, initial: campaign?.conditions.at(-1).test });
  const { schema, default: usual } = catalog.recipes.clearance;
  const clearance = createFields(schema, usual, { catalog, path: "clearance" });
  const text = (id, attributes) => h("input", { type: "text", id: `campaign-${id}`, ...attributes });
  const name = text("name", { maxlength: 200, required: true, value: given });
  const condition = text("condition", { maxlength: 200, placeholder: campaign ? "Mach 0.6, 5,000 ft" : "optional" });
  const steps = text("steps", { inputmode: "decimal", value: STEPS });
  const passes = text("passes", { inputmode: "decimal", value: "1" });
  const criteria = text("criteria", { maxlength: 1000, placeholder: "optional" });
  const failure = errorLine();
  const route = campaign ? "POST /campaigns/{}/conditions" : "POST /campaigns";
  const go = h("button", { class: "button button-primary", type: "submit", ...needs(route) }, campaign ? "Add points" : "Plan the campaign");
  return h(
    "form",
    { class: "form", novalidate: true, onsubmit: send, "aria-label": title, "data-keeps-input": true },
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "1  The last point"),
      h("p", { class: "hint" }, "The planned test at full amplitude. Earlier points use shares of this amplitude. Set the imperfections, noise and jitter expected in flight."),
      test.main,
      test.folded,
    ),
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "2  Points"),
      h(
        "div",
        { class: "field-grid" },
        campaign ? null : labelled("name of the campaign", name),
        labelled("flight condition", condition, "points are cleared only from steps flown at the same condition"),
        labelled("steps, as shares of the amplitude", steps, "increasing, separated by spaces"),
        labelled("pass below this share of a limit", passes, "1 is the limit itself"),
        labelled("other pass criteria", criteria, "in words, judged by a person"),
      ),
    ),
    campaign
      ? null
      : h("details", { class: "panel fold" }, h("summary", {}, "How clearances are calibrated"), h("div", { class: "field-grid" }, clearance.keys.map(clearance.element))),
    failure.element,
    h("div", { class: "row form-end" }, go, link("Cancel", campaign ? `#/campaigns/${campaign.id}` : "#/campaigns")),
  );

  async function send(event) {
    event.preventDefault();
    failure.show("");
    if (!campaign && !name.value.trim()) {
      failure.show("No name was given: name the campaign.");
      name.focus();
      return;
    }
    if (![test.fields.check(), clearance.check()].every(Boolean)) return;
    const planned = {
      name: condition.value.trim(),
      dataset: test.fields.read(),
      steps: decimals(steps.value).map(Number),
      passes_below: Number(decimals(passes.value)[0]),
      criteria: criteria.value.trim(),
    };
    go.disabled = true;
    try {
      const made = campaign
        ? await api.post(`/campaigns/${campaign.id}/conditions`, planned)
        : await api.post("/campaigns", { name: name.value.trim(), conditions: [planned], clearance: clearance.read() });
      navigate(`#/campaigns/${made.id}`);
    } catch (error) {
      if (!test.fields.point(error.message)) clearance.point(error.message);
      failure.show(reason(error));
      failure.element.scrollIntoView({ block: "nearest" });
      go.disabled = false;
    }
  }
}

function labelled(words, control, hint = "") {
  return h("div", { class: "field" }, h("label", { for: control.id }, words), control, h("p", { class: "hint" }, hint));
}
