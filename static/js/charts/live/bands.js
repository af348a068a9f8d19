/**
 * Bands of a flight's strips: gaps, alerts, and samples without an assessment.
 *
 * Exports
 *   bandsOf(frame, {newest, staleFor}) -> [{x0, x1, kind, word}]     in px, for strip_canvas.js
 *     newest: time of the newest sample [s], null before any.   staleFor: its age in words, or ""
 */

import { ALERT, INVALID, LIMITS_UNKNOWN, NOT_APPLICABLE, THINNED, UNASSESSED, WARMING_UP } from "./ring_buffer.js";

export function bandsOf(frame, { newest, staleFor }) {
  const { samplePx, visible } = frame;
  const end = newest === null ? 0 : frame.x(newest) + samplePx;
  const now = Math.max(end, frame.x(frame.now));
  const named = (runs, kind, word) => runs.map((run) => ({ ...run, kind, word }));
  const bands = [
    ...named(visible.gaps(samplePx), "gap", "GAP"),
    ...named(visible.gaps(samplePx, THINNED), "thinned", "SKIPPED"),
    ...named(visible.runs(WARMING_UP, samplePx, now), "warming", "WARMING UP"),
    ...named(visible.runs(UNASSESSED, samplePx, now), "unassessed", "NOT ASSESSED"),
    ...named(visible.runs(INVALID, samplePx, now), "invalid", "INVALID"),
    ...named(visible.runs(NOT_APPLICABLE, samplePx, now), "invalid", "NOT APPLICABLE"),
    ...named(visible.runs(LIMITS_UNKNOWN, samplePx, now), "invalid", "LIMITS UNKNOWN"),
    ...named(visible.runs(ALERT, samplePx, now), "alert", "ALERT"),
  ];
  if (newest === null) bands.push({ x0: 0, x1: frame.width, kind: "stale", word: "NO DATA" });
  else if (staleFor) {
    const x1 = Math.max(now, end + 2);
    bands.push({ x0: end, x1, kind: "stale", word: `STALE ${staleFor}` });
  }
  return bands;
}
