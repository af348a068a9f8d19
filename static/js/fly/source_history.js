/**
 * Samples of a flight's source before a point that was sought, so that the strips are never empty.
 *
 * Exports
 *   createSourceHistory(api, path, transport) -> {before(t) -> Promise<frames>}
 *     path: of the flight.   transport: as hello says it.
 *     Frames before time t [s], oldest first, at most MOST; none where there are none to be had.
 */

const MOST = 5000;
const PAGE = 10_000; // frames that the server sends at once

export function createSourceHistory(api, path, { n_samples: samples, start, duration, seekable }) {
  const whole = samples !== null && samples <= PAGE;
  let kept = null;

  async function load(t) {
    if (whole) return api.get(`${path}/source?first=0&last=${samples - 1}`);
    const index = Math.round(((t - start) / duration) * (samples - 1));
    return api.get(`${path}/source?first=${Math.max(0, index - MOST)}&last=${index}`);
  }

  async function before(t) {
    if (!seekable || t <= start) return [];
    try {
      const { frames } = kept ?? (await load(t));
      if (whole) kept = { frames };
      const end = frames.findIndex((frame) => frame.t >= t - 1e-9);
      const found = end < 0 ? frames : frames.slice(0, end);
      return found.slice(-MOST).map(({ seq: _, ...frame }) => frame);
    } catch {
      return []; // the strips then begin at t
    }
  }

  return { before };
}
