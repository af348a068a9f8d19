/**
 * Figures of a monitor and of a lead-time study, each with caption and key.
 *
 * calibrationFigure and curvesFigure have mark({epsilon, rank}).   preventionFigure: null if not simulated
 * leadsFigure(test, recipe, what, alike)   what: "power_at_epsilon" or "prevented_alike" of a sweep's planned test;
 *     alike: share of safe flights with an alert at which the latter compares methods
 */

import { createFigure, EPSILON, SPARE, UNIT_SHARE } from "../charts/figure.js";
import { figure as number, percent } from "../lib/numbers.js";

const METHOD_MARKS = ["circle", "square", "triangle", "diamond", "plus", "cross", "star"];
const CEILING = "ceiling";
const MOST_MARKED = 120; // calibration scores with a mark each
const PROMISE = { look: "plot-promise", line: [[0, 0], [1, 1]] };
const MISSES = "miss rate: valid failing flights without a timely alert";
const QUIET = "safe flights without a false alarm";
const STOPPED = "flown again, with neutral controls after the reaction time";
/** [s] Reaction time of the shown prevention: a pilot who waits for the call. */
const USUAL_REACTION_S = 0.5;

const markOf = (k) => METHOD_MARKS[(k + 3 * Math.floor(k / METHOD_MARKS.length)) % METHOD_MARKS.length];
const every = (step, points, first = 0) => points.filter((_, k) => k % step === first);
const bandOf = (at, intervals) => intervals.map(([low, high], k) => [at[k], low, high]);

export function calibrationFigure({ alphas, n_unsafe, n_early, name }) {
  const finite = alphas.filter((alpha) => alpha !== null);
  const [low, high] = finite.length ? [finite[0], finite.at(-1)] : [-1, 1];
  const spare = 0.12 * (high - low || 1);
  const top = high + spare;
  const early = alphas.slice(finite.length).map((_, k) => [finite.length + k + 1, top]);
  const block = createFigure({
    title: name ? `Calibration curve: ${name}` : "Calibration curve",
    words: "Low scores are close to unsafe. A score at or below the threshold alerts: k of the failures lie there.",
    label: `${n_unsafe} sorted calibration scores from ${number(low)} to ${number(high)}`,
    x: { label: "rank k of the failure, by score", domain: [0, n_unsafe + 1] },
    y: { label: "calibration score α", domain: [low - spare, top] },
    series: [
      {
        look: "plot-step",
        line: finite.flatMap((alpha, k) => [[k + 0.5, alpha], [k + 1.5, alpha]]),
        mark: "circle",
        marks: finite.length > MOST_MARKED ? [] : finite.map((alpha, k) => [k + 1, alpha]),
        words: "one failure each",
      },
      { look: "plot-epsilon", words: "rank and threshold at epsilon" },
      {
        look: "plot-unsafe",
        mark: "triangle",
        marks: n_early ? early : [],
        words: n_early && `${n_early} failed too early for a warning: above every score`,
      },
    ],
    rules: [{ x: n_unsafe, look: "plot-epsilon" }, { y: high, look: "plot-epsilon plot-level" }],
  });
  const [rank, level] = block.rules;
  block.mark = ({ epsilon, rank: k }) => {
    const threshold = alphas[k - 1] ?? Infinity;
    rank.move(k, `k = ${k} of ${n_unsafe}, ε = ${number(epsilon)}`);
    const words = Number.isFinite(threshold) ? `threshold ${number(threshold)}` : "every score alerts";
    level.move(Math.min(threshold, top), words);
  };
  return block;
}

export function curvesFigure({ curves, n_unsafe, n_safe }) {
  const { epsilon } = curves;
  const seriesOf = (values, intervals, look, mark, words) => {
    if (values[0] === null) return { look, mark, line: [], words };
    const line = values.map((value, k) => [epsilon[k], value]);
    return { look, line, band: bandOf(epsilon, intervals), mark, marks: every(4, line), words };
  };
  const block = createFigure({
    title: `Miss rate, and ${QUIET}`,
    words: `Measured on ${n_unsafe} failing and ${n_safe} safe fresh flights; bands are 95 % intervals.`,
    label: `Miss rate and share of ${QUIET}, of ${n_unsafe} failing and ${n_safe} safe fresh flights against epsilon, with 95 % intervals`,
    x: EPSILON,
    y: { label: "share of flights", ...UNIT_SHARE },
    series: [
      PROMISE,
      seriesOf(curves.power, curves.power_interval, "plot-power", "circle", QUIET),
      seriesOf(curves.miss_rate, curves.miss_interval, "plot-miss", "square", MISSES),
      { look: PROMISE.look, words: "promise: miss = epsilon" },
    ],
    rules: [{ x: epsilon[0] ?? 0, look: "plot-epsilon" }],
  });
  const [at] = block.rules;
  block.mark = ({ epsilon: chosen }) => at.move(chosen, `ε = ${number(chosen)}`);
  return block;
}

