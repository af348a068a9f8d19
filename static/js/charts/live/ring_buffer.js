/**
 * The last hour of telemetry in fixed memory, ready to be drawn at any zoom.
 *
 * All series share one time axis. Samples are numbered from 0 as they arrive; the oldest are
 * overwritten. Over the samples lies a pyramid of minima and maxima (blocks of 8, 64, 512 and
 * 4096), so the extent of any interval costs about the same whether it holds ten samples or all.
 * Everything is allocated once: 4 bytes a value, 9 a sample, and 29 % more for the pyramid.
 *
 * createRingBuffer({series, capacity}) -> RingBuffer
 *   capacity     the one asked for, rounded up to whole blocks;   first(), count()    number of the oldest sample, after the newest
 *   push(t, row, flags) -> bool     NaN is a missing value. False, and nothing stored, unless t [s] is after the last one
 *   insert(at, [{t, row, flags}], flags) -> bool     before sample `at`, whose flags are then `flags`; times rise and lie
 *     between those of the neighbours. False, and nothing stored, where what lies before is not held any more
 *   time(i) [s], value(s, i), flags(from, to)    flags of samples from..to-1, or-ed
 *   extent(s, from, to, out) -> bool     least and greatest value into out; false where all are missing
 *   after(t, from) -> first sample at or after t;   nearest(t) -> -1 when empty;   clear()
 *   revision     changes where samples in the buffer change otherwise than by push
 */

/** Bits of a sample's flags; those with the name of a state are set by it. */
export const FLAG = {
  invalid: 1,
  alert: 2,
  gap: 4, // samples are missing before this one
  warming_up: 8,
  thinned: 16, // samples before this one were left out for display
  not_assessed: 32,
  not_applicable: 64,
  limits_unknown: 128,
};
export const BROKEN = FLAG.gap | FLAG.thinned; // nothing is known between this sample and the one before

const SHIFTS = [12, 9, 6, 3]; // coarsest first
const COARSEST = 1 << SHIFTS[0];

export function createRingBuffer({ series, capacity = 180_000 }) {
  const size = Math.ceil(capacity / COARSEST) * COARSEST;
  const times = new Float64Array(size);
  const marks = new Uint8Array(size);
  const values = floats(series, size);
  const levels = SHIFTS.map((shift) => ({
    shift,
    block: 1 << shift,
    low: floats(series, size >> shift),
    high: floats(series, size >> shift),
    marks: new Uint8Array(size >> shift),
  }));
  let count = 0;
  let revision = 0;

  const first = () => Math.max(0, count - size);
  const time = (i) => times[i % size];

  function push(t, row, flags = 0) {
    if (!Number.isFinite(t) || (count > 0 && t <= time(count - 1))) return false;
    const slot = count % size;
    times[slot] = t;
    marks[slot] = flags;
    for (let s = 0; s < series; s++) values[s][slot] = row[s];
    for (const level of levels) {
      const at = slot >> level.shift;
      const fresh = (slot & (level.block - 1)) === 0;
      level.marks[at] = fresh ? flags : level.marks[at] | flags;
      for (let s = 0; s < series; s++) {
        const value = values[s][slot];
        if (fresh) {
          level.low[s][at] = Infinity;
          level.high[s][at] = -Infinity;
        }
        if (value < level.low[s][at]) level.low[s][at] = value;
        if (value > level.high[s][at]) level.high[s][at] = value;
      }
    }
    count += 1;
    return true;
  }

  /** Everything from the block of `at` on is stored again, so that the pyramid is right. */
  function insert(at, rows, flags) {
    const from = at - (at % COARSEST);
    if (from < first()) return false;
    revision += 1;
    const kept = Array.from({ length: count - from }, (_, k) => copy(from + k));
    if (at < count) kept[at - from].flags = flags;
    kept.splice(at - from, 0, ...rows);
    count = from;
    for (const { t, row, flags } of kept) push(t, row, flags);
    return true;
  }

  function copy(i) {
    const slot = i % size;
    return { t: times[slot], row: values.map((series) => series[slot]), flags: marks[slot] };
  }

  /** Coarsest level with a whole block starting at sample i and ending by `to`. */
  function levelAt(i, to) {
    for (const level of levels) {
      if ((i & (level.block - 1)) === 0 && i + level.block <= to) return level;
    }
    return null;
  }

  function extent(s, from, to, out) {
    let low = Infinity;
    let high = -Infinity;
    let slot = from % size;
    for (let i = from; i < to; ) {
      const level = to - i >= 8 ? levelAt(i, to) : null;
      if (level === null) {
        const value = values[s][slot];
        if (value < low) low = value;
        if (value > high) high = value;
      } else {
        const at = slot >> level.shift;
        if (level.low[s][at] < low) low = level.low[s][at];
        if (level.high[s][at] > high) high = level.high[s][at];
      }
      const length = level === null ? 1 : level.block;
      i += length;
      slot += length;
      if (slot >= size) slot -= size; // no block reaches over the end
    }
    out[0] = low;
    out[1] = high;
    return low <= high;
  }

  function flags(from, to) {
    let all = 0;
    for (let i = from; i < to; ) {
      const level = to - i >= 8 ? levelAt(i, to) : null;
      const slot = i % size;
      all |= level === null ? marks[slot] : level.marks[slot >> level.shift];
      i += level === null ? 1 : level.block;
    }
    return all;
  }

  function after(t, from = first()) {
    let low = from;
    let jump = 1;
    while (low + jump < count && time(low + jump) < t) jump *= 2; // near ones are found fast
    let high = Math.min(count, low + jump);
    if (jump > 1) low += jump / 2;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if (time(middle) < t) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  function nearest(t) {
    if (count === 0) return -1;
    const i = Math.min(after(t), count - 1);
    return i > first() && t - time(i - 1) < time(i) - t ? i - 1 : i;
  }

  return {
    capacity: size,
    first,
    count: () => count,
    push,
    insert,
    time,
    value: (s, i) => values[s][i % size],
    flags,
    extent,
    after,
    nearest,
    clear: () => {
      count = 0;
      revision += 1;
    },
    get revision() {
      return revision;
    },
  };
}

function floats(series, length) {
  return Array.from({ length: series }, () => new Float32Array(length));
}
