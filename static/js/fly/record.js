/**
 * The record of an ended flight: its strips and events, and a button to fly it again.
 *
 * showFlightRecord(element, {flight, why, reopen, api, navigate}) -> {close()}
 *     why: how it ended, if the page saw it.   reopen(): reads it again
 * heldDuring(held, frames) -> [{t, limits}]    limits in force in these frames, of a record's limits_held
 */

import { createFlightChart } from "../charts/live/flight_chart.js";
import { createSimulated } from "../charts/simulated.js";
import { createAddress, keepWindow } from "../lib/address.js";
import { ApiError, needs, reason } from "../lib/api.js";
import { channelsOf, ownLimits } from "../lib/catalog.js";
import { secondsText } from "../lib/clock.js";
import { createComparison } from "../lib/comparison.js";
import { askToConfirm, button, createKeepButton, deleteButton, errorLine, formatted, h, put, state } from "../lib/dom.js";
import { createEventList } from "../lib/event_list.js";
import { withLimits } from "../lib/limits.js";
import { startFlight, warningLines } from "../lib/monitors.js";
import { counted, magnitudeIn, quantity } from "../lib/numbers.js";
import { markerNote, markerText } from "./alarms/flight_markers.js";
import { putLines } from "./flight_limits.js";
import { alertLevel, usedEvents } from "./flight_monitors.js";
import { LEVEL_OF, resultOf } from "./headline.js";
import { beginningNote, lossText, trimNotes } from "./source/live_panel.js";
import {
  acknowledgementOf,
  alertText,
  createFlightPanels,
  recordedFlag,
  sourceText,
  waitingOf,
  windowOf,
} from "./panels.js";
import { bindShortcuts } from "./shortcuts.js";
import { createStarts } from "./source/manoeuvre_starts.js";
import { createStatusStrip } from "./status_strip.js";
import { createWall } from "./wall.js";

const HOW = {
  ended: "was ended",
  interrupted: "was interrupted: the server was killed. Samples flown less than 2 s before that may be missing",
  failed: "failed: see the server's log",
};
const MOST = 100_000; // samples of a record that are drawn

