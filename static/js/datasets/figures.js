/** Figures of a dataset: a channel's rollouts coloured by outcome, and their peaks. */

import { createFigure, SPARE } from "../charts/figure.js";
import { select } from "../forms/controls.js";
import { h } from "../lib/dom.js";
import { figure as number, magnitudeIn, shownIn } from "../lib/numbers.js";

const MOST = 40;

export function rolloutFigure({ catalog, limits, rollouts, n_unsafe, n_safe }) {
  const limited = catalog.channels.filter(({ key }) => limits?.[key] != null);
  const holder = h("div");
  const choice = select(
    catalog.channels.map(({ key, symbol, label }) => [key, `${symbol}, ${label}`]),
    { "aria-label": "channel", onchange: draw, value: (limited[0] ?? catalog.channels[0]).key },
  );
  draw();
  return h("div.stack-tight", h("div.field.field-inline.figure-choice", choice), holder);

  function draw() {
    const channel = catalog.channels.find((entry) => entry.key === choice.value);
    const { unit, factor } = shownIn(channel);
    const inUnit = (value) => (value === null ? null : value * factor);
    const limit = inUnit(limits?.[channel.key] ?? null);
    const pointsOf = ({ t, [channel.key]: values }) => t.map((time, k) => [time, inUnit(values[k])]);
    const seriesOf = (outcome) =>
      rollouts.filter((rollout) => rollout.outcome === outcome).map(({ telemetry }) => ({ look: `plot-${outcome}`, line: pointsOf(telemetry) }));
    const [safe, unsafe] = ["safe", "unsafe"].map(seriesOf);
    const lines = [...safe, ...unsafe];
    const top = SPARE * Math.max(limit ?? 0, 1e-6, ...lines.flatMap(({ line }) => line.map(([, value]) => Math.abs(value ?? 0))));
    const ends = unsafe.map(({ line }) => line.at(-1));
    const figure = createFigure({
      title: "Rollouts by outcome",
      label: `${channel.label} of ${lines.length} rollouts; the unsafe ones end with a cross at the failure`,
      x: { label: "time [s]", domain: [0, Math.max(0.1, ...lines.map(({ line }) => line.at(-1)[0]))] },
      y: { label: `${channel.symbol} [${unit}]`, domain: [-top, top] },
      series: [
        ...lines,
        { look: "plot-unsafe", line: [], mark: "cross", marks: ends, words: `unsafe: ${unsafe.length} of ${n_unsafe}, each to its failure` },
        { look: "plot-safe", words: `safe: ${safe.length} of ${n_safe}` },
        { look: "plot-limit", words: "limit" },
      ],
      rules: limit === null ? [] : [{ y: limit, look: "plot-limit", words: `limit ${number(limit)} ${unit}` }, { y: -limit, look: "plot-limit" }],
    });
    holder.replaceChildren(figure);
  }
}

export function peakFigure({ limit, edges, unsafe, safe }, channel) {
  const highest = Math.max(1, ...unsafe.map((count, k) => count + safe[k]));
  const sum = (counts) => counts.reduce((a, b) => a + b, 0);
  const barsOf = (counts, below) => counts.map((count, k) => [edges[k], edges[k + 1], below(k), below(k) + count]);
  return createFigure({
    title: `Peak ${channel.label}`,
    label: `Rollouts by their peak ${channel.label}: ${sum(unsafe)} unsafe, ${sum(safe)} safe`,
    x: {
      label: `peak |${channel.symbol}| / limit of ${magnitudeIn(channel, limit)}`,
      domain: [0, Math.max(edges.at(-1), 1.1)],
    },
    y: { label: "rollouts", domain: [0, SPARE * highest] },
    series: [
      { look: "plot-safe-bar", bars: barsOf(safe, () => 0), words: "safe" },
      { look: "plot-unsafe-bar", bars: barsOf(unsafe, (k) => safe[k]), words: "unsafe (cut at the failure)" },
    ],
    rules: [{ x: 1, look: "plot-limit", words: "limit" }],
  });
}

export async function sampleRollouts(api, id) {
  const first = (outcome) => api.get(`/datasets/${id}/rollouts?outcome=${outcome}&count=${MOST}`);
  return (await Promise.all(["unsafe", "safe"].map(first))).flat();
}
