/** Words, levels and signs for recordings and scorings. */

import { secondsText } from "../lib/clock.js";
import { chip, formatted, guideLink, h, panel } from "../lib/dom.js";
import { figure, leadSeconds, quantity, riskText } from "../lib/numbers.js";
import { STATE_WORDS } from "../lib/states.js";
import { TRIM_SEGMENT } from "./scoring/source.js";

const MOST_NAMED = 6;
export const NO_CLOCK = "the file gives neither date nor clock for these times";

export const AS_RECORDED = "LIMIT AS RECORDED"; // an exceedance as recorded that is none relative to trim
export const LIMIT_IN_DOUBT = "LIMIT IN DOUBT"; // no aircraft reaches the value, or its trim is unknown

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

/** The server words the outcome of each manoeuvre; an exceedance comes first.   n: alike */
export function outcomeChip({ verdict: { sign, word, level, text } }, n = 1) {
  return chip(`${sign} ${n > 1 ? `${n} × ` : ""}${word}`, level, text);
}

export function measuredBy(channels, key) {
  return channels.find((channel) => channel.key === key) ?? { symbol: key };
}

function outsideText({ outside_exceedances: outside, channels }) {
  const parts = outside.map(({ t, channel, value, doubt = "" }) => {
    const measured = measuredBy(channels, channel);
    return `${measured.symbol} exceeds its limit outside every manoeuvre: ${quantity(measured, value)} at ${secondsText(t)}${doubt && `, ${doubt}`}`;
  });
  return parts.length ? `${parts.join("; ")}.` : "";
}

export function outsideChip(scoring) {
  const title = outsideText(scoring);
  return title ? chip("▲ LIMIT EXCEEDED OUTSIDE", "alert", title) : null;
}

export function outsideLine(scoring, tag, classes) {
  const words = outsideText(scoring);
  return words ? h(tag, { class: classes, role: "note" }, "◆ ", formatted(words)) : null;
}

export function validityWords({ validity: { valid, p_value: p }, outcome }) {
  const words = p == null ? "" : `p-value ${figure(p, 2)}`;
  if (valid === true && outcome === "unseen") return { word: "applicable where recorded", level: "caution", mark: "◇", words };
  if (valid === true) return { word: "applicable", level: "ok", mark: "✓", words };
  if (valid === false) return { word: STATE_WORDS.invalid, level: "off", mark: "✕", words };
  return { word: "unknown", level: "caution", mark: "◆", words };
}

const isWithdrawn = ({ outcome }) => outcome === "invalid";

export function peakText({ outcome, peak_risk: risk, peak_t: t, alert_above: own }, alertAbove, isTimed = false) {
  if (isWithdrawn({ outcome })) return STATE_WORDS.invalid;
  if (risk == null) return "–";
  return `${riskText(risk, own ?? alertAbove)}${isTimed && t !== null ? ` at ${secondsText(t)}` : ""}`;
}

/** Outcomes and rule of a scoring in one line.   who: facts of its monitor;   more: chips */
export function scoredSummary(scoring, who, more = null) {
  const counts = [...Map.groupBy(scoring.manoeuvres, ({ verdict }) => verdict.word).values()];
  return h(
    "div.row.scored-summary",
    counts.map(({ length: n, 0: first }) => outcomeChip(first, n)),
    outsideChip(scoring),
    more,
    who,
    h("span", formatted(alertRule(scoring))),
    h("span", h("span.dim", "warning lead time "), `${figure(scoring.lead)} s`),
    h("span", h("span.dim", "channels are "), formatted(trimText(scoring))),
  );
}

export function verdictPanel(scoring, verdicts, none) {
  const title = ["Outcome of each manoeuvre ", guideLink("what-the-numbers-mean#after-the-flight", "outcomes after the flight")];
  const beside = h("span.dim", formatted(`values are ${trimText(scoring)}`));
  return panel(title, scoring.manoeuvres.length ? verdicts.element : none, { beside, "aria-label": "Verdicts" });
}

export function alertRule({ epsilon, alert_above: above, request }) {
  if (request?.monitor_set) return "each monitor alerts at its own ε";
  if (Math.abs(above - epsilon) < 1e-9) return `alerts at risk above ε = ${figure(epsilon)}`;
  return `alerts at risk above ${figure(above)}, which keeps ε = ${figure(epsilon)} with 95 % confidence`;
}

export function requestWords({ trim, manoeuvres }) {
  const words = { detected: "manoeuvres detected", entire: "the entire recording" };
  const way = words[manoeuvres] ?? `${manoeuvres.length} marked by hand`;
  if (trim === TRIM_SEGMENT) return way;
  return `${way}, ${trim === null ? "no trim subtracted" : `trim of ${trim} s`}`;
}

function trimText({ request: { trim }, channels }) {
  if (trim === null) return "as recorded, no trim subtracted";
  const absolute = channels.filter(({ reference }) => reference === "absolute").map(({ symbol }) => symbol);
  if (absolute.length === 0) return "deviations from trim";
  if (absolute.length === channels.length) return "as recorded";
  const named = absolute.length > MOST_NAMED ? "those that are absolute" : absolute.join(", ");
  return `deviations from trim, ${named} as recorded`;
}

export function firstAlertText(manoeuvre) {
  if (isWithdrawn(manoeuvre)) return STATE_WORDS.invalid;
  return manoeuvre.alerts.length ? secondsText(manoeuvre.alerts[0][0]) : "none";
}

export function leadText(manoeuvre, promised) {
  if (isWithdrawn(manoeuvre)) return STATE_WORDS.invalid;
  const { exceedance, lead, alerts } = manoeuvre;
  if (!exceedance) return "–";
  if (lead == null) return alerts.length ? "none before it" : "no alert";
  const enough = lead >= promised - 1e-9;
  const { look_ahead: ahead } = manoeuvre;
  const less = ahead ? `; up to ${figure(ahead)} s less in flight, where samples wait for later ones` : "";
  return `${leadSeconds(lead, 2)} s, ${enough ? "at least" : "less than"} ${figure(promised)} s${less}`;
}