export function showFlightRecord(element, { flight, why, reopen, api, navigate }) {
  const path = `/flights/${encodeURIComponent(flight.id)}`;
  const address = createAddress();
  const panels = createFlightPanels(element, address, true);
  element.dataset.flight = "over";
  const status = createStatusStrip(panels.status);
  const wall = createWall(panels.wall, panels.view, address);
  const life = new AbortController();
  bindShortcuts(wall.keys, {}, life.signal);
  const source = sourceText(flight.source, flight.name);
  const nothing = { age: NaN, latency: NaN, skipped: 0, lost: flight.lost, unwritten: 0, problem: "", utc: null };
  const shown = { mode: flight.mode, source, monitor: [flight.monitor_set?.name ?? flight.monitors[0].name], warnings: flight.warnings, link: "over", staleAfter: 1, playing: false, live: false, headline: null, figures: nothing };
  const alertAbove = alertLevel(flight);
  const isLive = flight.mode === "live";
  const late = flight.live?.late ?? [];
  const isOpen = isLive && flight.progress === "interrupted" && flight.recording === null; // its source may continue it, and a person may end it
  const latched = flight.exceedances.map(({ channel, first_t: t, worst: value, recorded }) => ({ channel, t, value, recorded }));
  let channels = []; // before they are read
  let chart = null;
  let closed = false;

  showResult(flight);
  panels.alarm.remove();
  panels.transport.remove();
  panels.address.remove();
  const failure = errorLine();
  const fail = (error) => failure.show(reason(error));
  const small = { class: "button button-small" };
  const primary = { class: "button button-small button-primary" };
  const isFromLive = flight.source.kind === "live";
  const flying = needs("POST /flights");
  const replay = button("Replay as it was shown", () => again({ kind: "journal", flight_id: flight.id }), { ...primary, hidden: true, ...flying });
  const acknowledgeButton = button("", () => failure.attempt(acknowledge), { ...small, hidden: true, ...needs("POST /flights/{}/alarms/{}/acknowledge") });
  let waiting = [];
  panels.notice.append(...[
    h("p", h("strong", `This flight ${HOW[flight.progress] ?? "is over"}${because(flight.end_reason || why)}${endedAt(flight)}. `), "Its record is shown."),
    h("div.row",
      acknowledgeButton,
      isOpen && button("End flight", askToEnd, { ...primary, title: "Complete the record from the samples that the server had received", ...needs("POST /flights/{}/end") }),
      replay,
      button(isFromLive ? "Start another like it" : "Fly it again", () => again(flight.source, flight.name), { ...(isFromLive ? small : primary), ...flying }),
      flight.recording && h("a", { ...small, href: `#/recordings/${flight.recording}` }, "Recording"),
      createKeepButton({ api, path, keep: flight.keep, fail, attributes: small }),
      deleteButton({
        api,
        path,
        what: "record",
        consequence: "Deletes its samples, assessments and alarms permanently.",
        done: () => navigate("#/fly"),
        short: "the record",
      })),
    failure.element,
    sourceLine(flight),
    ...warningLines(flight),
  ].filter(Boolean));
  const events = createEventList(panels.events, {
    go: (t) => {
      chart?.setWindow(t - 3, t + 3);
      chart?.setCursor(t);
    },
  });
  function showResult(now) {
    shown.result = resultOf(now);
    status.update(shown);
    document.title = `${now.verdict || now.level !== "none" ? `${shown.result.words} – ` : ""}${flight.name} – Forewarn`;
    showWall();
  }

  function showWall() {
    wall.show({ words: shown.result.parts, level: shown.result.level, mode: "record", name: [flight.name, shown.monitor[0]].join(" · "), channels, latched });
  }

  const marked = api.get(`${path}/markers`);
  marked.then(showMarkers, fail);
  load().catch(fail);
  offerToAcknowledge().catch(fail);

  /** The markers set in flight, at the head of the record. */
  function showMarkers(markers) {
    const lines = markers.map((marker) => h("p", { class: "marker-last", "data-level": LEVEL_OF[marker.level] }, markerText(marker)));
    panels.notice.append(...lines);
  }

  async function load() {
    panels.strips.replaceChildren(state("loading", "Reading the record", ""));
    const [catalog, monitor, alarms, frames, markers, put] = await Promise.all([
      api.get("/catalog"), api.get(`/monitors/${flight.monitor ?? flight.monitor_set.conditions[0].monitor}`), api.get(`${path}/alarms`), readFrames(), marked, flight.monitor_set === null ? api.get(`${path}/limits`) : [],
    ]);
    if (closed) return;
    const { passes, longest } = longestPass(frames);
    const held = heldDuring(flight.limits_held ?? [], longest);
    const newest = held.findLast(({ limits }) => limits !== null)?.limits ?? {};
    const limits = put.length > 0 || held.length > 0 ? newest : ownLimits(monitor);
    const warned = alarms.filter(({ level }) => level === "warning").map(({ t }) => t);
    panels.notice.querySelector(".source-result")?.replaceWith(sourceLine(flight, warned));
    panels.notice.append(...putLines(put));
    channels = withLimits(channelsOf(catalog, monitor), limits);
    showWall();
    panels.notice.append(...exceedanceLines(flight.exceedances, channels));
    replay.hidden = !isFromLive || longest.length === 0;
    if (longest.length === 0) {
      panels.strips.replaceChildren(state("empty", "Nothing was recorded", `The flight ended before its first sample${flight.live?.batches === 0 && flight.live.malformed > 0 ? ": every message of its source was refused" : ""}.`));
      return;
    }
    if (flight.monitors.length > 1) panels.strips.before(createComparison(api, path));
    draw({ lead: flight.monitors[0].lead, dt: monitor.dt }, longest, passes, held);
    const limitsPut = ({ name, version, t, by }) => ({
      event: { t, text: `limits in force: ${name} version ${version}, by ${by}`, seen: true },
      flag: { key: null, t, word: "limits", colour: "caution" },
    });
    const alarmNote = (alarm) => ({
      event: { t: alarm.t, text: alertText(alarm, alertAbove, channels) + untilText(alarm, late), level: LEVEL_OF[alarm.level], seen: true },
      flag: recordedFlag(alarm),
    });
    const notes = [alarms.map(alarmNote), put.map(limitsPut), (flight.live?.begun ?? []).map(beginningNote), trimNotes(flight.live?.trims ?? [], channels), markers.map(markerNote)].flat();
    for (const { flag } of notes) if (flag) chart.flag(flag);
    const acknowledgements = alarms.filter(({ acknowledged }) => acknowledged).map((alarm) => acknowledgementOf(alarm, isLive));
    [...notes.map(({ event }) => event).filter(Boolean), ...usedEvents(flight), ...acknowledgements].sort((a, b) => a.t - b.t).forEach(events.add);
  }

  /** Alarms left unacknowledged in flight can be acknowledged here; the headline changes with them. */
  async function offerToAcknowledge() {
    const { warnings, cautions } = waitingOf(await api.get(`${path}/alarms`));
    waiting = [...warnings, ...cautions];
    const counts = [[warnings.length, "alarm"], [cautions.length, "caution"]].filter(([n]) => n > 0);
    acknowledgeButton.hidden = waiting.length === 0;
    put(acknowledgeButton, `Acknowledge ${counts.map(([n, word]) => counted(n, word)).join(" and ")}`);
  }

  async function acknowledge() {
    for (const { id } of waiting) events.add(acknowledgementOf(await api.post(`${path}/alarms/${id}/acknowledge`), isLive));
    showResult(await api.get(path));
    await offerToAcknowledge();
  }

  function draw({ lead, dt }, frames, passes, held) {
    const [first, last] = [frames[0].t, frames.at(-1).t];
    panels.strips.replaceChildren();
    chart = createFlightChart(panels.strips, {
      channels, alertAbove, lead, dt, late, seconds: windowOf({ duration: last - first, lead }),
      address, panels: panels.arranged, beside: flight.monitors[1]?.name, simulated: flight.monitor_set === null ? createSimulated(api, flight.monitor) : null,
      starts: createStarts({ api, source: flight.source, live: () => flight.live, start: first }),
    });
    panels.strips.after(chart.editor, chart.cross);
    chart.setTransport({ playing: false, speed: 1 });
    chart.setLimits(channels, held);
    chart.push(frames);
    chart.latch(latched);
    chart.setWindow(first, Math.max(last, first + dt) + lead);
    keepWindow(address, chart.timeline);
    if (passes > 1) events.add({ t: null, text: `flown in ${passes} passes; the longest is shown` });
  }

  async function readFrames() {
    const frames = [];
    for (let next = 0; next !== null && frames.length < MOST; ) {
      const page = await api.get(`${path}/assessments?first=${next}`);
      frames.push(...page.frames);
      next = page.next;
    }
    return frames;
  }

  function again(source, name) {
    const { monitor, epsilon, monitor_set: set } = flight;
    const monitors = flight.monitors.filter(({ authority }) => !authority).map(({ id }) => id);
    const flown = set === null ? { monitor, monitors, epsilon } : { monitor_set: set.id, condition: set.fixed };
    const request = { source, ...flown, ...(name ? { name } : {}) };
    return failure.attempt(() => startFlight({ api, navigate }, request));
  }

  function askToEnd() {
    askToConfirm("End this flight?", "The server was killed during it. Its record is completed from the samples received; no source can continue it.", "End flight", endNow);
  }

  async function endNow() {
    const { progress } = await api.post(`${path}/end`);
    if (progress === "interrupted") throw new ApiError("The flight cannot be completed: its journal is missing. Its record stays as it is.", 0);
    reopen();
  }

  return {
    close: () => {
      closed = true;
      chart?.destroy();
      wall.close();
      life.abort();
      delete element.dataset.flight;
    },
  };
}

