/**
 * Least and greatest values of a recording, bin by bin, fetched for the window as it moves.
 *
 * createTileCache({load, start, end, dt, offset, arrived, failed}) -> TileCache
 *     load(start, end, bins) -> Promise<answer>, in the recording's own time; offset [s] is taken from its times
 *   want(view, pixels)    fetches what is missing for this window, once it rests; not after failed(error) until retry()
 *   best(view, pixels) -> TileSet | null    the coarsest that is fine enough, else the finest
 *   entire() -> TileSet | null, close()
 * previewTiles({key: {t, low, high}}) -> {start, end, step, t, channels: {key: {low, high}}} | null
 *     a preview's channels, each in its own bins, on one time grid, for a recording that is not scored yet
 *
 * TileSet
 *   start, end, fine [s]                 as requested: a step of `fine` or a little more
 *   step [s], n, x0 (start of each bin [s]), at (time of its values [s])
 *   keys(), series(key) -> {low, high}   channels, "risk" and "withdrawn"; typed arrays, NaN where unknown
 *   state, alert                         a bin's worst state (code) and whether it alerts
 *   visit(keys, {start, end}, visitor)    two channels, bin by bin, see ../cross/cross_plot.js
 *   valueAt(key, t), rangeOf(key, {start, end}) -> {low, high}     NaN where nothing is known
 */

const REST = 70; // ms without a change of the window before a request
const KEPT = 24; // sets
const MOST_BINS = 8000; // bins; a gap of hours in a short file would ask for more
const NONE = { low: new Float32Array(0), high: new Float32Array(0) };

function tileSet(answer, { offset = 0, dt = 0 } = {}) {
  const n = answer.t.length;
  const x0 = Float64Array.from(answer.t, (t) => t - offset);
  const known = new Map();
  for (const [key, given] of Object.entries(answer.channels)) known.set(key, pair(given));
  for (const key of ["risk", "withdrawn"]) if (answer[key]) known.set(key, pair(answer[key]));
  const step = answer.step;
  const single = step <= 1.01 * dt; // a bin is one sample, at the bin's start
  const at = single ? x0 : x0.map((t) => t + step / 2);

  function visit(keys, { start, end }, visitor) {
    const [x, y] = keys.map((key) => known.get(key) ?? NONE);
    for (let i = Math.max(0, binOf(x0, Infinity, start)); i < n && at[i] <= end + 1e-9; i++) {
      if (at[i] >= start - 1e-9) visitor(at[i], x.low[i], x.high[i], y.low[i], y.high[i], i > 0 && x0[i] - x0[i - 1] > 1.5 * step);
    }
  }

  return {
    step,
    n,
    x0,
    at,
    series: (key) => known.get(key) ?? NONE,
    keys: () => Object.keys(answer.channels),
    state: answer.state ?? [],
    alert: answer.alert ?? [],
    valueAt: (key, t) => {
      const i = binOf(x0, step, t);
      const { low, high } = known.get(key) ?? NONE;
      return i < 0 ? { low: NaN, high: NaN } : { low: low[i], high: high[i] };
    },
    visit,
    rangeOf: (key, view) => extremes(known.get(key) ?? NONE, x0, step, view),
  };
}

function extremes({ low, high }, x0, step, { start, end }) {
  let [least, greatest] = [Infinity, -Infinity];
  for (let i = 0; i < low.length; i++) {
    if (x0[i] + step < start || x0[i] > end) continue;
    if (low[i] < least) least = low[i];
    if (high[i] > greatest) greatest = high[i];
  }
  return least <= greatest ? { low: least, high: greatest } : { low: NaN, high: NaN };
}

function pair({ low, high }) {
  const highs = floats(high);
  return { low: low ? floats(low) : highs, high: highs };
}

function floats(values) {
  return Float32Array.from(values, (value) => value ?? NaN);
}

