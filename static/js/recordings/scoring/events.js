/**
 * What happened in a scored recording, in the order of its time.
 *
 * Exports
 *   eventsOf(scoring) -> [{t, text, level, manoeuvre}]     manoeuvre: its number;
 *       none outside of every manoeuvre
 *   flagsOf(scoring) -> [{key, t, word}]    exceedances as recorded alone, as a chart marks them
 *   heldOf(scoring, offset) -> [{start, end, limits}]    limits in force, as a chart takes them; null without a limit set
 *   manoeuvresOf(scoring, offset) -> [{start, end, withdrawn, silent}]    as a chart takes them; withdrawn: from when on, or null
 *   laneOf(manoeuvres, {row, offset, id}) -> [item]       for a chart's lane
 */

import { STATE_WORDS } from "../../charts/readout.js";
import { riskText, secondsText } from "../../lib/numbers.js";
import { magnitudeIn, quantity } from "../../lib/units.js";
import { AS_RECORDED, verdictOf } from "../words.js";

export function eventsOf({ manoeuvres, outside_exceedances: outside, channels, alert_above: alertAbove, limits_in_force: held }) {
  return [
    ...(held ?? []).map(ofLimits),
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
  { name, start, alerts, exceedance, recorded_exceedance: raw, peak_t: t, peak_risk: risk, validity, withdrawn_t: withdrawn, limits_in_force: held = [] },
  manoeuvre,
  channels,
  alertAbove,
) {
  const events = [{ t: start, text: `${name} begins`, level: "", manoeuvre }];
  if (validity.valid === false && (withdrawn !== null || held.length === 0)) {
    events.push({
      t: withdrawn ?? start,
      text: `${name} is INVALID: the risk is withdrawn from here on`,
      level: "caution",
      manoeuvre,
    });
  }
  for (const [from, to] of alerts) {
    events.push({
      t: from,
      text: to > from ? `alert, until ${secondsText(to)}` : "alert, a single sample",
      level: "alert",
      manoeuvre,
    });
  }
  if (exceedance) {
    events.push({ ...ofExceedance(exceedance, channels), manoeuvre });
  }
  if (raw) {
    events.push({ ...ofExceedance(raw, channels, " as recorded, not from trim"), manoeuvre });
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
  const raw = manoeuvres.map(({ recorded_exceedance: found }) => found).filter(Boolean);
  return raw.map(({ t, channel }) => ({ key: channel, t, word: AS_RECORDED }));
}

export function heldOf({ limits_in_force: held }, offset = 0) {
  return held?.map(({ start, end, limits }) => ({ start: start - offset, end: end - offset, limits })) ?? null;
}

export function manoeuvresOf({ manoeuvres }, offset = 0) {
  return manoeuvres.map(({ start, end, validity, withdrawn_t: withdrawn, limits_in_force: held = [] }) => ({
    start: start - offset,
    end: end - offset,
    withdrawn: validity.valid === false && (withdrawn !== null || held.length === 0) ? (withdrawn ?? start) - offset : null,
    silent: held.filter(({ reason }) => reason !== "").map((one) => ({ start: one.start - offset, end: one.end - offset, word: wordOf(one) })),
  }));
}

const wordOf = ({ limits }) => (limits === null ? STATE_WORDS.limits_unknown : STATE_WORDS.not_applicable);

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
