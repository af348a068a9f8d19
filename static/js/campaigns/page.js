/** One campaign: next point, build-up, table of points, identified aircraft. */

import { drawnFigure } from "../charts/figure.js";
import { needs, reason } from "../lib/api.js";
import { deleteButton, formatted, guideLink, h, link, loading, loadingView, pageOf, sentences, table } from "../lib/dom.js";
import { UNDER_WAY } from "../lib/job_progress.js";
import { figure, moment, percent } from "../lib/numbers.js";
import { nextPoint } from "./next_point.js";
import { percentAtMost, predictedWords, reachedWords, stateChip } from "./states.js";
import { watching } from "../lib/watching.js";

const NEW_TAB = { target: "_blank", rel: "noopener" };
const OUTPUTS = ["β", "p", "r", "N_y"];
const POINTS = [
  ["Point", ({ name }) => name, "name"],
  ["Amplitude [deg]", ({ peak_deg: peak }) => figure(peak), "number"],
  ["State", ({ state }) => stateChip(state)],
  ["Predicted", ({ clearing }) => predictedWords(clearing), "number campaign-words"],
  ["Reached", (point) => (point.flown ? reachedWords(point) : "–"), "number campaign-words"],
  ["Must stay below", ({ passes_below: below }) => percent(below, 0), "number"],
  ["Stored", stored],
  ["Decisions", ({ events }) => listOf(events.map(eventWords)), "campaign-events"],
];
const DERIVATIVES = [
  ["Derivative", ({ name }) => name, "name"],
  ["Before ± σ", ({ before: [mean, sigma] }) => `${figure(mean, 4)} ± ${figure(sigma, 2)}`, "number"],
  ["After ± σ", ({ after: [mean, sigma] }) => `${figure(mean, 4)} ± ${figure(sigma, 2)}`, "number"],
  ["Remaining σ", remaining, "number"],
];

export function showCampaign(element, { id, api, navigate }) {
  const path = `/campaigns/${encodeURIComponent(id)}`;
  return loadingView(element, { title: "Campaign", text: "Opening the campaign", loads: [path, "/jobs"], build });

  function build({ keep, again }, campaign, jobs) {
    const running = jobs.find(({ status, request }) => UNDER_WAY.includes(status) && request.campaign === id);
    const next = keep(nextPoint({ api, path, campaign, running, again }));
    const { points, conditions, exceeding_at_most: most } = campaign;
    const isComputed = points.some(({ clearing }) => clearing);
    const unwarned = points.some(({ clearing }) => clearing?.monitor_epsilon) ? " without an alert in time" : "";
    const page = pageOf(
      campaign.name,
      [
        link("All campaigns", "#/campaigns"),
        h("a.button", { href: `/api/v1${path}/report`, ...NEW_TAB }, "Card and report"),
        h("a.button", { href: `/api/v1${path}/file`, download: `campaign-${id}.json` }, "Download"),
        h("a.button", { href: `#/campaigns/${id}?add`, ...needs("POST /campaigns/{}/conditions") }, "Add a flight condition"),
        guideLink("campaigns#clearance", "clearance"),
        deleteButton({
          api,
          path,
          what: `campaign “${campaign.name}”`,
          consequence: "Deletes the campaign and its decisions permanently. Recordings and monitors stay. Download its file first to keep a copy.",
          done: () => navigate("#/campaigns"),
        }),
      ],
      conditions.map(({ name: where, plan }) => h("p.dim", where && `${where}: `, plan)),
      h("div.stack.campaign-top", next.element, conditions.map(buildUp)),
      table({ columns: POINTS, items: points, row: ({ name }) => ({ "data-point": name }), classes: "table-points" }),
      isComputed &&
        h("p", `Probability that any computed clearance leads to an exceedance${unwarned}: at most ${percentAtMost(most)}, over the simulated aircraft and flights.`),
      campaign.n_complete ? derivatives(api, path) : null,
    );
    keep(watching(page, { campaigns: () => newer(campaign, next, again) }));
    return page;
  }

  /** Reload after others' decisions, unless something is being typed. */
  async function newer({ changed }, next, again) {
    await next.acted();
    const { changed: newest } = await api.get(path);
    if (newest === changed || !next.element.isConnected) return ""; // it may have been reloaded meanwhile
    if (!next.isIdle()) return "This campaign was changed elsewhere; the page is out of date. Reload it.";
    again();
    return "";
  }
}

function buildUp({ name, figure }) {
  const words = "Line: limit. Bars: predicted before the flight, 5, 50 and 95 %; dashed: prediction withdrawn. Dots: flown. Crosses: not passed, or aborted.";
  return h("section.panel", drawnFigure(figure, name ? `Build-up at ${name}` : "Build-up", words));
}

function eventWords({ state, by, at, words }) {
  return [h("strong", state), `: ${by}, ${moment(at)}${words && `; ${words}`}`];
}

function stored({ flown, monitor }) {
  const linked = (words, href, attributes = {}) => h("a.nowrap", { href, ...attributes }, words);
  const recording = flown?.recording;
  const scorings = (flown?.scorings ?? []).flatMap((scoring, k, { length: n }) => {
    const number = n > 1 ? ` ${k + 1}` : "";
    return [
      linked(`scoring${number}`, `#/recordings/${recording}?scoring=${scoring}`),
      linked(`report${number}`, `/api/v1/recordings/${recording}/scorings/${scoring}/report`, NEW_TAB),
    ];
  });
  return listOf([
    monitor && linked("monitor", `#/monitors/${monitor}`),
    flown?.flight && linked("flight", `#/fly/${flown.flight}`),
    flown?.recording_deleted && h("span.dim", "recording deleted"),
    recording && linked("recording", `#/recordings/${recording}`),
    ...scorings,
  ]);
}

const listOf = (parts) => sentences(parts.filter(Boolean)) ?? "–";

/** Loaded after the page is shown: identification takes a moment. */
function derivatives(api, path) {
  const element = h("div.stack", loading("Identifying the aircraft"));
  api.get(`${path}/derivatives`).then(
    (conditions) => element.replaceChildren(...conditions.map(identified)),
    (error) => element.replaceChildren(h("p.error", { role: "alert" }, reason(error))),
  );
  return element;
}

function remaining({ before, after, determined }) {
  return [percent(after[1] / before[1], 0), determined ? null : h("span.list-mark", "not determined")];
}

function identified(condition) {
  const last = condition.after.at(-1);
  const uncertain = last.parameters.filter(({ before }) => before[1] > 0);
  const shares = (k) => OUTPUTS.map((key, c) => `${key} ${figure(last.r2[k][c])}`).join(", ");
  const fits = last.sources.map((source, k) => formatted(`${source}: R² ${shares(k)}`));
  const where = condition.condition && ` at ${condition.condition}`;
  const title = `Derivatives${where}, after ${last.sources.join(", ")}`;
  const words = "Each derivative after each point, 95 %; the last point is brightest. Shaded: 95 % of the values expected before the campaign.";
  return h(
    "section.stack",
    h("section.panel", drawnFigure(condition.figure, title, words)),
    table({ columns: DERIVATIVES, items: uncertain }),
    sentences([...fits, `Mean squared distance from the expected aircraft: ${figure(last.distance)} (expected: about 1 or less).`]),
  );
}
