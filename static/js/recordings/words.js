/**
 * Words, levels and signs for recordings and scorings.
 *
 * Exports
 *   mappingState(recording) -> {word, level, text}
 *   outcomeOf(key) -> {word, level, mark, text}
 *   outcomeChip(manoeuvre, {n, verdict}) -> element    of n alike
 *   verdictOf(manoeuvre) -> as outcomeOf, with the exceedance and the lead time of its warning
 *   AS_RECORDED   the strips' word for an exceedance in the values as recorded only
 *   measuredBy(channels, key) -> channel
 *   outsideText(scoring) -> string    exceedances outside every manoeuvre, or "";  outsideChip(scoring),
 *     outsideLine(scoring, tag, classes) -> element | null
 *   validityWords(manoeuvre) -> {word, level, mark}
 *   peakText(manoeuvre, alertAbove, isTimed)
 *   alertRule({epsilon, alert_above}) -> string    the risk that alerts, and the epsilon that it keeps
 *   requestWords(request) -> string             manoeuvres and trim of a request
 *   trimText(request) -> string               the reference of the channels
 *   isWithdrawn(manoeuvre), firstAlertText(manoeuvre)
 *   leadText(manoeuvre, promised) -> string     warning lead time against the promised one
 */

import { formatted, h } from "../lib/dom.js";
import { figure, leadSeconds, riskText, secondsText } from "../lib/numbers.js";
import { quantity } from "../lib/units.js";
import { chip } from "../lib/view_states.js";
import { TRIM_SEGMENT } from "./scoring/source.js";

export const AS_RECORDED = "LIMIT AS RECORDED"; // an exceedance as recorded that is none relative to trim

const MAPPING_STATES = {
  proposed: { word: "unconfirmed", level: "caution", text: "proposed from names and values" },
  remembered: { word: "remembered", level: "caution", text: "taken from the last recording of this aircraft; check it" },
  confirmed: { word: "confirmed", level: "ok", text: "" },
};

/** A mapping confirmed over a warning stays marked. */
export function mappingState({ mapping_state: state, confirmed_over: over }) {
  const channels = Object.keys(over ?? {});
  if (!channels.length) return MAPPING_STATES[state] ?? {};
  const text = `with a warning for ${channels.join(", ")}`;
  return { word: "confirmed over a warning", level: "caution", text };
}

const OUTCOMES = {
  timely_alert: ["LIMIT EXCEEDED, warned in time", "caution", "▲", "alert at least the warning lead time before the first exceedance"],
  late_alert: ["LIMIT EXCEEDED, warned too late", "alert", "▲", "alert less than the warning lead time before the first exceedance"],
  missed: ["LIMIT EXCEEDED, no warning", "alert", "▲", "an exceedance with no alert before it"],
  false_alert: ["FALSE ALERT", "caution", "◆", "an alert, and no exceedance"],
  quiet: ["QUIET", "ok", "✓", "no alert, and no exceedance"],
  unseen: ["DATA MISSING", "caution", "◇", "data missing: a limit may have been exceeded"],
  unknown: ["UNKNOWN", "caution", "◆", "the monitor does not record its limits"],
  invalid: ["INVALID", "off", "✕", "the monitor does not apply to this manoeuvre"],
};

const NEITHER = {
  invalid: "the monitor does not apply to this manoeuvre: neither a miss nor a catch",
  unseen: "part of the manoeuvre was not recorded: neither a miss nor a catch",
};

export function outcomeOf(key) {
  const unknown = () => [String(key ?? "not recorded").replaceAll("_", " ").toUpperCase(), "caution", "◆", ""];
  const [word, level, mark, text] = OUTCOMES[key] ?? unknown();
  return { word, level, mark, text };
}

/** Of one manoeuvre or several alike. An exceedance comes first, and is never green. */
export function outcomeChip(manoeuvre, { n = 1, verdict = verdictOf(manoeuvre) } = {}) {
  const { word, level, mark, text } = verdict;
  return chip(`${mark} ${n > 1 ? `${n} × ` : ""}${word}`, level, text);
}

