/**
 * The headline of a flight: its worst condition, as the server decided it.
 *
 * The browser adds only that no samples arrive any more, in the same order of severity.
 *
 * headlineOf({status, level, beside, exceeded_t, exceeded_as_recorded, verdict}, {stale, alarms, blank}) -> Headline
 *     stale: no samples arrive.   alarms: number of unacknowledged warnings
 *     blank: no sample is shown yet by this page: the headline must not look calm
 *     headline.call: in force, see ./alarms/flight_markers.js; its word comes first, the condition beside it
 * levelOf(headline)              data-level, of the condition or the call
 * partsOf(headline, cause)       ["▲ ALARM", "STALE · EXCEEDED first at 8.76 s"], without what is empty
 * exceededAt(headline)           "EXCEEDED first at 8.76 s as recorded", also after a seek to before it; empty without an exceedance
 * textOf(headline, cause)        "▲ ALARM · STALE · EXCEEDED first at 8.76 s"
 * resultOf(flight) -> {words, parts, level}     its verdict, else its headline; parts: as a short state and what is beside it;
 *     data-level
 * staleText(cause, age)          why it is stale, and the age of the newest sample [s], NaN if unknown
 */

import { secondsText } from "../lib/clock.js";
import { shownState, STATE_WORDS, withdrawnWord } from "../lib/states.js";

const WORST_FIRST = ["exceeding", "alarm", "risk", "stale", "invalid", "caution", "paused", "no_data", "warming_up", "not_assessed", "not_calibrated", "exceeded", "no_alert", "ok"];
const NOW = ["exceeding", "risk"]; // need a current sample
const CALM = ["none", "advisory"];
const BESIDE = ["stale", "invalid", "paused"]; // always shown

export const LEVEL_OF = { warning: "alert", caution: "caution", advisory: "advisory", none: "ok" };
const MARKS = { warning: "▲ ", caution: "◆ ", advisory: "", none: "✓ " };
const LEVELS = { exceeding: "warning", alarm: "warning", risk: "warning", stale: "caution", invalid: "caution", caution: "caution" };

export function headlineOf(server, { stale, alarms, blank = false }) {
  if (!stale && alarms > 0 && WORST_FIRST.indexOf(server.status) > WORST_FIRST.indexOf("alarm"))
    return { ...server, status: "alarm", level: LEVELS.alarm }; // it came before the server's headline
  if (!stale) return blank && CALM.includes(server.level) ? { ...server, status: "no_data", level: "advisory" } : server;
  const known = [server.status, ...server.beside].filter((status) => !NOW.includes(status));
  const holds = [...known, "stale", ...(alarms > 0 ? ["alarm"] : [])];
  const status = WORST_FIRST.find((each) => holds.includes(each));
  const beside = BESIDE.filter((each) => each !== status && holds.includes(each));
  return { ...server, status, level: LEVELS[status], beside };
}

export function isStale(headline) {
  return headline !== null && [headline.status, ...headline.beside].includes("stale");
}

export function staleText(cause, age) {
  const old = Number.isFinite(age) ? [`the newest is ${age.toFixed(1)} s old`] : [];
  return [cause || "no new sample", ...old].join("; ");
}

/** Of a call in force: when, and by whom. */
export const aboutCall = ({ t, by }) => `at ${secondsText(t)}, by ${by}`;

export function resultOf({ verdict, progress, cause, call = null, ...headline }) {
  const { level } = headline;
  const result = (parts, level) => ({ words: parts.join(" · "), parts, level });
  if (!verdict && level === "none" && progress !== "running") return result([progress.toUpperCase()], "off");
  const called = call && { ...call, about: aboutCall(call) };
  if (!verdict || progress === "running") return result(partsOf({ ...headline, verdict, call: called }, cause), levelOf({ level, call }));
  const isMissing = verdict.exceeded_t === null;
  const shown = level === "warning" || isMissing ? level : "caution";
  const state = isMissing ? partsOf(headline, cause)[0] : MARKS[shown] + STATE_WORDS.exceeded;
  const withdrawn = withdrawnWords([headline.status, ...headline.beside], cause).filter((word) => !`${state} ${verdict.text}`.includes(word));
  const text = [verdict.text, ...withdrawn].join(" · ");
  return { words: isMissing ? `${state} · ${text}` : MARKS[shown] + text, parts: [state, text], level: LEVEL_OF[shown] };
}

/** Of an ended flight; between manoeuvres nothing was withdrawn. */
function withdrawnWords(statuses, cause) {
  const isWithdrawn = (each) => ["stale", "invalid"].includes(each) && shownState({ state: each, cause }) !== "not_assessed";
  return statuses.filter(isWithdrawn).map((each) => wordOf(each, cause));
}

function wordOf(status, cause = null) {
  const withdrawn = status === "invalid" ? withdrawnWord(cause) : null;
  return withdrawn ?? STATE_WORDS[shownState({ state: status, cause })];
}

function besideOf(headline, cause = null) {
  const { status, beside, verdict } = headline;
  const exceeded = status !== "exceeding" && status !== "exceeded";
  const words = [...beside.map((status) => wordOf(status, cause)), [status, ...beside].includes("no_alert") && "exceedance predicted", exceeded && exceededAt(headline), verdict?.warning];
  return words.filter(Boolean).join(" · ");
}

export function textOf(headline, cause = null) {
  return partsOf(headline, cause).join(" · ");
}

export function partsOf(headline, cause = null) {
  const { level, call = null } = headline;
  const parts = [MARKS[level] + worstOf(headline, cause), besideOf(headline, cause)].filter(Boolean);
  return call === null ? parts : [MARKS[call.level] + call.word, [call.about, ...(level === "none" ? [] : parts)].join(" · ")];
}

export function levelOf({ level, call = null }) {
  return LEVEL_OF[call === null || level === "warning" ? level : call.level];
}

function worstOf(headline, cause = null) {
  return (headline.status === "exceeded" && exceededAt(headline)) || wordOf(headline.status, cause);
}

export function exceededAt({ exceeded_t: t, exceeded_as_recorded: isRecorded }) {
  return Number.isFinite(t) ? `${STATE_WORDS.exceeded} first at ${secondsText(t)}${isRecorded ? " as recorded" : ""}` : "";
}
