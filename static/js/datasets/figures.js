/** Figures of a dataset: a channel's rollouts coloured by outcome, and their peaks. */

import { barKey, framed, keyOf, sample, SPARE } from "../charts/figure.js";
import { createPlot } from "../charts/plot.js";
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
  const count = (outcome) => rollouts.filter((rollout) => rollout.outcome === outcome).length;
  const key = keyOf(
    [sample("plot-unsafe", "cross"), `unsafe: ${count("unsafe")} of ${n_unsafe}, each to its failure`],
    [sample("plot-safe"), `safe: ${count("safe")} of ${n_safe}`],
    [sample("plot-limit"), "limit"],
  );
  draw();
  return framed("Rollouts by outcome", [h("div.field.field-inline.figure-choice", choice), holder], key);

  function draw() {
    const channel = catalog.channels.find((entry) => entry.key === choice.value);
    const { unit, factor } = shownIn(channel);
    const inUnit = (value) => (value === null ? null : value * factor);
    const limit = inUnit(limits?.[channel.key] ?? null);
    const lines = rollouts.map(({ outcome, telemetry: { t, [channel.key]: values } }) => ({
      outcome,
      points: t.map((time, k) => [time, inUnit(values[k])]),
    }));
    const peaks = lines.map(({ points }) => points.reduce((most, [, value]) => Math.max(most, Math.abs(value ?? 0)), 0));
    const top = SPARE * Math.max(limit ?? 0, 1e-6, ...peaks);
    const plot = createPlot({
      x: { label: "time [s]", domain: [0, Math.max(0.1, ...lines.map(({ points }) => points.at(-1)[0]))] },
      y: { label: `${channel.symbol} [${unit}]`, domain: [-top, top] },
      label: `${channel.label} of ${lines.length} rollouts; the unsafe ones end with a cross at the failure`,
    });
    const unsafe = lines.filter(({ outcome }) => outcome === "unsafe");
    for (const { outcome, points } of [...lines.filter((line) => !unsafe.includes(line)), ...unsafe])
      plot.line(points, `plot-${outcome}`);
    plot.marks(unsafe.map(({ points }) => points.at(-1)), "cross", "plot-unsafe");
    if (limit !== null) {
      plot.horizontal(limit, "plot-limit", `limit ${number(limit)} ${unit}`);
      plot.horizontal(-limit, "plot-limit", "");
    }
    holder.replaceChildren(plot.svg);
  }
}

export function peakFigure({ limit, edges, unsafe, safe }, channel) {
  const highest = Math.max(1, ...unsafe.map((count, k) => count + safe[k]));
  const sum = (counts) => counts.reduce((a, b) => a + b, 0);
  const plot = createPlot({
    x: {
      label: `peak |${channel.symbol}| / limit of ${magnitudeIn(channel, limit)}`,
      domain: [0, Math.max(edges.at(-1), 1.1)],
    },
    y: { label: "rollouts", domain: [0, SPARE * highest] },
    label: `Rollouts by their peak ${channel.label}: ${sum(unsafe)} unsafe, ${sum(safe)} safe`,
  });
  safe.forEach((count, k) => {
    if (count) plot.bar(edges[k], edges[k + 1], 0, count, "plot-safe-bar");
    if (unsafe[k]) plot.bar(edges[k], edges[k + 1], count, count + unsafe[k], "plot-unsafe-bar");
  });
  plot.vertical(1, "plot-limit", "limit");
  return framed(`Peak ${channel.label}`, plot.svg, barKey(plot, "safe", "unsafe (cut at the failure)"));
}

export async function sampleRollouts(api, id) {
  const first = (outcome) => api.get(`/datasets/${id}/rollouts?outcome=${outcome}&count=${MOST}`);
  return (await Promise.all(["unsafe", "safe"].map(first))).flat();
}
