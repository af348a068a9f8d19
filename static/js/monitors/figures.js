/**
 * Figures of a monitor and of a comparison of methods. Each function returns a <figure> with caption and key.
 *
 * Exports
 *   calibrationFigure({alphas, n_unsafe, n_early, name}) -> figure, figure.mark({epsilon, rank})   name: of a group
 *   curvesFigure(evaluation) -> figure, figure.mark({epsilon})     miss rate and safe flights without a false alarm
 *   leadFigure(evaluation)                   time from the alert to the failure
 *   preventionFigure(evaluation)             share of failures prevented, by reaction time; null if not simulated
 *   methodsFigure(methods, ranking, what)    what: "miss" or "power" of a study
 *   leadsFigure(test, recipe, what, alike)   what: "power_at_epsilon" or "prevented_alike" of a sweep's planned test;
 *       alike: share of safe flights with an alert at which the latter compares methods
 */

import { barKey, framed, keyOf, sample, SPARE, UNIT_SHARE } from "../charts/figure.js";
import { createPlot } from "../charts/plot.js";
import { svg } from "../lib/dom.js";
import { figure as number, percent } from "../lib/numbers.js";

const METHOD_MARKS = ["circle", "square", "triangle", "diamond", "plus", "cross"];
const CEILING = "ceiling";
/** [s] Reaction time of the shown prevention: a pilot who waits for the call. */
const USUAL_REACTION_S = 0.5;

export function calibrationFigure({ alphas, n_unsafe, n_early, name }) {
  const finite = alphas.filter((alpha) => alpha !== null);
  const [low, high] = finite.length ? [finite[0], finite.at(-1)] : [-1, 1];
  const spare = 0.12 * (high - low || 1);
  const top = high + spare;
  const plot = createPlot({
    x: { label: "rank k of the failure, by score", domain: [0, n_unsafe + 1] },
    y: { label: "calibration score α", domain: [low - spare, top] },
    label: `${n_unsafe} sorted calibration scores from ${number(low)} to ${number(high)}`,
  });
  const steps = finite.flatMap((alpha, k) => [
    [k + 0.5, alpha],
    [k + 1.5, alpha],
  ]);
  plot.line(steps, "plot-step");
  if (finite.length <= 120)
    plot.marks(
      finite.map((alpha, k) => [k + 1, alpha]),
      "circle",
      "plot-step",
    );
  if (n_early)
    plot.marks(
      alphas.slice(finite.length).map((_, k) => [finite.length + k + 1, top]),
      "triangle",
      "plot-unsafe",
    );
  const rank = plot.vertical(n_unsafe, "plot-epsilon", "");
  const level = plot.horizontal(high, "plot-epsilon plot-level", "");
  const key = keyOf(
    [sample("plot-step", "circle"), "one failure each"],
    [sample("plot-epsilon"), "rank and threshold at epsilon"],
    ...(n_early
      ? [
          [
            svg("path", { d: "M17 2.8L21 10.4H13z", class: "plot-mark plot-unsafe" }),
            `${n_early} failed too early for a warning: above every score`,
          ],
        ]
      : []),
  );
  const block = framed(
    name ? `Calibration curve: ${name}` : "Calibration curve",
    plot.svg,
    key,
    "Low scores are close to unsafe. A score at or below the threshold alerts: k of the failures lie there.",
  );
  block.mark = ({ epsilon, rank: k }) => {
    const threshold = alphas[k - 1] ?? Infinity;
    rank.move(k, `k = ${k} of ${n_unsafe}, ε = ${number(epsilon)}`);
    level.move(
      Math.min(threshold, top),
      Number.isFinite(threshold) ? `threshold ${number(threshold)}` : "every score alerts",
    );
  };
  return block;
}

