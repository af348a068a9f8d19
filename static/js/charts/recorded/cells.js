/**
 * The bins of a set of tiles in the window, and the bands of a recording's strips.
 *
 * cellsOf(set, manoeuvres, {view, step, x}) -> Cells | null, see ../trace.js     each manoeuvre has its own trim
 * bandsOf(cells, manoeuvres, x, all) -> [{x0, x1, kind, word}] [px]: gaps, alerts, intervals without an assessment
 *     manoeuvres: [{start, end, withdrawn, silent}], or null for none known; withdrawn: [s] or null
 *     silent: [{start, end, word}] where other limits are in force
 *     all: manoeuvres of every recording laid over; nothing is assessed outside of them
 * between(manoeuvres, x) -> [{x0, x1}] [px]: before, between and after them
 */

const DENSE = 0.9; // px a bin below which bins are drawn as an area
const [WARMING_UP, INVALID] = [1, 3]; // codes of a tile's state

/** With one more bin on either side, so that the trace reaches the edges. */
export function cellsOf(set, manoeuvres, { view, step, x }) {
  if (set === null || set.n === 0) return null;
  const from = Math.max(0, Math.floor((view.start - set.x0[0]) / set.step) - 1);
  const to = Math.min(set.n, Math.ceil((view.end - set.x0[0]) / set.step) + 2);
  if (to <= from) return null;
  const wide = set.step / step;
  const begins = set.x0.subarray(from, to);
  return {
    set,
    from,
    n: to - from,
    x: set.at.subarray(from, to).map(x),
    cut: cutsOf(begins, manoeuvres ?? []),
    sparse: wide >= DENSE,
    wide: Math.max(1.5, wide + 0.5),
    t: (i) => begins[i],
    series,
    range,
  };

  function series(key) {
    const { low, high } = set.series(key);
    return (i, out) => {
      out[0] = low[from + i];
      out[1] = high[from + i];
      return out[0] <= out[1];
    };
  }

  function range(key, out) {
    const { low, high } = set.rangeOf(key, view);
    [out[0], out[1]] = [low, high];
    return low <= high;
  }
}

/** Whether the trace breaks before a bin: at each edge of a manoeuvre. */
function cutsOf(begins, manoeuvres) {
  const cut = new Uint8Array(begins.length);
  for (const { start, end } of manoeuvres) {
    for (const edge of [start - 1e-9, end + 1e-9]) {
      const first = begins.findIndex((t) => t >= edge);
      if (first >= 0) cut[first] = 1;
    }
  }
  return cut;
}

export function bandsOf(cells, manoeuvres, x, all = manoeuvres) {
  if (cells === null) return [];
  const { set, from, n } = cells;
  const known = manoeuvres ?? [];
  const silent = known.flatMap((manoeuvre) => manoeuvre.silent ?? []);
  const lows = set.keys().map((key) => set.series(key).low);
  const isUnknown = (i) => lows.every((low) => Number.isNaN(low[i]));
  const isInside = (i) =>
    manoeuvres === null ||
    known.some(
      ({ start, end }) => set.x0[i] >= start - 1e-9 && set.x0[i] + set.step <= end + set.step / 2,
    );
  const isWithdrawn = (i) =>
    silent.some(({ start, end }) => set.x0[i] >= start - set.step && set.x0[i] <= end) ||
    known.some(
      ({ end, withdrawn }) => withdrawn !== null && set.x0[i] >= withdrawn && set.x0[i] <= end,
    );
  const isInvalid = (i) =>
    set.state[i] === INVALID && isInside(i) && !isUnknown(i) && !isWithdrawn(i);
  const withdrawal = ({ end, withdrawn, silent: parts = [] }) =>
    withdrawn === null || parts.some(({ start }) => start <= withdrawn)
      ? []
      : [{ x0: x(withdrawn), x1: x(parts[0]?.start ?? end), kind: "withdrawn", word: "INVALID" }];
  return [
    ...between(all, x).map((box) => ({ ...box, kind: "between", word: "NOT ASSESSED" })),
    ...runs("gap", "GAP", isUnknown),
    ...runs("warming", "WARMING UP", (i) => set.state[i] === WARMING_UP && isInside(i)),
    ...runs("withdrawn", "INVALID", isInvalid),
    ...known.flatMap(withdrawal),
    ...silent.map(({ start, end, word }) => ({ x0: x(start), x1: x(end), kind: "withdrawn", word })),
    ...runs("alert", "ALERT", (i) => set.alert[i] === true),
  ];

  function runs(kind, word, holds) {
    const intervals = [];
    for (let i = from; i < from + n; i++) {
      if (!holds(i)) continue;
      const first = i;
      while (i + 1 < from + n && holds(i + 1)) i += 1;
      const [x0, x1] = [x(set.x0[first]), x(set.x0[i] + set.step)];
      intervals.push({ x0, x1: Math.max(x0 + 2, x1), kind, word });
    }
    return intervals;
  }
}

export function between(manoeuvres, x) {
  if (manoeuvres === null) return [];
  const boxes = [];
  let begin = -Infinity;
  for (const { start, end } of [...manoeuvres].sort((a, b) => a.start - b.start)) {
    if (start > begin) boxes.push(boxOf(begin, start));
    begin = Math.max(begin, end);
  }
  return [...boxes, boxOf(begin, Infinity)].filter(({ x0, x1 }) => x1 > x0);

  function boxOf(from, to) {
    return { x0: Math.max(-10, x(from)), x1: Math.min(1e5, x(to)) };
  }
}
