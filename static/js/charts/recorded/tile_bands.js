/**
 * Bands of a recording's strips: gaps, alerts, and intervals without an assessment.
 *
 * Exports
 *   bandsOf(piece, manoeuvres, x, all) -> [{x0, x1, kind, word}]     in px, for tile_strip.js
 *     piece: as pieceOf gives it.   manoeuvres: [{start, end, withdrawn, silent}] manoeuvres, or null for none known;
 *     silent: [{start, end, word}] where the limits in force are not the monitor's
 *     all: manoeuvres of every recording overlaid; nothing is assessed outside of them
 */

const [WARMING_UP, INVALID] = [1, 3]; // codes of a tile's state

export function bandsOf(piece, manoeuvres, x, all = manoeuvres) {
  if (piece === null) return [];
  const { set } = piece;
  const keys = [...set.keys()];
  const unknown = (i) => keys.every((key) => Number.isNaN(set.series(key).low[i]));
  const inside = (i) =>
    manoeuvres === null ||
    manoeuvres.some(
      ({ start, end }) => set.x0[i] >= start - 1e-9 && set.x0[i] + set.step <= end + set.step / 2,
    );
  const silent = (manoeuvres ?? []).flatMap((manoeuvre) => manoeuvre.silent ?? []);
  const withdrawn = (i) =>
    silent.some(({ start, end }) => set.x0[i] >= start - set.step && set.x0[i] <= end) ||
    manoeuvres?.some(
      ({ end, withdrawn: from }) => from !== null && set.x0[i] >= from && set.x0[i] <= end,
    );
  const named = (kind, word, holds) => runs(piece, holds, x).map((run) => ({ ...run, kind, word }));
  return [
    ...between(all, x),
    ...named("gap", "GAP", unknown),
    ...named("warming", "WARMING UP", (i) => set.state[i] === WARMING_UP && inside(i)),
    ...named(
      "invalid",
      "INVALID",
      (i) => set.state[i] === INVALID && inside(i) && !unknown(i) && !withdrawn(i),
    ),
    ...(manoeuvres ?? [])
      .filter((manoeuvre) => manoeuvre.withdrawn !== null && !(manoeuvre.silent ?? []).some(({ start }) => start <= manoeuvre.withdrawn))
      .map(({ end, withdrawn: from, silent: parts = [] }) => ({ x0: x(from), x1: x(parts[0]?.start ?? end), kind: "invalid", word: "INVALID" })),
    ...silent.map(({ start, end, word }) => ({ x0: x(start), x1: x(end), kind: "invalid", word })),
    ...named("alert", "ALERT", (i) => set.alert[i] === true),
  ];
}

/** Intervals before, between and after the manoeuvres. */
function between(manoeuvres, x) {
  if (manoeuvres === null) return [];
  const edges = [
    -Infinity,
    ...joined(manoeuvres).flatMap(({ start, end }) => [start, end]),
    Infinity,
  ];
  const intervals = [];
  for (let k = 0; k < edges.length; k += 2) {
    if (edges[k + 1] <= edges[k]) continue;
    const [x0, x1] = [Math.max(-10, x(edges[k])), Math.min(1e5, x(edges[k + 1]))];
    if (x1 > x0) intervals.push({ x0, x1, kind: "between", word: "NOT ASSESSED" });
  }
  return intervals;
}

/** Merges overlapping intervals. */
function joined(manoeuvres) {
  const intervals = [];
  for (const { start, end } of [...manoeuvres].sort((a, b) => a.start - b.start)) {
    const last = intervals.at(-1);
    if (last && start <= last.end) last.end = Math.max(last.end, end);
    else intervals.push({ start, end });
  }
  return intervals;
}

function runs({ set, from, to }, holds, x) {
  const intervals = [];
  for (let i = from; i < to; i++) {
    if (!holds(i)) continue;
    const first = i;
    while (i + 1 < to && holds(i + 1)) i += 1;
    const [x0, x1] = [x(set.x0[first]), x(set.x0[i] + set.step)];
    intervals.push({ x0, x1: Math.max(x0 + 2, x1) });
  }
  return intervals;
}
