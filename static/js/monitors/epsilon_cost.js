/**
 * What an epsilon costs: a slider, with the rates measured on fresh flights at each epsilon.
 *
 * Exports
 *   createEpsilonCost({monitor, calibrations, evaluation, changed}) -> {element, epsilon}
 *     calibrations: one, or one for each group of failing flights
 *     evaluation: null if the monitor was not tested here
 *     changed({epsilon, rank})   at once and at each move
 */

import { h, svg } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { warningLines } from "../lib/monitor_warnings.js";
import { figure, interval, percent } from "../lib/numbers.js";
import { alertAbove, neededFor, rank, scatter, threshold } from "./calibration_rule.js";

const MEASURES = [
  {
    name: "Missed failures",
    key: "miss",
    rate: "miss_rate",
    words: "of failing flights: valid, no timely alert",
  },
  {
    name: "Safe flights without a false alarm",
    key: "power",
    rate: "power",
    words: "of safe flights: valid, no alert",
  },
  {
    name: "P(fail | alert)",
    key: "fail",
    rate: "fail_given_alert",
    words: "of flights with an alert fail, at the simulated unsafe rate",
  },
];

export function createEpsilonCost({ monitor, calibrations, evaluation, changed }) {
  const points = pointsOf(monitor, evaluation);
  const own = points.findIndex(({ epsilon }) => Math.abs(epsilon - monitor.epsilon) < 1e-9);
  const slider = h("input", {
    type: "range",
    min: 0,
    max: points.length - 1,
    step: 1,
    id: "epsilon",
    class: "epsilon-slider",
    oninput: move,
  });
  slider.value = Math.max(own, 0);
  const reading = h("output", { for: "epsilon", class: "epsilon-reading" });
  const rule = h("p", { class: "dim" });
  const rows = MEASURES.map(meter);
  const counts = h("p", { class: "hint", "data-counts": "" });
  const warnings = h("div");
  const guarantee = h("p", { class: "guarantee-number" });
  const element = h(
    "section",
    { class: "panel stack", "aria-labelledby": "epsilon-title" },
    h(
      "div",
      { class: "row" },
      h("h2", { class: "panel-title", id: "epsilon-title" }, "What an epsilon costs ", guideLink("what-the-numbers-mean#epsilon", "epsilon")),
      reading,
    ),
    h(
      "label",
      { for: "epsilon", class: "hint" },
      "epsilon: accepted share of missed failures",
    ),
    slider,
    h(
      "div",
      { class: "spread-ends hint" },
      h("span", {}, `${figure(points[0].epsilon)}: fewer misses, more alerts`),
      h("span", {}, `more misses, fewer alerts: ${figure(points.at(-1).epsilon)}`),
    ),
    rule,
    evaluation
      ? h(
          "div",
          { class: "meters" },
          rows.map(({ row }) => row),
        )
      : h(
          "p",
          { class: "hint" },
          "Not measured: this monitor was not tested on fresh flights here. Train one like it to measure.",
        ),
    evaluation && counts,
    warnings,
    guarantee,
    enough(monitor, calibrations.length),
  );
  const promised = monitor.recipe.guarantee ?? "average";
  const cost = { element, epsilon: points[slider.value].epsilon };
  move();
  return cost;

  function move() {
    const point = points[slider.value];
    const { epsilon } = point;
    const k = rank(epsilon, monitor.n_unsafe, promised);
    cost.epsilon = epsilon;
    reading.textContent = `ε = ${figure(epsilon)}`;
    slider.setAttribute("aria-valuetext", `epsilon ${figure(epsilon)}`);
    rule.textContent =
      `To keep this epsilon, the monitor alerts at risk > ${figure(alertAbove(epsilon, monitor.n_unsafe, promised))}: score at most ${levels(epsilon)} (rank ${k} of ${monitor.n_unsafe}).` +
      (Number(slider.value) === own ? " This is the monitor's own epsilon." : "");
    for (const { show } of rows) show(point, epsilon);
    if (evaluation) counts.textContent = countsInWords(point, evaluation);
    warnings.replaceChildren(...warningLines({ warnings: point.warnings ?? [] }));
    const [low, high] = scatter(epsilon, monitor.n_unsafe, promised);
    const range = `${percent(low, 0)} and ${percent(high, 0)} (5–95 %)`;
    guarantee.textContent =
      `Promised ${promised === "average" ? "on average over calibration sets" : "with 95 % confidence in this monitor"}: at most ${percent(epsilon)} missed. ` +
      `One monitor calibrated on ${failures(monitor, calibrations.length)} may miss between ${range}.` +
      (evaluation ? " See measured misses above." : "");
    changed({ epsilon, rank: k });
  }

  function levels(epsilon) {
    const words = calibrations.map(({ name, alphas }) => {
      const level = threshold(epsilon, alphas, promised);
      return `${Number.isFinite(level) ? figure(level) : "anything"}${name ? ` for ${name}` : ""}`;
    });
    return words.join("; ") + (words.length > 1 ? "; while the group is unknown, any possible one" : "");
  }
}

