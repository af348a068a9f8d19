/**
 * One campaign: next point, build-up, table of points, identified aircraft.
 *
 * Exports  showCampaign(element, {id, api, navigate})
 */

import { reason } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { UNDER_WAY } from "../lib/job_progress.js";
import { scrolledTable, sentences } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { figure, moment, percent } from "../lib/numbers.js";
import { askToConfirm, button, errorLine, link, loading, pageOf } from "../lib/view_states.js";
import { buildUpFigure, derivativesFigure } from "./figures.js";
import { nextPoint } from "./next_point.js";
import { percentAtMost, predictedWords, reachedWords, stateChip } from "./states.js";
import { watching } from "./watching.js";

export function showCampaign(element, { id, api, navigate }) {
  const path = `/campaigns/${encodeURIComponent(id)}`;
  return loadingView(element, { title: "Campaign", text: "Opening the campaign", build });

  async function build({ keep, again }) {
    const [campaign, jobs] = await Promise.all([api.get(path), api.get("/jobs")]);
    const running = jobs.find(({ status, request }) => UNDER_WAY.includes(status) && request.campaign === id);
    const next = keep(nextPoint({ api, path, campaign, running, again }));
    const actions = [
      link("All campaigns", "#/campaigns"),
      h("a", { class: "button", href: `/api/v1${path}/report`, target: "_blank", rel: "noopener" }, "Card and report"),
      h("a", { class: "button", href: `/api/v1${path}/file`, download: `campaign-${id}.json` }, "Download"),
      h("a", { class: "button", href: `#/campaigns/${id}?add`, ...needs("POST /campaigns/{}/conditions") }, "Add a flight condition"),
      guideLink("campaigns#clearance", "clearance"),
      button("Delete", () => remove(campaign), { class: "button button-danger", ...needs("DELETE /campaigns/{}") }),
    ];
    const page = pageOf(
      campaign.name,
      actions,
      h("p", { class: "dim" }, campaign.aircraft.join("; ")),
      h("div", { class: "figures campaign-figures" }, next.element, campaign.conditions.map(({ name }) => buildUp(campaign, name))),
      table(campaign),
      campaign.points.some(({ clearing }) => clearing)
        ? h("p", {}, `Probability that any computed clearance leads to an exceedance: at most ${percentAtMost(campaign.exceeding_at_most)}, over the simulated aircraft and flights.`)
        : null,
      campaign.n_complete ? derivatives(api, path) : null,
    );
    keep(watching(page, () => newer(campaign, next, again)));
    return page;
  }

  /** Reload after others' decisions, unless something is being typed. */
  async function newer({ changed }, next, again) {
    if ((await api.get(path)).changed === changed) return "";
    if (!next.isIdle()) return "This campaign was changed elsewhere; the page is out of date. Reload it.";
    again();
    return "";
  }

  function remove(campaign) {
    askToConfirm(
      `Delete the campaign “${campaign.name}”?`,
      "Deletes the campaign and its decisions permanently. Recordings and monitors stay. Download its file first to keep a copy.",
      "Delete permanently",
      async () => {
        await api.delete(path);
        navigate("#/campaigns");
      },
    );
  }
}

function buildUp({ points }, name) {
  const flownThere = points.filter(({ condition }) => condition === name);
  return h("section", { class: "panel" }, buildUpFigure(flownThere, name ? `Build-up at ${name}` : "Build-up"));
}

function table({ points }) {
  const rows = points.map((point) =>
    h(
      "tr",
      { "data-point": point.name },
      h("th", { scope: "row" }, point.name),
      h("td", { class: "number" }, figure(point.peak_deg)),
      h("td", {}, stateChip(point.state)),
      h("td", { class: "number campaign-words" }, predictedWords(point.clearing)),
      h("td", { class: "number campaign-words" }, point.flown ? reachedWords(point) : "–"),
      h("td", { class: "number" }, percent(point.passes_below, 0)),
      h("td", {}, links(point)),
      h("td", { class: "campaign-events" }, point.events.length ? h("ul", { class: "sentences" }, point.events.map(eventItem)) : "–"),
    ),
  );
  const heads = [["Point"], ["Amplitude [deg]", 1], ["State"], ["Predicted", 1], ["Reached", 1], ["Must stay below", 1], ["Stored"], ["Decisions"]];
  return scrolledTable({ heads, rows });
}

function eventItem({ state, by, at, words }) {
  return h("li", {}, h("strong", {}, state), `: ${by}, ${moment(at)}${words && `; ${words}`}`);
}

function links({ flown, monitor }) {
  const parts = [
    monitor && h("a", { href: `#/monitors/${monitor}` }, "monitor"),
    flown?.flight && h("a", { href: `#/fly/${flown.flight}` }, "flight"),
    flown?.recording_deleted && h("span", { class: "dim" }, "recording deleted"),
    flown?.recording && h("a", { href: `#/recordings/${flown.recording}` }, "recording"),
    ...(flown?.scorings ?? []).flatMap((scoring, k) => {
      const number = flown.scorings.length > 1 ? ` ${k + 1}` : "";
      return [
        h("a", { href: `#/recordings/${flown.recording}?scoring=${scoring}` }, `scoring${number}`),
        h("a", { href: `/api/v1/recordings/${flown.recording}/scorings/${scoring}/report`, target: "_blank", rel: "noopener" }, `report${number}`),
      ];
    }),
  ].filter(Boolean);
  return parts.length ? h("ul", { class: "sentences" }, parts.map((part) => h("li", { class: "nowrap" }, part))) : "–";
}

/** Loaded after the page is shown: identification takes a moment. */
function derivatives(api, path) {
  const element = h("div", { class: "stack" }, loading("Identifying the aircraft"));
  api.get(`${path}/derivatives`).then(
    (conditions) => element.replaceChildren(...conditions.map(identified)),
    (error) => element.replaceChildren(h("p", { class: "error", role: "alert" }, reason(error))),
  );
  return element;
}

function identified(condition) {
  const last = condition.after.at(-1);
  const uncertain = last.parameters.filter(({ before }) => before[1] > 0);
  const rows = uncertain.map(({ name, before, after, determined }) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, name),
      h("td", { class: "number nowrap" }, `${figure(before[0], 4)} ± ${figure(before[1], 2)}`),
      h("td", { class: "number nowrap" }, `${figure(after[0], 4)} ± ${figure(after[1], 2)}`),
      h("td", { class: "number" }, percent(after[1] / before[1], 0), determined ? null : h("span", { class: "list-mark" }, "not determined")),
    ),
  );
  const fits = last.sources.map((source, k) => `${source}: R² ${["β", "p", "r", "N_y"].map((key, c) => `${key} ${figure(last.r2[k][c])}`).join(", ")}`);
  return h(
    "section",
    { class: "stack" },
    h(
      "div",
      { class: "figures campaign-figures" },
      h("section", { class: "panel" }, derivativesFigure(condition)),
      scrolledTable({ heads: [["Derivative"], ["Before ± σ", 1], ["After ± σ", 1], ["Remaining σ", 1]], rows }),
    ),
    sentences([...fits, `Mean squared distance from the expected aircraft: ${figure(last.distance)} (expected: about 1 or less).`]),
  );
}
