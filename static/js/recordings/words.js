/**
 * What is said of recordings and scorings: sizes, times, and every outcome with a word and a sign.
 *
 * Exports
 *   MAPPING_STATES   key -> {word, level, text}
 *   outcomeOf(key) -> {word, level, mark, text}, outcomeChip(key) -> element
 *   outsideText({outside, channels}) -> string    limits reached outside every manoeuvre; or nothing
 *   validityWords(stretch) -> {word, level, mark}
 *   orderWords(order) -> string             which manoeuvres, from which trim
 *   trimText(order) -> string               what the channels are measured from
 *   isWithdrawn(stretch), firstAlertText(stretch)
 *   leadText(stretch, lead) -> string       lead reached against the promised one
 */

import { h } from "../lib/dom.js";
import { figure, formatValue, secondsText } from "../lib/numbers.js";

export const MAPPING_STATES = {
  proposed: { word: "check it", level: "caution", text: "proposed from names and values" },
  remembered: { word: "remembered", level: "caution", text: "as the last time; check it" },
  confirmed: { word: "confirmed", level: "ok", text: "" },
};

const OUTCOMES = {
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
  unseen: {
    word: "NOT ALL SEEN",
    level: "caution",
    mark: "◇",
    text: "part of it was not seen: whether a limit was reached is not known",
  },
  invalid: {
    word: "INVALID",
    level: "off",
    mark: "✕",
    text: "the monitor had no right to speak here",
  },
};

export function outcomeOf(key) {
  const word = String(key ?? "not said").replaceAll("_", " ").toUpperCase();
  return OUTCOMES[key] ?? { word, level: "caution", mark: "◆", text: "" };
}

export function outcomeChip(key) {
  const { word, level, mark, text } = outcomeOf(key);
  return h("span", { class: "chip", "data-level": level, title: text }, `${mark} ${word}`);
}

export function outsideText({ outside, channels }) {
  if (!outside?.length) return "";
  const parts = outside.map(({ t, channel, value }) => {
    const { symbol, unit } = channels.find(({ key }) => key === channel) ?? {
      symbol: channel,
      unit: "",
    };
    return `${symbol} reached its limit outside every manoeuvre: ${formatValue(value)} ${unit} at ${secondsText(t)}`;
  });
  return `${parts.join("; ")}.`;
}

export function validityWords({ validity: { valid }, outcome }) {
  if (valid === true && outcome === "unseen")
    return { word: "valid where seen", level: "caution", mark: "◇" };
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

export function trimText({ trim }) {
  return trim === null ? "as given, no trim subtracted" : "from trim";
}

export function isWithdrawn({ validity, outcome }) {
  return validity.valid === false || outcome === "invalid";
}

export function firstAlertText(stretch) {
  if (isWithdrawn(stretch)) return "withdrawn";
  return stretch.alerts.length ? secondsText(stretch.alerts[0][0]) : "none";
}

export function leadText(stretch, promised) {
  if (isWithdrawn(stretch)) return "withdrawn";
  const { crossing, lead, alerts } = stretch;
  if (!crossing) return "–";
  if (lead === null || lead === undefined)
    return alerts.length ? "none before the limit" : "no alert";
  const enough = lead >= promised - 1e-9;
  return `${lead.toFixed(2)} s, ${enough ? "at least" : "short of"} ${figure(promised)} s`;
}
