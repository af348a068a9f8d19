/**
 * A preview's channels as tiles on one time grid, for a recording that is not scored yet.
 *
 * Exports
 *   previewTiles(channels) -> {start, end, step, t, channels: {key: {low, high}}} | null
 *     channels: {key: {t, low, high}}, each in bins of its own, which begin at its t
 */

const MOST = 8000; // bins; a gap of hours in a short file would ask for more

export function previewTiles(channels) {
  const given = Object.entries(channels).filter(([, { t }]) => t.length > 1);
  if (!given.length) return null;
  const widths = new Map(given.map(([key, { t }]) => [key, widthOf(t)]));
  const start = Math.min(...given.map(([, { t }]) => t[0]));
  const end = Math.max(...given.map(([key, { t }]) => t.at(-1) + widths.get(key)));
  const n = Math.min(MOST, Math.max(1, Math.round((end - start) / Math.min(...widths.values()))));
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
