/**
 * One campaign: what is next and what may be done with it, the build-up, its points, the aircraft as identified.
 *
 * Exports  showCampaign(element, {id, api, navigate})
 */

import { reason } from "../lib/api.js";
import { h } from "../lib/dom.js";
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
      button("Delete", () => remove(campaign), { class: "button button-danger", ...needs("DELETE /campaigns/{}") }),
    ];
    const page = pageOf(
      campaign.name,
      actions,
      h("p", { class: "dim" }, campaign.aircraft.join("; ")),
      h("div", { class: "figures campaign-figures" }, next.element, campaign.conditions.map(({ name }) => buildUp(campaign, name))),
      table(campaign),
      campaign.points.some(({ clearing }) => clearing)
        ? h("p", {}, `Probability that any point exceeds a limit that was cleared by computation: at most ${percentAtMost(campaign.exceeding_at_most)}, over aircraft and flights as simulated.`)
        : null,
      campaign.n_complete ? derivatives(api, path) : null,
    );
    keep(watching(page, () => newer(campaign, next, again)));
    return page;
  }

  /** Others decide too: the page follows them, unless something is being typed. */
  async function newer({ changed }, next, again) {
    if ((await api.get(path)).changed === changed) return "";
    if (!next.isIdle()) return "Somebody changed this campaign meanwhile: what is shown here is not the newest. Reload the page.";
    again();
    return "";
  }

  function remove(campaign) {
    askToConfirm(
      `Delete the campaign “${campaign.name}”?`,
      "What was decided of its points goes with it. Its recordings and monitors stay. Download its file first if you may want it again.",
      "Delete it",
      async () => {
        await api.delete(path);
        navigate("#/campaigns");
      },
    );
  }
}

function buildUp({ points }, name) {
  const own = points.filter(({ condition }) => condition === name);
  return h("section", { class: "panel" }, buildUpFigure(own, name ? `Build-up at ${name}` : "Build-up"));
}

/** A point's name says its flight condition, where there are several. */
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
      h("td", { class: "campaign-events" }, point.events.length ? h("ul", { class: "sentences" }, point.events.map(told)) : "–"),
    ),
  );
  const heads = [["Point"], ["Amplitude [deg]", 1], ["State"], ["Predicted", 1], ["Reached", 1], ["Must stay below", 1], ["Stored"], ["Decided by, when, why"]];
  return scrolledTable({ heads, rows });
}

function told({ state, by, at, words }) {
  return h("li", {}, h("strong", {}, state), `: ${by}, ${moment(at)}${words && `; ${words}`}`);
}

function links({ flown, monitor }) {
  const found = [
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
  return found.length ? h("ul", { class: "sentences" }, found.map((one) => h("li", { class: "nowrap" }, one))) : "–";
}

/** Computed while the rest is read already. */
function derivatives(api, path) {
  const element = h("div", { class: "stack" }, loading("Identifying the aircraft"));
  api.get(`${path}/derivatives`).then(
    (found) => element.replaceChildren(...found.map(identified)),
    (error) => element.replaceChildren(h("p", { class: "error", role: "alert" }, reason(error))),
  );
  return element;
}

function identified(found) {
  const last = found.after.at(-1);
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
      h("section", { class: "panel" }, derivativesFigure(found)),
      scrolledTable({ heads: [["Derivative"], ["Before ± σ", 1], ["After ± σ", 1], ["σ left", 1]], rows }),
    ),
    sentences([...fits, `Mean squared distance from what was expected of this aircraft: ${figure(last.distance)}, about 1 at most.`]),
  );
}
