/**
 * A scoring as a chart takes it.
 *
 * Exports
 *   scoringSource(api, scoring, offset) -> {load, start, end, dt, offset}
 *   stripOrder(channels) -> [key]     limited channels on top, then the others, the risk below
 */

import { limitedFirst } from "../../charts/strips.js";

const MOST_BINS = 4000;

export function scoringSource(api, { recording, id, start, end, dt }, offset = 0) {
  const path = `/recordings/${recording}/scorings/${id}/tiles`;
  return {
    start: start - offset,
    end: Math.max(end, start + dt) - offset,
    dt,
    offset,
    load: (from, to, bins) =>
      api.get(`${path}?start=${from}&end=${to}&bins=${Math.min(bins, MOST_BINS)}`),
  };
}

export function stripOrder(channels) {
  const { limited, others } = limitedFirst(channels);
  return [...limited, "risk", ...others];
}
