/**
 * What a strip shows: a channel or the risk, its limits and its value axis.
 *
 * A channel is {key, symbol, unit, label, limits: [low, high] | null} and how people read it, see
 * ../lib/numbers.js; `limit` is short for limits of -limit and +limit. Either end may be infinite.
 *
 * stripOf(key, channels, {narrowAfter}) -> Strip     the channel, and
 *     limits [low, high] | null  in force now, or always;   risk, axis
 *     held [{from, to, limits}] | null  limits of samples with from < t <= to [s], where they changed
 *     forecast  key of the forecast's series, or null
 * holdsOf(strip) -> held, of one entry where the limits never changed
 * isBeyond(limits, low, high = low) -> [below, above]     the limit itself counts
 * widest([limits]) -> limits that hold all
 */

import { magnitude, magnitudeIn, shownIn } from "../lib/numbers.js";
import { createRiskAxis, createValueAxis } from "./value_axis.js";

const RISK = { key: "risk", symbol: "risk", unit: "", label: "higher is worse" };

export function stripOf(key, channels, { narrowAfter } = {}) {
  const risk = key === "risk";
  const channel = risk ? RISK : channels.find((candidate) => candidate.key === key);
  if (channel === undefined) throw new Error(`strip ${key} is not a channel of this flight`);
  const limits = limitsOf(channel);
  const { factor } = shownIn(channel);
  const axis = risk ? createRiskAxis() : createValueAxis({ limits, factor, narrowAfter });
  return { ...channel, limits, held: null, forecast: null, risk, axis };
}

export function limitsOf({ limits, limit }) {
  return limits ?? bothSides(limit ?? null);
}

export function limitsByKey(given, key) {
  return bothSides(given?.[key] ?? null);
}

function bothSides(limit) {
  return limit === null ? null : [-limit, limit];
}

export function holdsOf({ held, limits }) {
  return held ?? [{ from: -Infinity, to: Infinity, limits }];
}

export function isBeyond([least, greatest], low, high = low) {
  return [low <= least, high >= greatest];
}

export function widest(all) {
  const known = all.filter((limits) => limits !== null);
  if (known.length === 0) return null;
  return [Math.min(...known.map(([low]) => low)), Math.max(...known.map(([, high]) => high))];
}

export function limitText(strip, [low, high]) {
  if (low === -high) return `±${magnitudeIn(strip, high)}`;
  if (low === -Infinity) return `at most ${magnitudeIn(strip, high)}`;
  if (high === Infinity) return `at least ${magnitudeIn(strip, low)}`;
  return `${magnitude(strip, low)} to ${magnitudeIn(strip, high)}`;
}

export function limitedFirst(channels) {
  const isLimited = (channel) => limitsOf(channel) !== null;
  const keysOf = (chosen) => chosen.map(({ key }) => key);
  return {
    limited: keysOf(channels.filter(isLimited)),
    others: keysOf(channels.filter((channel) => !isLimited(channel))),
  };
}
