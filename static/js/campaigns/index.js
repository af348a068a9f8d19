/** Campaigns: #/campaigns lists; #/campaigns/new plans one; #/campaigns/{id} is one, with ?add to add a flight condition. */

import { fileInput, labelled, parsedJson } from "../forms/controls.js";
import { needs } from "../lib/api.js";
import { empty, errorLine, guideLink, h, link, loadingView, pageOf, table } from "../lib/dom.js";
import { moment } from "../lib/numbers.js";
import { showCampaign } from "./page.js";
import { showPlanning } from "./plan_form.js";
import { stateChip } from "./states.js";
import { watching } from "../lib/watching.js";

const COLUMNS = [
  ["Name", ({ id, name }) => h("a", { href: `#/campaigns/${id}` }, name), "name campaign-name"],
  ["Aircraft", ({ aircraft }) => aircraft.join("; "), "campaign-aircraft"],
  ["Complete", ({ n_points: points, n_complete: complete }) => `${complete} of ${points}`, "number"],
  ["Next point", ({ next }) => next ?? "none, all ended"],
  ["State", ({ state }) => (state ? stateChip(state) : "–")],
  ["Changed", ({ changed }) => moment(changed), "date"],
];

export function show(element, context) {
  if (context.id === "new" || context.query.has("add")) return showPlanning(element, context);
  return context.id ? showCampaign(element, context) : showCampaigns(element, context);
}

function showCampaigns(element, { api, navigate }) {
  return loadingView(element, { title: "Campaigns", text: "Loading campaigns", loads: ["/campaigns"], build });

  function build({ keep, again }, campaigns) {
    const content = campaigns.length
      ? table({ columns: COLUMNS, items: campaigns })
      : empty(
          "No campaign yet",
          "A campaign is a build-up: points of growing amplitude, each cleared from the points flown before it, with a guarantee.",
          planning(),
          guideLink("campaigns", "how to plan a campaign"),
        );
    const page = pageOf("Campaigns", [planning()], content, fileChoice(api, navigate));
    const shown = JSON.stringify(campaigns);
    keep(
      watching(page, {
        campaigns: async () => {
          if (JSON.stringify(await api.get("/campaigns")) !== shown) again();
        },
      }),
    );
    return page;
  }
}

const planning = () => link("Plan a campaign", "#/campaigns/new", true);

/** Opens a file that another server or the command line wrote. */
function fileChoice(api, navigate) {
  const failure = errorLine();
  const input = fileInput({
    accept: ".json,application/json",
    failure,
    read: async (file) => {
      const plain = parsedJson(await file.text(), () => `${file.name} is not JSON: choose a campaign file.`);
      const made = await api.post("/campaigns/file", plain);
      navigate(`#/campaigns/${made.id}`);
    },
  });
  const field = labelled("Open a campaign file", input);
  return h("section.panel.stack-tight", needs("POST /campaigns/file"), field.element, failure.element);
}
