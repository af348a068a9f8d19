/**
 * What a strip shows: a channel, the risk, or the margin to the nearest limit; its limits and its value axis.
 *
 * Channels are as the server publishes them, see ../lib/limits.js and ../lib/numbers.js.
 *
 * stripOf(key, channels, {narrowAfter, spare}) -> Strip     the channel, and
 *     limits [low, high] | null  in force now, or always;   risk, axis
 *     held [{from, to, limits}] | null  limits of samples with from < t <= to [s], where they changed
 *     forecast  key of the forecast's series, or null
 * isSummary(strip)     whether it is the risk or the margin, not a channel
 * holdsOf(strip) -> held, of one entry where the limits never changed
 * limitsAt(strip, t) -> [low, high] | null    at t [s]
 * hasMargin(channels)     whether MARGIN adds to the limited channel's strip
 * marginAt(strips, t, read) -> {low, high, nearest}     of samples at t [s] whose values lie in read(strip) -> {low, high};
 *     nearest: the strip whose limit is nearest.   NaN where a limited channel has no value, or no limit is known
 * single(value) -> {low, high}     of one sample
 * limitedFirst(channels) -> {limited, others}     keys
 * arranged(strips) -> strips from top to bottom, each with
 *     hasLegend: whether it has the words that hold for all;   isTall, fold: {group, isOpen} | null     among many channels those without a limit are folded by group
 */

import { isLimited, limitsOf, marginOf } from "../lib/limits.js";
import { shownIn } from "../lib/numbers.js";
import { createRiskAxis, createValueAxis } from "./value_axis.js";

export const MARGIN = "limit margin";
const MOST_TALL = 4;
const MOST_OPEN = 8; // strips of channels
const RISK = { key: "risk", symbol: "risk", unit: "", label: "higher is worse" };
const OF_LIMITS = { key: MARGIN, symbol: "margin", unit: "", label: "1 at the nearest limit", low: null, high: 1, ...shownAs("", 2) };
const ROLES = ["control", "output", "condition"]; // in the order in which their groups are shown
const GROUPS = { control: "controls", output: "responses", condition: "flight condition" };

function shownAs(unit, decimals) {
  return { display_unit: unit, display_factor: 1, display_decimals: decimals };
}

export function stripOf(key, channels, { narrowAfter = undefined, spare = undefined } = {}) {
  const risk = key === RISK.key;
  const channel = risk ? RISK : key === MARGIN ? OF_LIMITS : channels.find((candidate) => candidate.key === key);
  if (channel === undefined) throw new Error(`strip ${key} is not a channel of this flight`);
  const limits = limitsOf(channel);
  const { factor } = shownIn(channel);
  const axis = risk ? createRiskAxis() : createValueAxis({ limits, factor, narrowAfter, spare, isAbsolute: channel.reference === "absolute" });
  return { ...channel, limits, held: null, forecast: null, beside: null, risk, axis };
}

export const isSummary = ({ key, risk }) => risk || key === MARGIN;

export function holdsOf({ held, limits }) {
  return held ?? [{ from: -Infinity, to: Infinity, limits }];
}

export function hasMargin(channels) {
  const limited = channels.map(limitsOf).filter((limits) => limits !== null);
  return limited.length > 1 || limited.flat().some((end) => !Number.isFinite(end));
}

export function marginAt(strips, t, read) {
  const margin = { low: NaN, high: NaN, nearest: null };
  for (const strip of strips) {
    const limits = isSummary(strip) ? null : limitsAt(strip, t);
    if (limits === null) continue;
    const { low, high } = read(strip);
    const [least, greatest] = marginOf(limits, strip.rest ?? 0, low, high);
    if (!Number.isFinite(greatest)) return { low: NaN, high: NaN, nearest: null };
    if (!(greatest <= margin.high)) Object.assign(margin, { high: greatest, nearest: strip });
    if (!(least <= margin.low)) margin.low = least;
  }
  return margin;
}

export const single = (value) => ({ low: value, high: value });

export function limitsAt({ held, limits }, t) {
  return held === null ? limits : (held.find(({ from, to }) => t > from && t <= to)?.limits ?? null);
}

export function limitedFirst(channels) {
  const keysOf = (chosen) => chosen.map(({ key }) => key);
  return {
    limited: keysOf(channels.filter(isLimited)),
    others: keysOf(channels.filter((channel) => !isLimited(channel))),
  };
}

export function arranged(strips) {
  const summaries = strips.filter(isSummary);
  const channels = strips.filter((strip) => !isSummary(strip));
  const limited = channels.filter(({ limits }) => limits !== null);
  const tall = limited.slice(0, MOST_TALL);
  const legend = channels.find(({ limits }) => limits === null) ?? channels[0]; // no exceedance covers the words there
  const shaped = (strip, fold = null) => Object.assign(strip, { isTall: strip.risk || tall.includes(strip), hasLegend: strip === legend, fold });
  if (channels.length <= MOST_OPEN) return strips.map((strip) => shaped(strip));
  const first = limited.slice(0, MOST_OPEN);
  const groups = grouped(channels.filter((strip) => !first.includes(strip)));
  let open = first.length;
  const folded = groups.flatMap(([group, members]) => {
    const isOpen = open + members.length <= MOST_OPEN;
    if (isOpen) open += members.length;
    return members.map((strip) => shaped(strip, { group, isOpen }));
  });
  return [...first, ...summaries].map((strip) => shaped(strip)).concat(folded);
}

/** [[name, strips]]: those with a control first, then those with an output. */
function grouped(strips) {
  const groups = Map.groupBy(strips, ({ group, role }) => group || (GROUPS[role] ?? "channels"));
  const rank = ([, members]) => Math.min(...members.map(({ role }) => ROLES.indexOf(role)));
  return [...groups].sort((a, b) => rank(a) - rank(b));
}