export function leadFigure({ leads, lead, epsilon, n_unsafe }) {
  const { edges, counts, n_without, n_timely, p05, median, p95 } = leads;
  const bars = counts.map((count, k) => [edges[k], edges[k + 1], 0, count]);
  const isLate = ([, end]) => end <= lead + 1e-9;
  const spread = `Median ${number(median)} s, 5–95 % ${number(p05)} to ${number(p95)} s.`;
  const middle = median === null ? "No failing flight had an alert." : spread;
  return createFigure({
    title: `Warning lead times at ε = ${number(epsilon)}`,
    words: `${middle} ${n_timely} of ${n_unsafe} failing flights were warned in time, ${n_without} had no alert.`,
    label: `Warning lead times of ${n_unsafe} failing flights: median ${number(median)} s, ${n_timely} at least ${number(lead)} s, ${n_without} without an alert`,
    x: { label: "time from the first alert to the failure [s]", domain: [0, edges.at(-1)] },
    y: { label: "failing flights", domain: [0, SPARE * Math.max(1, ...counts)] },
    series: [
      { look: "plot-safe-bar", bars: bars.filter((bar) => !isLate(bar)), words: "in time" },
      { look: "plot-unsafe-bar", bars: bars.filter(isLate), words: "too late" },
    ],
    rules: [{ x: lead, look: "plot-limit", words: `promised ${number(lead)} s` }],
  });
}

export function preventionFigure({ prevention, epsilon }) {
  if (!prevention?.n_unsafe) return null;
  const { reactions_s: reactions, prevented, prevented_interval: intervals, n_unsafe } = prevention;
  const { stopped, n_safe, caused } = prevention;
  const shares = prevented.map((count, k) => [reactions[k], count / n_unsafe]);
  const harmed = Math.max(...caused);
  return createFigure({
    title: `Failures that an alert prevents, at ε = ${number(epsilon)}`,
    words: `Safe flights stopped unnecessarily: ${stopped} of ${n_safe}${harmed ? `; stopping made up to ${harmed} of them fail` : ""}. Reaction times scatter by 30 %.`,
    label: `Failures prevented: ${shares.map(([reaction, share]) => `${percent(share, 0)} at ${number(reaction)} s`).join(", ")}`,
    x: { label: "mean time from the alert to neutral controls [s]", domain: [0, reactions.at(-1) * 1.05] },
    y: { label: "share of failing flights prevented", ...UNIT_SHARE },
    series: [{ look: "plot-power", line: shares, band: bandOf(reactions, intervals), mark: "circle", words: STOPPED }],
  });
}

export function leadsFigure({ cells, earliest_s: earliest }, { reactions_s: reactions, epsilon }, what, alike) {
  const isPower = what === "power_at_epsilon";
  const distances = reactions.map((time) => Math.abs(time - USUAL_REACTION_S));
  const at = distances.indexOf(Math.min(...distances));
  const name = isPower ? "Safe flights without a false alarm" : "Failures that the alert prevents";
  const methods = [...new Set(cells.map(({ method }) => method))];
  const seriesOf = (method, k) => ({
    look: method === CEILING ? "plot-promise" : `plot-method-${k}`,
    mark: method === CEILING ? "cross" : markOf(k),
    line: cells
      .filter((cell) => cell.method === method)
      .map((cell) => [cell.lead, isPower ? cell[what] : cell[what][at]])
      .sort(([a], [b]) => a - b),
    words: method,
  });
  return createFigure({
    title: `${name} against warning lead time`,
    words: isPower
      ? `Each method misses ${percent(epsilon, 0)} of the failing flights. Higher is better.`
      : `Each method alerts on ${percent(alike, 0)} of the safe flights; controls are neutral ${number(reactions[at])} s after the alert. Compare methods by this figure.`,
    label: `${name} of ${methods.length} methods against the warning lead time`,
    x: { label: "warning lead time [s]", domain: [0, 1.05 * Math.max(earliest, ...cells.map(({ lead }) => lead))] },
    y: { label: isPower ? "share of safe flights" : "share of failing flights", ...UNIT_SHARE },
    series: methods.map(seriesOf),
    rules: [{ x: earliest, look: "plot-limit", words: "1 in 20 has failed" }],
  });
}