export function curvesFigure({ curves, n_unsafe, n_safe }) {
  const { epsilon } = curves;
  const quiet = "safe flights without a false alarm";
  const plot = createPlot({
    x: {
      label: "epsilon, the accepted miss rate",
      domain: [0, 1],
      ticks: [0, 0.2, 0.4, 0.6, 0.8, 1],
    },
    y: { label: "share of flights", ...UNIT_SHARE },
    label: `Miss rate and share of ${quiet}, of ${n_unsafe} failing and ${n_safe} safe fresh flights against epsilon, with 95 % intervals`,
  });
  plot.line(
    [
      [0, 0],
      [1, 1],
    ],
    "plot-promise",
  );
  for (const [what, name, shape] of [
    ["power", "plot-power", "circle"],
    ["miss", "plot-miss", "square"],
  ]) {
    const values = curves[what === "miss" ? "miss_rate" : "power"];
    if (values[0] === null) continue;
    plot.band(
      curves[`${what}_interval`].map(([from, to], k) => [epsilon[k], from, to]),
      name,
    );
    plot.line(
      values.map((value, k) => [epsilon[k], value]),
      name,
    );
    plot.marks(
      values.map((value, k) => [epsilon[k], value]).filter((_, k) => k % 4 === 0),
      shape,
      name,
    );
  }
  const at = plot.vertical(epsilon[0] ?? 0, "plot-epsilon", "");
  const key = keyOf(
    [sample("plot-power", "circle"), quiet],
    [sample("plot-miss", "square"), "miss rate: valid failing flights without a timely alert"],
    [sample("plot-promise"), "promise: miss = epsilon"],
  );
  const block = framed(
    `Miss rate, and ${quiet}`,
    plot.svg,
    key,
    `Measured on ${n_unsafe} failing and ${n_safe} safe fresh flights; bands are 95 % intervals.`,
  );
  block.mark = ({ epsilon: chosen }) => at.move(chosen, `ε = ${number(chosen)}`);
  return block;
}

export function leadFigure({ leads, lead, epsilon, n_unsafe }) {
  const { edges, counts, n_without, n_timely, p05, median, p95 } = leads;
  const plot = createPlot({
    x: { label: "time from the first alert to the failure [s]", domain: [0, edges.at(-1)] },
    y: { label: "failing flights", domain: [0, SPARE * Math.max(1, ...counts)] },
    label: `Warning lead times of ${n_unsafe} failing flights: median ${number(median)} s, ${n_timely} at least ${number(lead)} s, ${n_without} without an alert`,
  });
  counts.forEach((count, k) => {
    const late = edges[k + 1] <= lead + 1e-9;
    if (count)
      plot.bar(edges[k], edges[k + 1], 0, count, late ? "plot-unsafe-bar" : "plot-safe-bar");
  });
  plot.vertical(lead, "plot-limit", `promised ${number(lead)} s`);
  const key = barKey(plot, "in time", "too late");
  const middle =
    median === null
      ? "No failing flight had an alert."
      : `Median ${number(median)} s, 5–95 % ${number(p05)} to ${number(p95)} s.`;
  return framed(
    `Warning lead times at ε = ${number(epsilon)}`,
    plot.svg,
    key,
    `${middle} ${n_timely} of ${n_unsafe} failing flights were warned in time, ${n_without} had no alert.`,
  );
}

export function preventionFigure({ prevention, epsilon }) {
  if (!prevention?.n_unsafe) return null;
  const { reactions_s: reactions, prevented, prevented_interval: intervals, n_unsafe } = prevention;
  const shares = prevented.map((count, k) => [reactions[k], count / n_unsafe]);
  const plot = createPlot({
    x: { label: "mean time from the alert to neutral controls [s]", domain: [0, reactions.at(-1) * 1.05] },
    y: { label: "share of failing flights prevented", ...UNIT_SHARE },
    label: `Failures prevented: ${shares.map(([reaction, share]) => `${percent(share, 0)} at ${number(reaction)} s`).join(", ")}`,
  });
  plot.band(
    intervals.map(([from, to], k) => [reactions[k], from, to]),
    "plot-power",
  );
  plot.line(shares, "plot-power");
  plot.marks(shares, "circle", "plot-power");
  const { stopped, n_safe, caused } = prevention;
  const harmed = Math.max(...caused);
  return framed(
    `Failures that an alert prevents, at ε = ${number(epsilon)}`,
    plot.svg,
    keyOf([sample("plot-power", "circle"), "flown again, with neutral controls after the reaction time"]),
    `Safe flights stopped unnecessarily: ${stopped} of ${n_safe}${harmed ? `; stopping made up to ${harmed} of them fail` : ""}. Reaction times scatter by 30 %.`,
  );
}

