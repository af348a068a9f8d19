/**
 * Scorings of a recording, and their samples for charts.
 *
 * Scoring: {request: {trim, manoeuvres}, manoeuvres: [{name, start, end, outcome, alerts, exceedance, lead, ...}],
 *     outside_exceedances: [exceedance], ...}     exceedance: {t, channel, value} | null;   lead [s] | null
 */

export const TRIM_SEGMENT = "trim_segment";
const MOST_BINS = 4000;

export function readScoring(api, recording, id) {
  return api.get(`/recordings/${encodeURIComponent(recording)}/scorings/${encodeURIComponent(id)}`);
}

export function scoringSource(api, scoring, offset = 0) {
  return tileSource(api, `/recordings/${scoring.recording}/scorings/${scoring.id}/tiles?`, scoring, offset);
}

/** path: of the tiles, with a query that goes on */
export function tileSource(api, path, { start, end, dt }, offset = 0) {
  return {
    start: start - offset,
    end: Math.max(end, start + dt) - offset,
    dt,
    offset,
    load: (from, to, bins) => api.get(`${path}start=${from}&end=${to}&bins=${Math.min(bins, MOST_BINS)}`),
  };
}
