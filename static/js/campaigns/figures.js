/**
 * Figures of a campaign.
 *
 * Exports
 *   buildUpFigure(points, title) -> figure          predicted and flown peaks over amplitude, with the limit
 *   derivativesFigure({condition, after}) -> figure    each derivative after each point, in prior standard deviations
 */

import { framed, keyOf, sample, SPARE } from "../charts/figure.js";
import { createPlot } from "../charts/plot.js";
import { svg } from "../lib/dom.js";

/** Half width of a 95 % interval, in standard deviations. */
const WIDTH = 1.96;
const ROW = 26;

export function buildUpFigure(points, title) {
  const parts = points.flatMap(({ clearing, flown }) => [clearing?.reached[2] ?? 0, flown?.reached ?? 0]);
  const most = Math.max(...points.map(({ peak_deg: peak }) => Math.abs(peak)));
  const plot = createPlot({
    x: { label: "amplitude of the points [deg]", domain: [0, 1.05 * most], ticks: points.map(({ peak_deg: peak }) => Math.abs(peak)) },
    y: { label: "largest share of a limit", domain: [0, SPARE * Math.max(1, ...parts)], format: (part) => `${Math.round(100 * part)}%` },
    label: "Predicted and flown peaks over amplitude",
  });
  plot.horizontal(1, "plot-limit", "limit");
  const wide = 0.008 * most;
  for (const { peak_deg: peak, clearing, flown } of points) {
    const at = Math.abs(peak);
    if (clearing) {
      const [low, middle, high] = clearing.reached;
      const name = clearing.withdrawn.length ? "plot-method-1 campaign-withdrawn" : "plot-method-1 campaign-predicted";
      plot.line([[at, low], [at, high]], name);
      for (const part of [low, high]) plot.line([[at - wide, part], [at + wide, part]], name);
      plot.line([[at - 2 * wide, middle], [at + 2 * wide, middle]], name);
    }
    if (flown) plot.marks([[at, flown.reached]], flown.passed ? "circle" : "cross", flown.passed ? "plot-safe" : "plot-unsafe");
  }
  const key = keyOf(
    [sample("plot-method-1 campaign-predicted"), "predicted before the flight, 5 to 95 %"],
    ...(points.some(({ clearing }) => clearing?.withdrawn.length) ? [[sample("plot-method-1 campaign-withdrawn"), "prediction withdrawn"]] : []),
    [svg("path", { d: "M13.5 7a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0 -7 0", class: "plot-mark plot-safe" }), "flown"],
    [svg("path", { d: "M13 3L21 11M13 11L21 3", class: "plot-mark plot-unsafe" }), "flown: not passed, or aborted"],
  );
  return framed(title, plot.svg, key);
}

export function derivativesFigure({ condition, after }) {
  const names = after.at(-1).parameters.filter(({ before }) => before[1] > 0).map(({ name }) => name);
  const known = after.map(({ parameters }) => new Map(parameters.map((parameter) => [parameter.name, parameter])));
  const standard = ({ before: [mean, sigma], after: [now, left] }) => [(now - mean) / sigma, left / sigma];
  const shifts = known.flatMap((step) => names.map((name) => Math.abs(standard(step.get(name))[0])));
  const most = Math.max(3, ...shifts.map((shift) => shift + 1));
  const n = names.length;
  const plot = createPlot({
    x: { label: "deviation from the expected value, in its standard deviations", domain: [-most, most] },
    y: { label: "derivative", domain: [0, n], ticks: names.map((_, row) => n - row - 0.5), format: (at) => names[Math.round(n - at - 0.5)] },
    label: "Derivatives after each point",
    height: 70 + ROW * n,
  });
  plot.band([[-2, 0, n], [2, 0, n]], "plot-safe");
  known.forEach((step, number) => {
    const name = number === known.length - 1 ? "plot-step" : "plot-step campaign-earlier";
    names.forEach((key, row) => {
      const [shift, sigma] = standard(step.get(key));
      const at = n - row - (number + 1) / (known.length + 1);
      plot.line([[shift - WIDTH * sigma, at], [shift + WIDTH * sigma, at]], name);
      plot.marks([[shift, at]], "circle", name);
    });
  });
  const key = keyOf([sample("plot-step", "circle"), "after each point (the last is brightest), 95 %"]);
  return framed(`Derivatives${condition && ` at ${condition}`}, after ${after.at(-1).sources.join(", ")}`, plot.svg, key, "Shaded: 95 % of the values expected before the campaign.");
}
