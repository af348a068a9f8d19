/**
 * What is said of recordings and scorings: sizes, times, and every outcome with a word and a sign.
 *
 * Exports
 *   bytesText(n), durationText(seconds), secondsText(t)
 *   MAPPING_STATES   key -> {word, level, text}
 *   OUTCOMES         key of a manoeuvre's verdict -> {word, level, mark, text}
 *   outcomeOf(key) -> {word, level, mark, text}, outcomeChip(key) -> element
 *   validityWords(validity) -> {word, level, mark}
 *   orderWords(order) -> string             which manoeuvres, from which trim
 *   leadText(stretch, lead) -> string       lead reached against the promised one
 */

import { h } from "./dom.js";
import { figure } from "./words.js";
import { formatTime } from "./time_axis.js";

const UNITS = ["bytes", "kB", "MB", "GB", "TB"];

export const MAPPING_STATES = {
  proposed: { word: "check it", level: "caution", text: "proposed from names and values" },
  remembered: { word: "remembered", level: "caution", text: "as the last time; check it" },
  confirmed: { word: "confirmed", level: "ok", text: "" },
};

export const OUTCOMES = {
  timely_alert: {
    word: "TIMELY ALERT",
    level: "ok",
    mark: "✓",
    text: "warned in time before the limit was reached",
  },
  late_alert: {
    word: "LATE ALERT",
    level: "alert",
    mark: "▲",
    text: "the limit was reached sooner after the alert than promised",
  },
  missed: {
    word: "MISSED",
    level: "alert",
    mark: "▲",
    text: "the limit was reached and no alert came before it",
  },
  false_alert: {
    word: "FALSE ALERT",
    level: "caution",
    mark: "◆",
    text: "an alert, and no limit was reached",
  },
  quiet: { word: "QUIET", level: "ok", mark: "✓", text: "no alert, and no limit was reached" },
  invalid: {
    word: "INVALID",
    level: "off",
    mark: "✕",
    text: "the monitor had no right to speak here",
  },
};
const UNKNOWN = { word: "NOT SAID", level: "off", mark: "?", text: "" };

export function bytesText(n) {
  const power = n > 0 ? Math.min(UNITS.length - 1, Math.floor(Math.log10(n) / 3)) : 0;
  return `${power === 0 ? n : (n / 1000 ** power).toPrecision(3)} ${UNITS[power]}`;
}

export function durationText(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  const whole = Math.round(seconds);
  if (seconds < 120) return `${seconds.toFixed(1)} s`;
  if (whole < 7200) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

export function secondsText(t) {
  return t === null || t === undefined ? "–" : `${formatTime(t, 0.01)} s`;
}

export function outcomeOf(key) {
  return OUTCOMES[key] ?? UNKNOWN;
}

export function outcomeChip(key) {
  const { word, level, mark, text } = outcomeOf(key);
  return h("span", { class: "chip", "data-level": level, title: text }, `${mark} ${word}`);
}

export function validityWords({ valid }) {
  if (valid === true) return { word: "valid", level: "ok", mark: "✓" };
  if (valid === false) return { word: "INVALID", level: "off", mark: "✕" };
  return { word: "not known", level: "caution", mark: "◆" };
}

export function orderWords({ trim, manoeuvres }) {
  const way =
    { found: "manoeuvres found", whole: "the whole recording" }[manoeuvres] ??
    `${manoeuvres.length} marked by hand`;
  if (trim === "lead_in") return way;
  return `${way}, ${trim === null ? "no trim subtracted" : `trim of ${trim} s`}`;
}

export function leadText({ crossing, lead, alerts, outcome }, promised) {
  if (!crossing) return "–";
  if (outcome === "invalid") return "withdrawn";
  if (lead === null || lead === undefined)
    return alerts.length ? "none before the limit" : "no alert";
  const enough = lead >= promised - 1e-9;
  return `${lead.toFixed(2)} s, ${enough ? "at least" : "short of"} ${figure(promised)} s`;
}
