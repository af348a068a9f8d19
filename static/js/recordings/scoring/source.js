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

export function scoringSource(api, { recording, id, start, end, dt }, offset = 0) {
  const path = `/recordings/${recording}/scorings/${id}/tiles`;
  return {
    start: start - offset,
    end: Math.max(end, start + dt) - offset,
    dt,
    offset,
    load: (from, to, bins) => api.get(`${path}?start=${from}&end=${to}&bins=${Math.min(bins, MOST_BINS)}`),
  };
}