function because(why) {
  const [, by] = why.match(/^the flight was ended( by .*)$/) ?? [];
  if (by !== undefined) return by;
  return why.includes("server") ? ": the server stopped" : "";
}

/** When a live flight was ended. */
function endedAt({ mode, progress, ended }) {
  return mode === "live" && progress === "ended" && ended !== null ? `, ${ended.slice(0, 19).replace("T", " ")} UTC` : "";
}

/** Until when the display was stale, of a caution; empty where that is not known. */
function untilText({ kind, t }, late) {
  const end = kind === "stale" && late.find(({ start, end }) => start <= t && (end === null || t <= end))?.end;
  return end ? `, until ${secondsText(end)}` : "";
}

/** Samples used and not used of a live source; null for another flight. moments: times of warnings. */
function sourceLine({ mode, live, lost }, moments = []) {
  if (mode !== "live") return null;
  const words = live ? lossText(live, moments) : ["counts unknown: the server was killed during the flight"];
  if (lost > 0) words.push(`samples not recorded: ${lost.toLocaleString("en")}`);
  return h("p", { class: "source-result" }, h("strong", {}, "Live source: "), words.join(" · "));
}

/** Count, newest and worst of each channel: the verdict names only the first exceedance. */
function exceedanceLines(exceedances, channels) {
  return exceedances.map(({ channel: key, n, first_t: first, last_t: last, worst, worst_t: at, limit, recorded, recorded_t: then }) => {
    const channel = channels.find((each) => each.key === key);
    const when = n === 1 ? `once, at ${secondsText(first)}` : `${n} times, first at ${secondsText(first)}, last at ${secondsText(last)}`;
    const isAlike = recorded == null || quantity(channel, recorded) === quantity(channel, worst);
    const beside = isAlike ? "" : ` from trim; as recorded ${quantity(channel, recorded)} at ${secondsText(then)}`;
    const most = `worst ${quantity(channel, worst)} at ${secondsText(at)}${beside}, limit ${magnitudeIn(channel, limit)}`;
    return h("p", { class: "exceedance-summary" }, h("strong", formatted(channel.symbol), " exceeded: "), `${when}; ${most}.`);
  });
}

/** Limits in force during a pass, by sample number: times repeat after a seek. */
export function heldDuring(held, pass) {
  if (pass.length === 0 || held.every(({ seq }) => seq === null)) return held; // an old record without numbers
  const [first, last] = [pass[0].seq, pass.at(-1).seq];
  const begin = held.findLast(({ seq }) => seq <= first)?.limits ?? null;
  return [{ t: null, limits: begin }, ...held.filter(({ seq }) => seq > first && seq <= last)];
}

/** The longest pass of rising time between seeks and loops; the last of equals. */
function longestPass(frames) {
  let [longest, current, passes] = [[], [], 0];
  for (const frame of frames) {
    if (current.length === 0 || frame.t <= current.at(-1).t) {
      current = [];
      passes += 1;
    }
    current.push(frame);
    if (current.length >= longest.length) longest = current;
  }
  return { passes, longest };
}