function binOf(x0, step, t) {
  let [low, high] = [0, x0.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (x0[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return low > 0 && t < x0[low - 1] + 1.5 * step ? low - 1 : -1;
}

export function createTileCache({ load, start, end, dt, offset = 0, arrived, failed }) {
  let sets = [];
  let asked = null; // the window last requested
  let timer = 0;
  let broken = false;
  let closed = false;

  const covers = (set, from, to) => set.start <= from + 1e-9 && set.end >= to - 1e-9;
  const clipped = (view) => [Math.max(start, view.start), Math.min(end, view.end)];
  const finest = (view, pixels) => Math.max(dt, (view.end - view.start) / pixels);

  function best(view, pixels) {
    const [from, to] = clipped(view);
    const covering = sets.filter((set) => covers(set, from, to));
    const enough = covering.filter((set) => set.fine <= 1.05 * finest(view, pixels));
    const byStep = (a, b) => a.step - b.step;
    return enough.sort(byStep).at(-1) ?? covering.sort(byStep)[0] ?? sets[0] ?? null;
  }

  function want(view, pixels) {
    const set = best(view, pixels);
    const [from, to] = clipped(view);
    const enough = set && covers(set, from, to) && set.fine <= 1.05 * finest(view, pixels);
    clearTimeout(timer); // for an earlier window
    if (enough || broken || to <= from) return;
    if (sets.length === 0)
      fetchFor({ start, end }, pixels); // for the overview
    else timer = setTimeout(() => fetchFor(view, pixels), REST);
  }

  /** Half a window more on either side, so that a pan finds its tiles there. */
  async function fetchFor(view, pixels) {
    const width = view.end - view.start;
    const from = Math.max(start, view.start - width / 2);
    const to = Math.min(end, view.end + width / 2);
    const fine = finest(view, pixels);
    const bins = 2 + Math.ceil((to - from) / fine); // both ends count
    const name = `${from} ${to} ${bins}`;
    if (asked === name) return;
    asked = name;
    try {
      const answer = await load(from + offset, to + offset, bins);
      if (closed) return;
      const set = { ...tileSet(answer, { offset, dt }), start: from, end: to, fine };
      sets = [...sets.slice(0, 1), ...sets.slice(1).slice(-KEPT), set];
      arrived();
    } catch (error) {
      if (closed) return;
      [asked, broken] = [null, true];
      failed(error);
    }
  }

  return {
    want,
    best,
    entire: () => sets[0] ?? null,
    retry: () => {
      broken = false;
    },
    close: () => {
      closed = true;
      clearTimeout(timer);
    },
  };
}

export function previewTiles(channels) {
  const given = Object.entries(channels).filter(([, { t }]) => t.length > 1);
  if (!given.length) return null;
  const widths = new Map(given.map(([key, { t }]) => [key, widthOf(t)]));
  const start = Math.min(...given.map(([, { t }]) => t[0]));
  const end = Math.max(...given.map(([key, { t }]) => t.at(-1) + widths.get(key)));
  const n = Math.min(MOST_BINS, Math.max(1, Math.round((end - start) / Math.min(...widths.values()))));
  const step = (end - start) / n;
  return {
    start,
    end,
    step,
    t: Array.from({ length: n }, (_, k) => start + k * step),
    channels: Object.fromEntries(
      given.map(([key, tiles]) => [key, onGrid(tiles, widths.get(key), start, step, n)]),
    ),
  };
}

/** The usual length of a bin; those beside a gap are longer. */
function widthOf(t) {
  const steps = t.slice(1).map((time, k) => time - t[k]);
  return steps.sort((a, b) => a - b)[steps.length >> 1];
}

function onGrid({ t, low, high }, width, start, step, n) {
  const grid = { low: new Array(n).fill(null), high: new Array(n).fill(null) };
  t.forEach((time, k) => {
    if (low[k] === null) return;
    const from = Math.min(n - 1, Math.round((time - start) / step));
    const to = Math.min(n, Math.max(from + 1, Math.round((time + width - start) / step)));
    for (let i = from; i < to; i++) {
      grid.low[i] = Math.min(grid.low[i] ?? Infinity, low[k]);
      grid.high[i] = Math.max(grid.high[i] ?? -Infinity, high[k]);
    }
  });
  return grid;
}
