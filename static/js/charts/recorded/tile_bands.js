/**
 * Where a recording has gaps, alerts, and stretches of which nothing may be said: bands of its strips.
 *
 * Exports
 *   bandsOf(piece, spans, x, all) -> [{x0, x1, kind, word}]     in px, for tile_strip.js
 *     piece: as pieceOf gives it.   spans: [{start, end, withdrawn}] manoeuvres, or null for none known;
 *     all: those of every recording laid over each other, for nothing is said outside of them
 */

const [WARMING_UP, INVALID] = [1, 3]; // codes of a tile's state

export function bandsOf(piece, spans, x, all = spans) {
  if (piece === null) return [];
  const { set } = piece;
  const keys = [...set.keys()];
  const unknown = (i) => keys.every((key) => Number.isNaN(set.series(key).low[i]));
  const inside = (i) =>
    spans === null ||
    spans.some(
      ({ start, end }) => set.x0[i] >= start - 1e-9 && set.x0[i] + set.step <= end + set.step / 2,
    );
  const withdrawn = (i) =>
    spans?.some(({ start, end, withdrawn: all }) => all && set.x0[i] >= start && set.x0[i] <= end);
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
    ...(spans ?? [])
      .filter((span) => span.withdrawn)
      .map(({ start, end }) => ({ x0: x(start), x1: x(end), kind: "invalid", word: "INVALID" })),
    ...named("alert", "ALERT", (i) => set.alert[i] === true),
  ];
}

/** What lies before, between and after the manoeuvres. */
function between(spans, x) {
  if (spans === null) return [];
  const edges = [-Infinity, ...joined(spans).flatMap(({ start, end }) => [start, end]), Infinity];
  const found = [];
  for (let k = 0; k < edges.length; k += 2) {
    if (edges[k + 1] <= edges[k]) continue;
    const [x0, x1] = [Math.max(-10, x(edges[k])), Math.min(1e5, x(edges[k + 1]))];
    if (x1 > x0) found.push({ x0, x1, kind: "between", word: "NOT ASSESSED" });
  }
  return found;
}

/** Spans that overlap as one. */
function joined(spans) {
  const found = [];
  for (const { start, end } of [...spans].sort((a, b) => a.start - b.start)) {
    const last = found.at(-1);
    if (last && start <= last.end) last.end = Math.max(last.end, end);
    else found.push({ start, end });
  }
  return found;
}

function runs({ set, from, to }, holds, x) {
  const found = [];
  for (let i = from; i < to; i++) {
    if (!holds(i)) continue;
    const first = i;
    while (i + 1 < to && holds(i + 1)) i += 1;
    const [x0, x1] = [x(set.x0[first]), x(set.x0[i] + set.step)];
    found.push({ x0, x1: Math.max(x0 + 2, x1) });
  }
  return found;
}
