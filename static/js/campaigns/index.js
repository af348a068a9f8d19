/**
 * Campaigns: #/campaigns lists; #/campaigns/new plans one; #/campaigns/{id} is one, with ?add to add a flight condition.
 *
 * Exports  show(element, {id, query, api, navigate}) -> {close()}
 */

import { ApiError, reason } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { scrolledTable } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { may, needs } from "../lib/me.js";
import { moment } from "../lib/numbers.js";
import { empty, errorLine, link, pageOf } from "../lib/view_states.js";
import { showCampaign } from "./page.js";
import { showPlanning } from "./plan_form.js";
import { stateChip } from "./states.js";
import { watching } from "./watching.js";

export function show(element, context) {
  const query = context.query ?? new URLSearchParams();
  if (context.id === "new" || query.has("add")) return showPlanning(element, context);
  return context.id ? showCampaign(element, context) : showCampaigns(element, context);
}

function showCampaigns(element, { api, navigate }) {
  return loadingView(element, { title: "Campaigns", text: "Loading campaigns", build });

  async function build({ keep, again }) {
    const campaigns = await api.get("/campaigns");
    const content = campaigns.length
      ? table(campaigns)
      : empty(
          "No campaign yet",
          "A campaign is a build-up: points of growing amplitude, each cleared from the points flown before it, with a guarantee.",
          planning(),
          guideLink("campaigns", "how to plan a campaign"),
        );
    const page = pageOf("Campaigns", [planning()], content, fileChoice(api, navigate));
    const shown = JSON.stringify(campaigns);
    keep(
      watching(page, async () => {
        if (JSON.stringify(await api.get("/campaigns")) !== shown) again();
        return "";
      }),
    );
    return page;
  }
}

function planning() {
  return may("POST /campaigns") ? link("Plan a campaign", "#/campaigns/new", true) : null;
}

function table(campaigns) {
  const rows = campaigns.map(({ id, name, aircraft, n_points: points, n_complete: complete, next, state, changed }) =>
    h(
      "tr",
      {},
      h("th", { scope: "row", class: "campaign-name" }, h("a", { href: `#/campaigns/${id}` }, name)),
      h("td", { class: "campaign-aircraft" }, aircraft.join("; ")),
      h("td", { class: "number nowrap" }, `${complete} of ${points}`),
      h("td", {}, next ?? "none, all ended"),
      h("td", {}, state ? stateChip(state) : "–"),
      h("td", { class: "dim nowrap" }, moment(changed)),
    ),
  );
  const heads = [["Name"], ["Aircraft"], ["Complete", 1], ["Next point"], ["State"], ["Changed"]];
  return scrolledTable({ heads, rows });
}

/** Opens a file that another server or the command line wrote. */
function fileChoice(api, navigate) {
  const failure = errorLine();
  const input = h("input", { type: "file", accept: ".json,application/json", id: "campaign-file", onchange: open });
  return h(
    "section",
    { class: "panel stack-tight", ...needs("POST /campaigns/file") },
    h("div", { class: "field" }, h("label", { for: "campaign-file" }, "Open a campaign file"), input),
    failure.element,
  );

  async function open() {
    failure.show("");
    const [file] = input.files;
    if (!file) return;
    try {
      const made = await api.post("/campaigns/file", parsed(await file.text(), file.name));
      navigate(`#/campaigns/${made.id}`);
    } catch (error) {
      failure.show(reason(error));
      input.value = "";
    }
  }
}

function parsed(text, name) {
  try {
    return JSON.parse(text);
  } catch {
    throw new ApiError(`${name} is not JSON: choose a campaign file.`, 422);
  }
}
