/**
 * The samples of the ring buffer in the window, cell by cell, once a frame for all strips.
 *
 * A cell is one sample while there is room for every sample, else one pixel column with all of its
 * samples. Columns are counted from time zero, so that a trace moves without shimmering.
 *
 * Exports
 *   createVisibleSamples() -> VisibleSamples
 *     scan(ring, start, step, columns, before)   fills the fields; start [s] is the left edge, step
 *       [s] a pixel; `before` columns left of the edge are scanned too (for forecasts)
 *     n; x, from, to, flags (typed arrays, n used): place [px], samples from..to-1, flags or-ed
 *     sparse   whether cells are single samples
 *     runs(flag, samplePx, now) -> [{x0, x1}]    runs of cells with the flag
 *     gaps(samplePx, flag GAP) -> [{x0, x1}]     before the cells with it: where samples are missing
 */

import { BROKEN, GAP } from "./ring_buffer.js";

const DENSITY = 1; // samples a pixel up to which every sample is drawn

export function createVisibleSamples() {
  const visible = { n: 0, sparse: true, scan, runs, gaps };
  let capacity = 0;
  let anyFlags = 0;

  function reserve(cells) {
    if (cells <= capacity) return;
    capacity = Math.ceil(cells * 1.25);
    visible.x = new Float32Array(capacity);
    visible.from = new Int32Array(capacity);
    visible.to = new Int32Array(capacity);
    visible.flags = new Uint8Array(capacity);
  }

  function scan(ring, start, step, columns, before) {
    reserve(Math.ceil(DENSITY * (columns + before)) + 8);
    const from = Math.max(ring.first(), ring.after(start - before * step) - 1);
    const to = Math.min(ring.count(), ring.after(start + columns * step, from) + 1);
    visible.n = 0;
    visible.sparse = to - from <= DENSITY * (columns + before);
    anyFlags = ring.flags(from, to);
    if (visible.sparse) {
      for (let i = from; i < to; i++) add(ring, (ring.time(i) - start) / step, i, i + 1);
      return;
    }
    let i = ring.after(start - before * step, from);
    for (let k = -before; k < columns && i < to; k++) {
      const end = ring.after(start + (k + 1) * step, i);
      if (end > i) add(ring, k + 0.5, i, end);
      i = end;
    }
  }

  function add(ring, x, from, to) {
    const n = visible.n++;
    visible.x[n] = x;
    visible.from[n] = from;
    visible.to[n] = to;
    visible.flags[n] = anyFlags === 0 ? 0 : ring.flags(from, to);
  }

  /** Where the samples of cell i end: at the next cell, or a sample's length on where samples are missing. */
  function endOf(i, samplePx) {
    const own = visible.x[i] + Math.max(samplePx, visible.sparse ? 0 : 1);
    const last = i + 1 >= visible.n || (visible.flags[i + 1] & BROKEN) !== 0;
    return last ? own : visible.x[i + 1];
  }

  function runs(flag, samplePx, now) {
    const intervals = [];
    if ((anyFlags & flag) === 0) return intervals;
    for (let i = 0; i < visible.n; i++) {
      if ((visible.flags[i] & flag) === 0) continue;
      const x0 = visible.x[i];
      let x1 = endOf(i, samplePx);
      while (i + 1 < visible.n && (visible.flags[i + 1] & flag) !== 0 && visible.x[i + 1] <= x1 + 0.01) {
        i += 1;
        x1 = endOf(i, samplePx);
      }
      intervals.push({ x0, x1: Math.max(x0 + 2, Math.min(x1, Math.max(now, x0))) });
    }
    return intervals;
  }

  function gaps(samplePx, flag = GAP) {
    const intervals = [];
    if ((anyFlags & flag) === 0) return intervals;
    for (let i = 1; i < visible.n; i++) {
      if ((visible.flags[i] & flag) === 0) continue;
      const x0 = visible.x[i - 1] + (visible.sparse ? samplePx : 0.5);
      intervals.push({ x0, x1: Math.max(x0 + 2, visible.x[i]) });
    }
    return intervals;
  }

  return visible;
}
