/**
 * The panels of a flight on the page, and words that several of them share.
 *
 * createFlightPanels(element, address, isOver = false) -> {name: element}     isOver: an ended flight has neither scene, gauge nor card.   view: holds the others.   refused: of a marker that was not set
 *     arranged, alone: of ../charts/arranging/side_panels.js
 * liveZero(live)    for setZero of ../lib/clock.js
 * windowOf({duration, lead}) -> s     width of the strips; a short flight fills them
 * cautionText({kind, reason}, at)     "NOT APPLICABLE at 3.4 s: ..."; at: time in words
 * waitingOf(alarms) -> {warnings, cautions}    the unacknowledged ones
 * acknowledgementOf(alarm, isLive) -> event    isLive: flight time runs with the time of day
 * recordedFlag(alarm) -> {key, t, word} | null    mark of an exceedance as recorded, not from trim
 */

import { arrangePanels, showAlone } from "../charts/arranging/side_panels.js";
import { secondsText } from "../lib/clock.js";
import { h } from "../lib/dom.js";
import { quantity, riskText } from "../lib/numbers.js";
import { reasonOf, STATE_WORDS, withdrawnWord } from "../lib/states.js";
import { AS_RECORDED } from "../recordings/words.js";

const WIDEST = 60; // s
const NARROWEST = 5; // s
const BEFORE = 2; // planned manoeuvres

export const CAUTION_WORDS = { invalid: STATE_WORDS.invalid, stale: STATE_WORDS.stale, surfaces: "SURFACES", frozen: "FROZEN", contradiction: "CONTRADICTION", trim: "TRIM" };

export function cautionText({ kind, reason, cause }, at = "") {
  const withdrawn = kind === "invalid" ? withdrawnWord(cause) : null;
  return `${withdrawn ?? CAUTION_WORDS[kind]}${at}: ${reasonOf({ cause, reason })}`;
}

export function createFlightPanels(element, address, isOver = false) {
  const part = (tag, name, ...children) => h(tag, { class: name }, ...children);
  const panels = {
    status: h("section", { "aria-label": "Status" }),
    monitors: h("p", { class: "flight-monitors", "aria-label": "Monitor in use", hidden: true }),
    limits: h("p", { "aria-label": "Limits in force", hidden: true }),
    notice: h("div.notice", { role: "status" }),
    alarm: h("section", { "aria-label": "Alarm" }),
    refused: h("p", { class: "marker-refused", role: "alert", hidden: true }),
    entry: h("section", { "aria-label": "Event in words", hidden: true }),
    problem: h("p", { class: "live-problem", role: "alert", hidden: true }),
    address: h("section", { "aria-label": "Where to send samples", hidden: true }),
    live: h("div", { role: "group", "aria-label": "Live source" }),
    strips: h("section", {}),
    scene: h("section", {}),
    lost: h("div", { class: "link-lost", role: "alert", hidden: true }),
    gauge: h("div", {}),
    ahead: h("section", { hidden: true }),
    rest: h("section", { hidden: true }),
    card: h("section", { hidden: true }),
    events: h("section", { class: "event-panel", "aria-label": "Events" }),
    calls: h("div", { class: "marker-buttons", role: "group", "aria-label": "Markers" }),
    marker: h("p", { class: "marker-last", role: "alert", hidden: true }),
    transport: h("section", { "aria-label": "Transport" }),
    wall: h("section.wall", { "aria-label": "Wall", hidden: true }),
  };
  const left = part("div", "strips-column", panels.alarm, panels.refused, panels.marker, panels.entry, panels.problem, panels.monitors, panels.limits, panels.address, panels.strips);
  const scene = part("div", "scene-cell", panels.scene, panels.lost);
  const gauge = part("section", "gauge-panel", panels.gauge, panels.rest, panels.ahead);
  const events = { label: "Events", element: panels.events };
  const beside = isOver ? { events } : { scene: { label: "Scene", element: scene }, gauge: { label: "Gauge", element: gauge }, events, card: { label: "Test card", element: panels.card } };
  const right = part("div", "side-column", ...Object.values(beside).map((each) => each.element));
  panels.view = part("div", "flight", h("h1", { class: "visually-hidden" }, "Flight"), panels.status, h("div.fly", isOver && panels.notice, left, right), panels.transport, panels.wall);
  element.replaceChildren(panels.view);
  panels.arranged = arrangePanels(address, right, beside);
  panels.alone = showAlone(panels.view, address, panels.arranged);
  return panels;
}

/** When the time of a live source is 0, and why that is not known. */
export function liveZero(live) {
  if (live === null) return ["", "the server was killed during the flight, and did not keep it"];
  return [live.time_zero ?? "", live.batches > 0 ? "the server did not keep it" : "no sample has arrived yet"];
}

/** Seconds of the strips: the source's, or of a live one those of the planned manoeuvre and of what went before. */
export function windowOf({ duration, planned_s: planned = null, lead }) {
  const length = duration ?? BEFORE * (planned ?? WIDEST);
  return Math.min(WIDEST, Math.max(NARROWEST, length + lead));
}

export function alertText(alarm, alertAbove, channels) {
  const { kind, p_value: risk, exceedance } = alarm;
  if (kind in CAUTION_WORDS) return cautionText(alarm).replace(/^[A-Z ]+/, (word) => word.toLowerCase());
  if (exceedance) {
    return exceedanceText(exceedance, channels);
  }
  return risk === null ? "alert" : `alert, risk ${riskText(risk, alertAbove)}`;
}

export function acknowledgementOf({ t, number, level, by, raised, acknowledged }, isLive) {
  const what = level === "caution" ? "caution" : "alarm";
  const text = `${what} ${number} (${secondsText(t)}) acknowledged by ${by}`;
  const at = isLive ? t + (Date.parse(acknowledged) - Date.parse(raised)) / 1000 : t;
  return { t, at, when: `${acknowledged.slice(11, 19)} UTC`, text, seen: true };
}

export function recordedFlag({ t, exceedance }) {
  return exceedance?.judged === "recorded" ? { key: exceedance.channel, t, word: AS_RECORDED } : null;
}

export function waitingOf(alarms) {
  const waiting = alarms.filter(({ acknowledged }) => acknowledged === null);
  const [cautions, warnings] = [true, false].map((is) => waiting.filter(({ level }) => (level === "caution") === is));
  return { warnings, cautions };
}

function exceedanceText({ channel, value, judged }, channels) {
  const measured = channels.find(({ key }) => key === channel);
  return `${measured.symbol} exceeds its limit: ${quantity(measured, value)}${judged === "recorded" ? " as recorded" : ""}`;
}

export function sourceText(source, name) {
  const called = name.startsWith(source.kind) ? "" : `${name}, `; // else named by its source
  if (source.kind === "simulated") {
    const outcome = source.outcome && source.outcome !== "any" ? `, ${source.outcome}` : "";
    return `simulated, ${called}seed ${source.seed ?? 0}${outcome}`;
  }
  if (source.kind === "recording") return `recording, ${name}`;
  if (source.kind === "live") return name.startsWith("live") ? name : `live, ${name}`;
  if (source.kind === "replay") return `replay, ${called}${source.outcome} ${source.rollout}`;
  return name;
}
