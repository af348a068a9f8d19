/** Figures of a campaign: build-up over amplitude, and derivatives after each point in prior standard deviations. */

import { createFigure, SPARE } from "../charts/figure.js";

/** Half width of a 95 % interval, in standard deviations. */
const WIDTH = 1.96;
const ROW = 26;
const WITHDRAWN = "plot-method-1 campaign-withdrawn";
const PREDICTED = "plot-method-1 campaign-predicted";

export function buildUpFigure(points, title) {
  const parts = points.flatMap(({ clearing, flown }) => [clearing?.reached[2] ?? 0, flown?.reached ?? 0]);
  const amplitudes = points.map(({ peak_deg: peak }) => Math.abs(peak));
  const most = Math.max(...amplitudes);
  const wide = 0.008 * most;
  const across = (at, width, part) => [[at - width, part], [at + width, part]];
  const predicted = points.flatMap(({ clearing }, k) => {
    if (!clearing) return [];
    const [low, middle, high] = clearing.reached;
    const at = amplitudes[k];
    const look = clearing.withdrawn.length ? WITHDRAWN : PREDICTED;
    const lines = [[[at, low], [at, high]], across(at, wide, low), across(at, wide, high), across(at, 2 * wide, middle)];
    return lines.map((line) => ({ look, line }));
  });
  const flownWhere = (isPassed) =>
    points.flatMap(({ flown }, k) => (flown && flown.passed === isPassed ? [[amplitudes[k], flown.reached]] : []));
  const isWithdrawn = points.some(({ clearing }) => clearing?.withdrawn.length);
  return createFigure({
    title,
    label: "Predicted and flown peaks over amplitude",
    x: { label: "amplitude of the points [deg]", domain: [0, 1.05 * most], ticks: amplitudes },
    y: {
      label: "largest share of a limit",
      domain: [0, SPARE * Math.max(1, ...parts)],
      format: (part) => `${Math.round(100 * part)} %`,
    },
    series: [
      ...predicted,
      { look: PREDICTED, words: "predicted before the flight, 5 to 95 %" },
      { look: WITHDRAWN, words: isWithdrawn && "prediction withdrawn" },
      { look: "plot-safe", mark: "circle", marks: flownWhere(true), words: "flown" },
      { look: "plot-unsafe", mark: "cross", marks: flownWhere(false), words: "flown: not passed, or aborted" },
    ],
    rules: [{ y: 1, look: "plot-limit", words: "limit" }],
  });
}

export function derivativesFigure({ condition, after }) {
  const last = after.at(-1);
  const names = last.parameters.filter(({ before }) => before[1] > 0).map(({ name }) => name);
  const known = after.map(({ parameters }) => new Map(parameters.map((parameter) => [parameter.name, parameter])));
  const standard = ({ before: [mean, sigma], after: [now, left] }) => [(now - mean) / sigma, left / sigma];
  const shifts = known.flatMap((step) => names.map((name) => Math.abs(standard(step.get(name))[0])));
  const most = Math.max(3, ...shifts.map((shift) => shift + 1));
  const n = names.length;
  const intervals = known.flatMap((step, number) => {
    const look = number === known.length - 1 ? "plot-step" : "plot-step campaign-earlier";
    return names.map((name, row) => {
      const [shift, sigma] = standard(step.get(name));
      const at = n - row - (number + 1) / (known.length + 1);
      const line = [[shift - WIDTH * sigma, at], [shift + WIDTH * sigma, at]];
      return { look, line, mark: "circle", marks: [[shift, at]] };
    });
  });
  return createFigure({
    title: `Derivatives${condition && ` at ${condition}`}, after ${last.sources.join(", ")}`,
    words: "Shaded: 95 % of the values expected before the campaign.",
    label: "Derivatives after each point",
    x: { label: "deviation from the expected value, in its standard deviations", domain: [-most, most] },
    y: {
      label: "derivative",
      domain: [0, n],
      ticks: names.map((_, row) => n - row - 0.5),
      format: (at) => names[Math.round(n - at - 0.5)],
    },
    height: 70 + ROW * n,
    series: [
      { look: "plot-safe", band: [[-2, 0, n], [2, 0, n]] },
      ...intervals,
      { look: "plot-step", mark: "circle", marks: [], line: [], words: "after each point (the last is brightest), 95 %" },
    ],
  });
}