export function methodsFigure(methods, ranking, what) {
  const name = what === "miss" ? "Miss rate" : "Safe flights without a false alarm";
  const plot = createPlot({
    x: {
      label: "epsilon, the accepted miss rate",
      domain: [0, 1],
      ticks: [0, 0.2, 0.4, 0.6, 0.8, 1],
    },
    y: { label: name.toLowerCase(), ...UNIT_SHARE },
    label: `${name} of ${ranking.length} methods against epsilon`,
  });
  if (what === "miss")
    plot.line(
      [
        [0, 0],
        [1, 1],
      ],
      "plot-promise",
    );
  ranking.forEach((method, k) => {
    const { epsilon, [what === "miss" ? "miss_rate" : "power"]: values } = methods[method];
    if (k === 0)
      plot.band(
        methods[method][`${what}_interval`].map(([from, to], i) => [epsilon[i], from, to]),
        `plot-method-${k}`,
      );
    const points = values.map((value, i) => [epsilon[i], value]);
    plot.line(points, `plot-method-${k}`);
    plot.marks(
      points.filter((_, i) => i % 5 === k % 5),
      METHOD_MARKS[k % 5],
      `plot-method-${k}`,
    );
  });
  const key = keyOf(
    ...ranking.map((method, k) => [sample(`plot-method-${k}`, METHOD_MARKS[k % 5]), method]),
  );
  const words =
    what === "miss"
      ? "The promise is at or below the dotted line. Band: 95 % interval of the first method."
      : "Higher is better. Band: 95 % interval of the first method.";
  return framed(`${name} against epsilon`, plot.svg, key, words);
}

export function leadsFigure({ cells, earliest_s: earliest }, recipe, what, alike) {
  const isPower = what === "power_at_epsilon";
  const at = recipe.reactions_s.reduce(
    (best, time, k) =>
      Math.abs(time - USUAL_REACTION_S) < Math.abs(recipe.reactions_s[best] - USUAL_REACTION_S) ? k : best,
    0,
  );
  const name = isPower ? "Safe flights without a false alarm" : "Failures that the alert prevents";
  const names = [...new Set(cells.map(({ method }) => method))];
  const longest = Math.max(earliest, ...cells.map(({ lead }) => lead));
  const plot = createPlot({
    x: { label: "warning lead time [s]", domain: [0, 1.05 * longest] },
    y: { label: isPower ? "share of safe flights" : "share of failing flights", ...UNIT_SHARE },
    label: `${name} of ${names.length} methods against the warning lead time`,
  });
  plot.vertical(earliest, "plot-limit", "1 in 20 has failed");
  const look = (method, k) => (method === CEILING ? ["plot-promise", "cross"] : [`plot-method-${k}`, METHOD_MARKS[k]]);
  names.forEach((method, k) => {
    const [line, mark] = look(method, k);
    const points = cells
      .filter((cell) => cell.method === method)
      .map((cell) => [cell.lead, isPower ? cell[what] : cell[what][at]])
      .sort(([a], [b]) => a - b);
    plot.line(points, line);
    plot.marks(points, mark, line);
  });
  const key = keyOf(...names.map((method, k) => [sample(...look(method, k)), method]));
  const words = isPower
    ? `Each method misses ${percent(recipe.epsilon, 0)} of the failing flights. Higher is better.`
    : `Each method alerts on ${percent(alike, 0)} of the safe flights; controls are neutral ${number(recipe.reactions_s[at])} s after the alert. Compare methods by this figure.`;
  return framed(`${name} against lead`, plot.svg, key, words);
}
