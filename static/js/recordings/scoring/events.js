/**
 * Events of a scored recording, in order of time.
 *
 * Exports
 *   eventsOf(scoring) -> [{t, text, level, manoeuvre}]     manoeuvre: its number;
 *       undefined outside every manoeuvre
 *   flagsOf(scoring) -> [{key, t, word}]    exceedances in the values as recorded only, as a chart marks them
 *   limitsInForceOf(scoring, offset) -> [{start, end, limits}]    for a chart; null without a limit set
 *   manoeuvresOf(scoring, offset) -> [{start, end, withdrawn, silent}]    for a chart; withdrawn: its time, or null
 *   laneOf(manoeuvres, {row, offset, id}) -> [item]       for a chart's lane
 */

import { STATE_WORDS } from "../../lib/states.js";
import { riskText, secondsText } from "../../lib/numbers.js";
import { magnitudeIn, quantity } from "../../lib/units.js";
import { AS_RECORDED, verdictOf } from "../words.js";

export function eventsOf({ manoeuvres, outside_exceedances: outside, channels, alert_above: alertAbove, limits_in_force: inForce }) {
  return [
    ...(inForce ?? []).map(ofLimits),
    ...manoeuvres.flatMap((manoeuvre, k) => ofManoeuvre(manoeuvre, k, channels, alertAbove)),
    ...outside.map((exceedance) =>
      ofExceedance(exceedance, channels, " outside every manoeuvre"),
    ),
  ].sort((a, b) => a.t - b.t);
}

function ofLimits({ start, name, version, case: condition, limits }) {
  const set = `${name} version ${version}`;
  const text = limits === null ? `limits unknown (${set})` : `limits in force: ${condition} (${set})`;
  return { t: start, text, level: limits === null ? "caution" : "" };
}

function ofExceedance({ t, channel, value, limit = null }, channels, where = "") {
  const measured = channels.find(({ key }) => key === channel) ?? { symbol: channel };
  const beside = limit === null ? "" : `, limit ${magnitudeIn(measured, limit)}`;
  const words = `${quantity(measured, value)}${beside}`;
  return { t, text: `${measured.symbol} exceeds its limit${where}: ${words}`, level: "caution" };
}

function ofManoeuvre(
  { name, start, alerts, exceedance, recorded_exceedance: raw, peak_t: t, peak_risk: risk, validity, withdrawn_t: withdrawn, limits_in_force: inForce = [] },
  manoeuvre,
  channels,
  alertAbove,
) {
  const events = [{ t: start, text: `${name} begins`, level: "", manoeuvre }];
  if (validity.valid === false && (withdrawn !== null || inForce.length === 0)) {
    events.push({
      t: withdrawn ?? start,
      text: `${name} is INVALID: risk withdrawn from here`,
      level: "caution",
      manoeuvre,
    });
  }
  for (const [from, to] of alerts) {
    events.push({
      t: from,
      text: to > from ? `alert until ${secondsText(to)}` : "alert, one sample",
      level: "alert",
      manoeuvre,
    });
  }
  if (exceedance) {
    events.push({ ...ofExceedance(exceedance, channels), manoeuvre });
  }
  if (raw) {
    events.push({ ...ofExceedance(raw, channels, " as recorded, but not relative to trim"), manoeuvre });
  }
  if (validity.valid !== false && Number.isFinite(t) && t > start) {
    events.push({
      t,
      text: `peak risk of ${name}: ${riskText(risk, alertAbove)}`,
      level: "",
      manoeuvre,
    });
  }
  return events;
}

export function flagsOf({ manoeuvres }) {
  const raw = manoeuvres.map(({ recorded_exceedance: exceedance }) => exceedance).filter(Boolean);
  return raw.map(({ t, channel }) => ({ key: channel, t, word: AS_RECORDED }));
}

export function limitsInForceOf({ limits_in_force: inForce }, offset = 0) {
  return inForce?.map(({ start, end, limits }) => ({ start: start - offset, end: end - offset, limits })) ?? null;
}

export function manoeuvresOf({ manoeuvres }, offset = 0) {
  return manoeuvres.map(({ start, end, validity, withdrawn_t: withdrawn, limits_in_force: inForce = [] }) => ({
    start: start - offset,
    end: end - offset,
    withdrawn: validity.valid === false && (withdrawn !== null || inForce.length === 0) ? (withdrawn ?? start) - offset : null,
    silent: inForce.filter(({ reason }) => reason !== "").map(({ start: from, end: to, limits }) => ({ start: from - offset, end: to - offset, word: wordOf(limits) })),
  }));
}

const wordOf = (limits) => (limits === null ? STATE_WORDS.limits_unknown : STATE_WORDS.not_applicable);

export function laneOf(manoeuvres, { row = 0, offset = 0, id = "manoeuvre" } = {}) {
  return manoeuvres.map((manoeuvre, k) => {
    const { name, start, end } = manoeuvre;
    const { word, level, mark, text } = verdictOf(manoeuvre);
    return {
      id: `${id}-${k}`,
      manoeuvre: k,
      row,
      start: start - offset,
      end: end - offset,
      text: `${name}: ${word}`,
      short: `${k + 1}`,
      mark,
      level,
      title: `${name}: ${word}, ${text}`,
    };
  });
}
