/**
 * The samples of the ring buffer in the window, cell by cell, once a frame for all strips.
 *
 * A cell is one sample while there is room for every sample, else one column of pixels with all of its
 * samples. Columns are counted from time zero, so that a trace moves without shimmering, and only new ones are read.
 *
 * createCells(ring, seriesOf) -> Cells, see ../trace.js     seriesOf: Map of key -> series
 *     scan({start, step, first, columns, pitch}, {before, dt})    of a frame, see ../strip.js; `before`
 *       columns left of the edge are scanned too (for forecasts)
 *     until()    place before which no cell changes any more [units]
 *     flags    flags of each cell's samples, or-ed
 * bandsOf(cells, {x, now, width, pitch, newest, samplePx, late: [{start, end}]}, stale) -> [{x0, x1, kind, word}] [units], of whole columns     stale: "STALE 1.2 s", or ""
 */

import { STATE_WORDS } from "../../lib/states.js";
import { createColumns } from "./columns.js";
import { BROKEN, FLAG } from "./ring_buffer.js";

const DENSITY = 1; // samples a column up to which every sample is drawn
const RUNS = [
  ["warming_up", "warming"],
  ["not_assessed", "unassessed"],
  ["invalid", "invalid"],
  ["not_applicable", "invalid"],
  ["limits_unknown", "invalid"],
  ["alert", "alert"],
];

export function createCells(ring, seriesOf) {
  const cells = { n: 0, sparse: true, wide: 1.5, scan, until, t, series, range, runs, gaps };
  const columns = createColumns(ring, seriesOf.size);
  let capacity = 0;
  let samplePx = 0;
  let [left, wide] = [0, 1]; // first column of the plot; units a column
  let anyFlags = 0;

  function reserve(n) {
    if (n <= capacity) return;
    capacity = Math.ceil(n * 1.25);
    cells.x = new Float32Array(capacity);
    cells.column = new Int32Array(capacity);
    cells.from = new Int32Array(capacity);
    cells.to = new Int32Array(capacity);
    cells.flags = new Uint8Array(capacity);
    cells.cut = new Uint8Array(capacity);
  }

  function scan({ start, step, first, columns: width, pitch }, { before, dt }) {
    const column = step * pitch; // s
    [left, wide] = [first, pitch];
    reserve(Math.ceil(DENSITY * (width + before)) + 8);
    const from = Math.max(ring.first(), ring.after(start - before * column) - 1);
    const to = Math.min(ring.count(), ring.after(start + width * column, from) + 1);
    samplePx = dt / step;
    cells.n = 0;
    cells.sparse = to - from <= DENSITY * (width + before);
    cells.wide = cells.sparse ? Math.max(1.5, samplePx + 0.5) : 1.5;
    anyFlags = ring.flags(from, to);
    if (cells.sparse) {
      for (let i = from; i < to; i++) add((ring.time(i) - start) / step, i, i + 1);
      return;
    }
    columns.read(first - before, first + width, column);
    for (let k = first - before; k < first + width; k++) {
      const begin = Math.max(columns.from(k), ring.first());
      if (columns.to(k) > begin) add((k - first + 0.5) * pitch, begin, columns.to(k), k);
    }
  }

  function until() {
    const last = cells.x?.[Math.max(0, cells.n - 2)] ?? 0;
    return cells.sparse ? last : Math.min(last, (columns.whole() - left) * wide);
  }

  function add(x, from, to, column = 0) {
    const n = cells.n++;
    cells.column[n] = column;
    const flags = anyFlags === 0 ? 0 : ring.flags(from, to);
    cells.x[n] = x;
    cells.from[n] = from;
    cells.to[n] = to;
    cells.flags[n] = flags;
    cells.cut[n] = flags & BROKEN;
  }

  function t(i) {
    return ring.time(cells.from[i]);
  }

  function series(key) {
    const s = seriesOf.get(key);
    if (cells.sparse) return (i, out) => ring.extent(s, cells.from[i], cells.to[i], out);
    const read = columns.extents(s);
    return (i, out) => read(cells.column[i], out);
  }

  function range(key, out) {
    return cells.n > 0 && ring.extent(seriesOf.get(key), cells.from[0], cells.to[cells.n - 1], out);
  }

  /** Where cell i ends: at the next one, or a sample's length on where samples are missing. */
  function endOf(i) {
    const alone = cells.x[i] + Math.max(samplePx, cells.sparse ? 0 : wide);
    return i + 1 >= cells.n || cells.cut[i + 1] ? alone : cells.x[i + 1];
  }

  /** Runs of cells with a flag. */
  function runs(flag, now) {
    const intervals = [];
    if ((anyFlags & flag) === 0) return intervals;
    const has = (i) => i < cells.n && (cells.flags[i] & flag) !== 0;
    for (let i = 0; i < cells.n; i++) {
      if (!has(i)) continue;
      const x0 = cells.x[i];
      let x1 = endOf(i);
      while (has(i + 1) && cells.x[i + 1] <= x1 + 0.01) x1 = endOf(++i);
      intervals.push({ x0, x1: Math.max(x0 + 2, Math.min(x1, Math.max(now, x0))) });
    }
    return intervals;
  }

  /** Before the cells with a flag, where samples are missing. */
  function gaps(flag) {
    const intervals = [];
    if ((anyFlags & flag) === 0) return intervals;
    for (let i = 1; i < cells.n; i++) {
      if ((cells.flags[i] & flag) === 0) continue;
      const x0 = cells.x[i - 1] + (cells.sparse ? samplePx : wide / 2);
      intervals.push({ x0, x1: Math.max(x0 + 2, cells.x[i]) });
    }
    return intervals;
  }

  return cells;
}

export function bandsOf(cells, { x, now, width, pitch, newest, samplePx, late }, stale) {
  if (Number.isNaN(newest)) return [{ x0: 0, x1: width, kind: "stale", word: stale || "NO DATA" }];
  const end = x(newest) + samplePx;
  const edge = Math.max(end, x(now));
  const whole = (at) => Math.floor(at / pitch + 1e-3) * pitch;
  const named = (intervals, kind, word) => intervals.map((run) => ({ x0: whole(run.x0), x1: whole(run.x1), kind, word }));
  return [
    ...named(cells.gaps(FLAG.gap), "gap", "GAP"),
    ...named(cells.gaps(FLAG.thinned), "thinned", "SKIPPED"),
    ...RUNS.flatMap(([flag, kind]) => named(cells.runs(FLAG[flag], edge), kind, STATE_WORDS[flag] ?? "ALERT")),
    ...named(late.map(({ start, end: until }) => ({ x0: x(start) + samplePx, x1: until === null ? edge : x(until) })), "late", "STALE IN FLIGHT").filter(({ x0, x1 }) => x1 > 0 && x0 < width),
    ...named(stale ? [{ x0: end, x1: Math.max(edge, end + 2) }] : [], "stale", stale),
  ];
}
