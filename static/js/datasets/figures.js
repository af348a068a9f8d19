/**
 * Figures of a dataset. Each function returns a <figure> with caption and key.
 *
 * Exports
 *   rolloutFigure({catalog, limits, rollouts, n_unsafe, n_safe})     coloured by outcome
 *   peakFigure(peaks, channel)               {limit, edges, unsafe, safe} of a dataset
 *   sampleRollouts(api, id) -> Promise<[rollout]>     the first MOST of each outcome
 */

import { barKey, framed, keyOf, sample, SPARE } from "../charts/figure.js";
import { createPlot } from "../charts/plot.js";
import { h, svg } from "../lib/dom.js";
import { figure as number } from "../lib/numbers.js";
import { magnitudeIn, shownIn } from "../lib/units.js";

const MOST = 40;

export function rolloutFigure({ catalog, limits, rollouts, n_unsafe, n_safe }) {
  const limited = catalog.channels.filter(({ key }) => limits?.[key] != null);
  const holder = h("div", {});
  const choice = h(
    "select",
    { "aria-label": "channel", onchange: draw },
    catalog.channels.map(({ key, symbol, label }) =>
      h("option", { value: key }, `${symbol}, ${label}`),
    ),
  );
  choice.value = (limited[0] ?? catalog.channels[0]).key;
  const count = (outcome) => rollouts.filter((rollout) => rollout.outcome === outcome).length;
  const key = keyOf(
    [
      sample("plot-unsafe", "cross"),
      `unsafe: ${count("unsafe")} of ${n_unsafe}, each to its failure`,
    ],
    [sample("plot-safe"), `safe: ${count("safe")} of ${n_safe}`],
    [sample("plot-limit"), "limit"],
  );
  draw();
  return framed(
    "Rollouts by outcome",
    [h("div", { class: "field-inline figure-choice" }, choice), holder],
    key,
  );

  function draw() {
    const channel = catalog.channels.find((entry) => entry.key === choice.value);
    const { unit, factor } = shownIn(channel);
    const inUnit = (value) => (value === null ? null : value * factor);
    const limit = inUnit(limits?.[channel.key] ?? null);
    const series = rollouts.map((rollout) => ({
      ...rollout,
      y: rollout.telemetry[channel.key].map(inUnit),
      t: rollout.telemetry.t,
    }));
    const top =
      SPARE *
      Math.max(
        limit ?? 0,
        1e-6,
        ...series.map(({ y }) =>
          y.reduce((most, value) => Math.max(most, Math.abs(value ?? 0)), 0),
        ),
      );
    const end = Math.max(0.1, ...series.map(({ t }) => t.at(-1)));
    const plot = createPlot({
      x: { label: "time [s]", domain: [0, end] },
      y: { label: `${channel.symbol} [${unit}]`, domain: [-top, top] },
      label: `${channel.label} of ${series.length} rollouts; the unsafe ones end with a cross at the failure`,
    });
    for (const outcome of ["safe", "unsafe"]) {
      for (const { t, y } of series.filter((rollout) => rollout.outcome === outcome))
        plot.line(
          t.map((time, k) => [time, y[k]]),
          `plot-${outcome}`,
        );
    }
    plot.marks(
      series.filter(({ outcome }) => outcome === "unsafe").map(({ t, y }) => [t.at(-1), y.at(-1)]),
      "cross",
      "plot-unsafe",
    );
    if (limit !== null) {
      plot.horizontal(limit, "plot-limit", `limit ${number(limit)} ${unit}`);
      plot.horizontal(-limit, "plot-limit", "");
    }
    holder.replaceChildren(plot.svg);
  }
}

export function peakFigure({ limit, edges, unsafe, safe }, channel) {
  const highest = Math.max(1, ...unsafe.map((count, k) => count + safe[k]));
  const plot = createPlot({
    x: {
      label: `peak |${channel.symbol}| / limit of ${magnitudeIn(channel, limit)}`,
      domain: [0, Math.max(edges.at(-1), 1.1)],
    },
    y: { label: "rollouts", domain: [0, SPARE * highest] },
    label: `Rollouts by their peak ${channel.label}: ${unsafe.reduce((a, b) => a + b, 0)} unsafe, ${safe.reduce((a, b) => a + b, 0)} safe`,
  });
  safe.forEach((count, k) => {
    if (count) plot.bar(edges[k], edges[k + 1], 0, count, "plot-safe-bar");
    if (unsafe[k]) plot.bar(edges[k], edges[k + 1], count, count + unsafe[k], "plot-unsafe-bar");
  });
  plot.vertical(1, "plot-limit", "limit");
  const key = barKey(plot, "safe", "unsafe (cut at the failure)");
  return framed(`Peak ${channel.label}`, plot.svg, key);
}

export async function sampleRollouts(api, id) {
  const outcomes = ["unsafe", "safe"].map((outcome) =>
    api.get(`/datasets/${id}/rollouts?outcome=${outcome}&count=${MOST}`),
  );
  return (await Promise.all(outcomes)).flat();
}
