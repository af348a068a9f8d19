/**
 * The strips of a chart, from top to bottom.
 *
 * Exports
 *   stripOf(key, channels, axes) -> {...channel, limit, risk, axis}     key of a channel, or "risk"
 *     axes: {riskScale "sqrt", narrowAfter}     see value_axis.js
 *   limitedFirst(channels) -> {limited: [key], others: [key]}
 */

import { shownIn } from "../lib/units.js";
import { createRiskAxis, createValueAxis } from "./value_axis.js";

const RISK = { key: "risk", symbol: "risk", unit: "", label: "higher is worse", limit: null };

export function stripOf(key, channels, { riskScale = "sqrt", narrowAfter } = {}) {
  const risk = key === "risk";
  const channel = risk ? RISK : channels.find((candidate) => candidate.key === key);
  if (channel === undefined) throw new Error(`strip ${key} is not a channel of this flight`);
  const limit = channel.limit ?? null;
  const axis = risk ? createRiskAxis(riskScale) : createValueAxis({ limit, factor: shownIn(channel).factor, narrowAfter });
  return { ...channel, limit, risk, axis };
}

export function limitedFirst(channels) {
  const isLimited = ({ limit }) => limit !== null && limit !== undefined;
  const keysOf = (chosen) => chosen.map(({ key }) => key);
  return {
    limited: keysOf(channels.filter(isLimited)),
    others: keysOf(channels.filter((channel) => !isLimited(channel))),
  };
}
