/**
 * A seek in a flight: frames wait until the samples before that point have been read, so that the
 * strips are never empty.
 *
 * createSeekHistory(api, path, {n_samples, start, duration, seekable}) -> SeekHistory
 *   waits                     whether frames wait
 *   keep(frames, wall) -> bool     they wait; false once they have waited so long that they count as late
 *   readBefore(t) -> Promise<{before, frames} | null>     before: at most MOST source samples, oldest first;
 *                             frames: those that waited. Null where another seek overtook this one
 */

const MOST = 5000;
const PAGE = 10_000; // frames that the server sends at once
const READING = 1000; // ms that reading the source may take

export function createSeekHistory(api, path, { n_samples: samples, start, duration, seekable }) {
  const isOnePage = samples !== null && samples <= PAGE;
  let source = null; // all of it, where it is one page
  let waiting = null;
  let began = 0;
  let turn = 0;

  async function read(t) {
    if (isOnePage) return api.get(`${path}/source?first=0&last=${samples - 1}`);
    const index = Math.round(((t - start) / duration) * (samples - 1));
    return api.get(`${path}/source?first=${Math.max(0, index - MOST)}&last=${index}`);
  }

  async function framesBefore(t) {
    if (!seekable || t <= start) return [];
    try {
      const { frames } = source ?? (await read(t));
      if (isOnePage) source = { frames };
      const end = frames.findIndex((frame) => frame.t >= t - 1e-9);
      const before = end < 0 ? frames : frames.slice(0, end);
      return before.slice(-MOST).map(({ seq: _, ...frame }) => frame);
    } catch {
      return []; // the strips then begin at t
    }
  }

  async function readBefore(t) {
    const mine = ++turn;
    waiting = [];
    began = performance.now();
    const before = await framesBefore(t);
    if (mine !== turn) return null;
    const frames = waiting;
    waiting = null;
    return { before, frames };
  }

  return {
    get waits() {
      return waiting !== null;
    },
    keep: (frames, wall) => {
      waiting.push(...frames);
      return wall - began < READING;
    },
    readBefore,
    close: () => {
      turn += 1;
    },
  };
}