/** Each test flight is in one count. Flights called INVALID are neither missed nor quiet. */
function countsInWords({ misses, withdrawn, false_alerts, safe_withdrawn }, { n_unsafe, n_safe }) {
  const among = (total, parts) => parts.map(([n, words]) => `${n.toLocaleString("en")} ${words}`).join(", ") + `, of ${total.toLocaleString("en")}`;
  if (withdrawn === undefined || safe_withdrawn === undefined)
    return "Flights called INVALID were not counted; they are among those without an alert.";
  return (
    `Failing flights: ${among(n_unsafe, [[misses, "missed"], [withdrawn, "called INVALID before an alert"], [n_unsafe - misses - withdrawn, "warned in time"]])}. ` +
    `Safe flights: ${among(n_safe, [[false_alerts, "with a false alarm"], [safe_withdrawn, "called INVALID without an alert"], [n_safe - false_alerts - safe_withdrawn, "valid and quiet"]])}.`
  );
}

function failures({ n_unsafe }, nGroups) {
  return nGroups > 1 ? `${n_unsafe} failures of each group` : `${n_unsafe} failures`;
}

function enough(monitor, nGroups) {
  const { smallest_epsilon, recipe } = monitor;
  const half = smallest_epsilon / 2;
  return h(
    "p",
    { class: "hint" },
    `${failures(monitor, nGroups)}: enough for ε ≥ ${figure(smallest_epsilon)}. For ε = ${figure(half, 2)}, train on at least ${neededFor(Number(half.toPrecision(2)), recipe.guarantee)}${nGroups > 1 ? " of each group" : ""}.`,
  );
}

/** Measurements at each epsilon: the grid, and the monitor's own epsilon. */
function pointsOf(monitor, evaluation) {
  if (!evaluation) {
    const grid = Array.from({ length: 49 }, (_, k) => (k + 1) / 50).filter(
      (epsilon) => epsilon >= monitor.smallest_epsilon,
    );
    return merged([...grid, monitor.epsilon].map((epsilon) => ({ epsilon })));
  }
  const { curves, at_epsilon: own } = evaluation;
  return merged([
    ...curves.epsilon.map((_, k) =>
      Object.fromEntries(Object.entries(curves).map(([key, values]) => [key, values[k]])),
    ),
    own,
  ]);
}

function merged(points) {
  const sorted = points.sort((a, b) => a.epsilon - b.epsilon);
  return sorted.filter(({ epsilon }, k) => k === 0 || epsilon - sorted[k - 1].epsilon > 1e-9);
}

function meter({ name, key, rate, words }) {
  const value = h("strong", { class: "meter-value" });
  const bounds = h("span", { class: "hint" });
  const range = svg("rect", { class: "meter-range", y: 3, height: 10 });
  const mark = svg("path", { class: "meter-mark" });
  const promise = svg("path", { class: "meter-promise" });
  const track = svg(
    "svg",
    { class: "meter", viewBox: "0 0 300 16", preserveAspectRatio: "none", "aria-hidden": "true" },
    svg("rect", { class: "meter-track", y: 6, width: 300, height: 4 }),
    range,
    promise,
    mark,
  );
  const row = h(
    "div",
    { class: "meter-row", "data-measure": key },
    h("span", { class: "meter-name" }, name),
    value,
    track,
    h("span", { class: "meter-words" }, words, " ", bounds),
  );
  return { row, show };

  function show(point, epsilon) {
    const share = point[rate];
    const known = share !== null && share !== undefined;
    value.textContent = percent(share);
    bounds.textContent = known
      ? `(95 %: ${interval(point[`${rate === "miss_rate" ? "miss" : rate}_interval`])})`
      : "(no such flight)";
    if (!known) return;
    const [low, high] = point[`${rate === "miss_rate" ? "miss" : rate}_interval`];
    range.setAttribute("x", 300 * low);
    range.setAttribute("width", Math.max(300 * (high - low), 1));
    mark.setAttribute("d", `M${300 * share} 0V16`);
    if (key === "miss") promise.setAttribute("d", `M${300 * epsilon} 0V16`);
  }
}