/** The server words an exceedance. One in the values as recorded only is put before the outcome. */
export function verdictOf({ outcome, exceedance, exceedance_verdict: words }) {
  const verdict = outcomeOf(outcome);
  if (!words) return verdict;
  if (!exceedance) return { ...verdict, word: `${words}; ${verdict.word}`, level: "caution", mark: "◆" };
  return { ...verdict, word: words, level: outcome === "timely_alert" ? "caution" : "alert", mark: "▲", text: NEITHER[outcome] ?? verdict.text };
}

/** symbol: of the channel. */
export function measuredBy(channels, key) {
  return channels.find((channel) => channel.key === key) ?? { symbol: key };
}

export function outsideText({ outside_exceedances: outside, channels }) {
  if (!outside.length) return "";
  const parts = outside.map(({ t, channel, value }) => {
    const measured = measuredBy(channels, channel);
    return `${measured.symbol} exceeds its limit outside every manoeuvre: ${quantity(measured, value)} at ${secondsText(t)}`;
  });
  return `${parts.join("; ")}.`;
}

export function outsideChip(scoring) {
  const title = outsideText(scoring);
  return title ? chip("◆ EXCEEDANCE OUTSIDE", "caution", title) : null;
}

export function outsideLine(scoring, tag, classes) {
  const words = outsideText(scoring);
  return words ? h(tag, { class: classes, role: "note" }, "◆ ", formatted(words)) : null;
}

export function validityWords({ validity: { valid }, outcome }) {
  if (valid === true && outcome === "unseen") return { word: "applicable where recorded", level: "caution", mark: "◇" };
  if (valid === true) return { word: "applicable", level: "ok", mark: "✓" };
  if (valid === false) return { word: "INVALID", level: "off", mark: "✕" };
  return { word: "unknown", level: "caution", mark: "◆" };
}

export function peakText({ outcome, peak_risk: risk, peak_t: t }, alertAbove, isTimed = false) {
  if (isWithdrawn({ outcome })) return "withdrawn";
  if (risk === null || risk === undefined) return "–";
  return `${riskText(risk, alertAbove)}${isTimed ? ` at ${secondsText(t)}` : ""}`;
}

export function alertRule({ epsilon, alert_above: above }) {
  const isEpsilon = Math.abs(above - epsilon) < 1e-9;
  return isEpsilon ? `alerts at risk above ε = ${figure(epsilon)}` : `alerts at risk above ${figure(above)}, which keeps ε = ${figure(epsilon)} with 95 % confidence`;
}

export function requestWords({ trim, manoeuvres }) {
  const way =
    { detected: "manoeuvres detected", entire: "the entire recording" }[manoeuvres] ??
    `${manoeuvres.length} marked by hand`;
  if (trim === TRIM_SEGMENT) return way;
  return `${way}, ${trim === null ? "no trim subtracted" : `trim of ${trim} s`}`;
}

export function trimText({ trim }) {
  return trim === null ? "as recorded, no trim subtracted" : "deviations from trim";
}

export function isWithdrawn({ outcome }) {
  return outcome === "invalid";
}

export function firstAlertText(manoeuvre) {
  if (isWithdrawn(manoeuvre)) return "withdrawn";
  return manoeuvre.alerts.length ? secondsText(manoeuvre.alerts[0][0]) : "none";
}

export function leadText(manoeuvre, promised) {
  if (isWithdrawn(manoeuvre)) return "withdrawn";
  const { exceedance, lead, alerts } = manoeuvre;
  if (!exceedance) return "–";
  if (lead === null || lead === undefined) return alerts.length ? "none before it" : "no alert";
  const enough = lead >= promised - 1e-9;
  const ahead = manoeuvre.look_ahead
    ? `; up to ${figure(manoeuvre.look_ahead)} s less in flight, where samples wait for later ones`
    : "";
  return `${leadSeconds(lead, 2)} s, ${enough ? "at least" : "less than"} ${figure(promised)} s${ahead}`;
}
