/**
 * A scoring as the server has it, and as the page and its charts take it.
 *
 * Exports
 *   readScoring(api, recording, id) -> Promise<Scoring>, readScorings(api, recording) -> Promise<[Scoring]>
 *     what a monitor assessed of a recording, in the page's words: {request: {trim, manoeuvres},
 *     manoeuvres: [{name, start, end, outcome, alerts, exceedance, warningLead, ...}],
 *     outsideExceedances: [exceedance], ...}     exceedance: {t, channel, value} | null
 *   TRIM_SEGMENT              the trim that is the mean of a manoeuvre's trim segment
 *   scoringSource(api, scoring, offset) -> {load, start, end, dt, offset}
 *   stripOrder(channels) -> [key]     limited channels on top, then the others, the risk below
 */

import { limitedFirst } from "../../charts/strips.js";

export const TRIM_SEGMENT = "lead_in";
const MOST_BINS = 4000;

export async function readScoring(api, recording, id) {
  const path = `/recordings/${encodeURIComponent(recording)}/scorings/${encodeURIComponent(id)}`;
  return scoringOf(await api.get(path));
}

export async function readScorings(api, recording) {
  return (await api.get(`/recordings/${encodeURIComponent(recording)}/scorings`)).map(scoringOf);
}

/** The one place that knows what the server calls the parts of a scoring. */
function scoringOf({ stretches, outside, order, ...scoring }) {
  const manoeuvres = stretches.map(({ crossing, lead, ...manoeuvre }) => ({
    ...manoeuvre,
    exceedance: crossing,
    warningLead: lead,
  }));
  return { ...scoring, manoeuvres, outsideExceedances: outside ?? [], request: order };
}

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
