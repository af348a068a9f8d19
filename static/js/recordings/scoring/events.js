/**
 * Events of a scored recording, in order of time, and what a chart marks of it.
 *
 * createScoredEvents(events, visit) -> element     those of eventsOf as a list; visit({t, manoeuvre}): one was chosen
 * eventsOf(scoring) -> [{t, text, level, manoeuvre}]     manoeuvre: its number; undefined outside every manoeuvre
 * flagsOf(scoring)    exceedances in the values as recorded only.   limitsInForceOf(scoring): null without a limit set
 * withdrawnAt(manoeuvre) -> [s] or null
 * exceededIn(scoring) -> keys of the channels that exceeded a limit, in a manoeuvre or outside
 * manoeuvresOf(scoring, offset) -> [{start, end, withdrawn, silent}]     withdrawn: its time, or null
 * scoringStarts(scoring) -> [{t, from}]     of manoeuvres, not of a recording as a whole; see ../../fly/source/manoeuvre_starts.js
 */

import { secondsText } from "../../lib/clock.js";
import { h } from "../../lib/dom.js";
import { createEventList } from "../../lib/event_list.js";
import { magnitudeIn, quantity, riskText } from "../../lib/numbers.js";
import { STATE_WORDS } from "../../lib/states.js";
import { AS_RECORDED, LIMIT_IN_DOUBT, measuredBy } from "../words.js";

export function createScoredEvents(events, visit) {
  const list = h("section.event-panel", { "aria-label": "Events" });
  const log = createEventList(list, {
    go: (t) => visit(events.find((event) => event.t === t) ?? { t }),
    label: "Events in order of time",
    most: Infinity,
  });
  for (const event of [...events].reverse()) log.add(event);
  return list;
}

export function eventsOf(scoring) {
  const { manoeuvres, outside_exceedances: outside, channels, alert_above: alertAbove, limits_in_force: inForce } = scoring;
  return [
    ...(inForce ?? []).map(ofLimits),
    ...manoeuvres.flatMap((given, manoeuvre) => ofManoeuvre(given, channels, alertAbove).map((event) => ({ ...event, manoeuvre }))),
    ...outside.map((exceedance) => ofExceedance(exceedance, channels, " outside every manoeuvre")),
  ].sort((a, b) => a.t - b.t);
}

function ofLimits({ start, name, version, case: condition, limits, monitor_name: monitor, reason }) {
  if (monitor) return { t: start, text: `monitor in use: ${monitor}, ${condition}`, level: "" };
  if (monitor === "") return { t: start, text: `no monitor in use: ${reason}`, level: "caution" };
  const set = `${name} version ${version}`;
  const text = limits === null ? `limits unknown (${set})` : `limits in force: ${condition} (${set})`;
  return { t: start, text, level: limits === null ? "caution" : "" };
}

function ofExceedance({ t, channel, value, limit = null, doubt = "" }, channels, where = "") {
  const measured = measuredBy(channels, channel);
  const beside = limit === null ? "" : `, limit ${magnitudeIn(measured, limit)}`;
  const text = `${measured.symbol} exceeds its limit${where}: ${quantity(measured, value)}${beside}${doubt && `, ${doubt}`}`;
  return { t, text, level: "alert" };
}

function ofManoeuvre(manoeuvre, channels, alertAbove) {
  const { name, start, begins, alerts, exceedance, recorded_exceedance: raw, peak_t: peak, peak_risk: risk, validity, alert_above: own } = manoeuvre;
  const alertText = (from, to) => (to > from ? `alert until ${secondsText(to)}` : "alert, one sample");
  const withdrawn = withdrawnAt(manoeuvre);
  const isPeak = (validity.valid !== false || withdrawn === null) && Number.isFinite(peak) && peak > start;
  return [
    { t: begins ?? start, text: `${name} begins${begins > start ? ` (trim from ${secondsText(start)})` : ""}`, level: "" },
    withdrawn !== null && { t: withdrawn, text: `${name} is INVALID: risk withdrawn from here`, level: "caution" },
    ...alerts.map(([from, to]) => ({ t: from, text: alertText(from, to), level: "alert" })),
    exceedance && ofExceedance(exceedance, channels),
    raw && ofExceedance(raw, channels, raw.doubt ? " as recorded" : " as recorded, but not relative to trim"),
    isPeak && { t: peak, text: `peak risk of ${name}: ${riskText(risk, own ?? alertAbove)}`, level: "" },
  ].filter(Boolean);
}

/** When the risk was withdrawn; null where it was not, and where it was shown in flight. Limits not in force are marked on their own. */
export function withdrawnAt({ start, validity, withdrawn_t: t = start }) {
  return validity.valid === false ? t : null; // earlier versions do not know when
}

export function scoringStarts({ request, manoeuvres }) {
  return request.manoeuvres === "entire" ? [] : manoeuvres.map(({ start }) => ({ t: start, from: "trim" }));
}

export function flagsOf({ manoeuvres }) {
  const raw = manoeuvres.map(({ recorded_exceedance: exceedance }) => exceedance).filter(Boolean);
  return raw.map(({ t, channel, doubt }) => ({ key: channel, t, word: doubt ? LIMIT_IN_DOUBT : AS_RECORDED }));
}

export function exceededIn({ manoeuvres, outside_exceedances: outside }) {
  const all = [...manoeuvres.flatMap(({ exceedance, recorded_exceedance: raw }) => [exceedance, raw]), ...outside];
  return [...new Set(all.filter(Boolean).map(({ channel }) => channel))];
}

export function limitsInForceOf({ limits_in_force: inForce }, offset = 0) {
  return inForce?.map(({ start, end, limits }) => ({ start: start - offset, end: end - offset, limits })) ?? null;
}

export function manoeuvresOf({ manoeuvres }, offset = 0) {
  return manoeuvres.map((manoeuvre) => {
    const { start, end, limits_in_force: inForce = [] } = manoeuvre;
    const withdrawn = withdrawnAt(manoeuvre);
    return {
      start: start - offset,
      end: end - offset,
      withdrawn: withdrawn === null ? null : withdrawn - offset,
      silent: inForce
        .filter(({ reason }) => reason !== "")
        .map(({ start: from, end: to, limits }) => ({ start: from - offset, end: to - offset, word: wordOf(limits) })),
    };
  });
}

const wordOf = (limits) => (limits === null ? STATE_WORDS.limits_unknown : STATE_WORDS.not_applicable);

/** letter: of the scoring, where there are several. */
export function laneOf(manoeuvres, { row = 0, offset = 0, letter = "" } = {}) {
  return manoeuvres.map(({ name, start, end, verdict: { word, level, sign, text } }, k) => ({
    id: `${letter || "manoeuvre"}-${k}`,
    manoeuvre: k,
    row,
    start: start - offset,
    end: end - offset,
    text: `${letter && `${letter} `}${name}: ${word}`,
    short: `${k + 1}`,
    mark: sign,
    level,
    title: `${letter && `${letter}, `}${name}: ${word}, ${text}`,
  }));
}
