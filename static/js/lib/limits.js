/**
 * Limits of channels: [low, high] in a channel's own unit, either end infinite where there is none; null for no limits.
 *
 * A channel has them as the server publishes it: `low`, `high`, each null for none, and `rest`, its value in trimmed
 * flight. `limit` alone is short for -limit and +limit. By key, a monitor or a flight has a magnitude or {low, high, rest}.
 *
 * limitsOf(channel), limitsByKey(given, key) -> limits
 * withLimits(channels, given) -> channels with the limits by key in place of their own
 * isLimited(channel)
 * isBeyond(limits, low, high = low) -> [below, above]     the limit itself counts
 * widest([limits]) -> limits that hold all
 * marginOf(limits, rest, low, high = low) -> [least, greatest] share of the way from rest to the nearest limit: 1 at it
 * limitText(channel, limits)     "±0.5 g", "−1.4 to 4.9 g", "at most 4.9 g"
 * limitsInWords(channels)        "|N_y| 0.5 g or N_z −1.4 to 4.9 g", of the limited ones; empty for none
 * exceededWords(channels)        "|N_y| 0.5 g or N_z −1.4 or 4.9 g": the values that a warning comes before
 */

import { magnitude, magnitudeIn } from "./numbers.js";

const MOST_NAMED = 4; // channels in a sentence

/** @returns {any} [low, high], or null without limits */
export function limitsOf({ low = null, high = null, limit = null }) {
  return low === null && high === null ? bothSides(limit) : sides(low, high);
}

export function limitsByKey(given, key) {
  const known = given?.[key] ?? null;
  return known !== null && typeof known === "object" ? limitsOf(known) : bothSides(known);
}

const sides = (low, high) => [low ?? -Infinity, high ?? Infinity];

const bothSides = (limit) => (limit === null ? null : [-limit, limit]);

export const isLimited = (channel) => limitsOf(channel) !== null;

export function withLimits(channels, given) {
  return channels.map((channel) => {
    const limits = limitsByKey(given, channel.key);
    const [low, high] = (limits ?? [null, null]).map((end) => (Number.isFinite(end) ? end : null));
    return { ...channel, low, high, limit: low !== null && low === -high ? high : null, rest: given?.[channel.key]?.rest ?? channel.rest ?? 0 };
  });
}

/** @param {number[]} limits */
export function isBeyond([least, greatest], low, high = low) {
  return [low <= least, high >= greatest];
}

export function widest(all) {
  const known = all.filter((limits) => limits !== null);
  if (known.length === 0) return null;
  return [Math.min(...known.map(([low]) => low)), Math.max(...known.map(([, high]) => high))];
}

export function marginOf([least, greatest], rest, low, high = low) {
  const at = (value) => Math.max((value - rest) / (greatest - rest), (rest - value) / (rest - least));
  return [at(Math.min(Math.max(rest, low), high)), Math.max(at(low), at(high))];
}

export function limitText(channel, [low, high]) {
  if (low === -high) return `±${magnitudeIn(channel, high)}`;
  if (low === -Infinity) return `at most ${magnitudeIn(channel, high)}`;
  if (high === Infinity) return `at least ${magnitudeIn(channel, low)}`;
  return `${magnitude(channel, low)} to ${magnitudeIn(channel, high)}`;
}

export const limitsInWords = (channels) => inWords(channels, limitText);

export const exceededWords = (channels) => inWords(channels, endsText);

function endsText(channel, limits) {
  const [first, ...more] = limits.filter(Number.isFinite);
  return more.length ? `${magnitude(channel, first)} or ${magnitudeIn(channel, more[0])}` : magnitudeIn(channel, first);
}

function inWords(channels, text) {
  const limited = channels.filter(isLimited);
  const named = limited.length > MOST_NAMED ? limited.slice(0, MOST_NAMED - 1) : limited;
  const words = named.map((channel) => {
    const limits = limitsOf(channel);
    const isSymmetric = limits[0] === -limits[1];
    return isSymmetric ? `|${channel.symbol}| ${magnitudeIn(channel, limits[1])}` : `${channel.symbol} ${text(channel, limits)}`;
  });
  const others = limited.length - named.length;
  return [...words, ...(others ? [`${others} more`] : [])].join(" or ");
}
