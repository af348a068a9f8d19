/**
 * What an epsilon costs: a slider, with the rates measured on fresh flights at each epsilon.
 *
 * calibration: with its rule at each epsilon.   evaluation: null if the monitor was not tested here
 * changed({epsilon, rank})   at once and at each move
 */

import { guideLink, h, panel, svg } from "../lib/dom.js";
import { warningLines } from "../lib/monitors.js";
import { count, counted, figure, interval, percent } from "../lib/numbers.js";
import { neededFor } from "./train_form.js";

/** [name, key, its rate, its 95 % interval, words] */
const MEASURES = [
  ["Missed failures", "miss", "miss_rate", "miss_interval", "of failing flights: valid, no timely alert"],
  ["Safe flights without a false alarm", "power", "power", "power_interval", "of safe flights: valid, no alert"],
  ["P(fail | alert)", "fail", "fail_given_alert", "fail_given_alert_interval", "of flights with an alert fail, at the simulated unsafe rate"],
];
const SAME = 1e-9;

export function createEpsilonCost({ monitor, calibration, evaluation, changed }) {
  const points = pointsOf(calibration, evaluation);
  const names = calibration.groups.map(({ name }) => ` for ${name}`);
  const own = points.findIndex(({ epsilon }) => Math.abs(epsilon - monitor.epsilon) < SAME);
  const last = points.length - 1;
  const slider = h("input.epsilon-slider", { type: "range", min: 0, max: last, id: "epsilon", oninput: move });
  slider.value = Math.max(own, 0);
  const reading = h("output.epsilon-reading", { for: "epsilon" });
  const rule = h("p.dim");
  const meters = MEASURES.map(meter);
  const counts = h("p.hint", { "data-counts": "" });
  const warnings = h("div");
  const guarantee = h("p.guarantee-number");
  const unmeasured = "Not measured: this monitor was not tested on fresh flights here. Train one like it to measure.";
  const measured = evaluation
    ? [h("div.meters", meters.map(({ row }) => row)), counts]
    : h("p.hint", unmeasured);
  const ends = [
    h("span", `${figure(points[0].epsilon)}: fewer misses, more alerts`),
    h("span", `more misses, fewer alerts: ${figure(points[last].epsilon)}`),
  ];
  const content = [
    h("label.hint", { for: "epsilon" }, "epsilon: accepted share of missed failures"),
    slider,
    h("div.spread-ends.hint", ends),
    rule,
    measured,
    warnings,
    guarantee,
    enough(monitor, names.length),
  ];
  const title = ["What an epsilon costs ", guideLink("what-the-numbers-mean#epsilon", "epsilon")];
  const element = panel(title, content, { class: "panel stack", beside: reading, "aria-label": "What an epsilon costs" });
  const promised = monitor.recipe.guarantee ?? "average";
  const cost = { element, epsilon: points[slider.value].epsilon };
  move();
  return cost;

  function move() {
    const point = points[slider.value];
    const { epsilon, rank, alert_above: above, miss_rates: [low, high] } = point;
    cost.epsilon = epsilon;
    reading.textContent = `ε = ${figure(epsilon)}`;
    slider.setAttribute("aria-valuetext", `epsilon ${figure(epsilon)}`);
    rule.textContent =
      `To keep this epsilon, the monitor alerts at risk > ${figure(above)}: score at most ${levels(point)} (rank ${rank} of ${monitor.n_unsafe}).` +
      (Number(slider.value) === own ? " This is the monitor's own epsilon." : "");
    for (const { show } of meters) show(point);
    if (evaluation) counts.textContent = countsInWords(point, evaluation);
    warnings.replaceChildren(...warningLines({ warnings: point.warnings ?? [] }));
    guarantee.textContent =
      `Promised ${promised === "average" ? "on average over calibration sets" : "with 95 % confidence in this monitor"}: at most ${percent(epsilon)} missed. ` +
      `One monitor calibrated on ${failures(monitor, names.length)} may miss between ${percent(low, 0)} and ${percent(high, 0)} (5–95 %).` +
      (evaluation ? " See measured misses above." : "");
    changed({ epsilon, rank });
  }

  function levels({ scores }) {
    const words = scores.map((score, k) => `${score === null ? "anything" : figure(score)}${names[k] ?? ""}`);
    return words.join("; ") + (words.length > 1 ? "; while the group is unknown, any possible one" : "");
  }
}

/** Each test flight is in one count. Flights called INVALID are neither missed nor quiet. */
function countsInWords({ misses, withdrawn, false_alerts, safe_withdrawn }, { n_unsafe, n_safe }) {
  const among = (total, parts) => [...parts.map(([n, words]) => `${count(n)} ${words}`), `of ${count(total)}`].join(", ");
  if (withdrawn === undefined || safe_withdrawn === undefined)
    return "Flights called INVALID were not counted; they are among those without an alert.";
  return (
    `Failing flights: ${among(n_unsafe, [[misses, "missed"], [withdrawn, "called INVALID before an alert"], [n_unsafe - misses - withdrawn, "warned in time"]])}. ` +
    `Safe flights: ${among(n_safe, [[false_alerts, "with a false alarm"], [safe_withdrawn, "called INVALID without an alert"], [n_safe - false_alerts - safe_withdrawn, "valid and quiet"]])}.`
  );
}

function failures({ n_unsafe }, nGroups) {
  return nGroups > 1 ? `${counted(n_unsafe, "failure")} of each group` : counted(n_unsafe, "failure");
}

function enough(monitor, nGroups) {
  const { smallest_epsilon: smallest, recipe } = monitor;
  const half = Number((smallest / 2).toPrecision(2));
  const each = nGroups > 1 ? " of each group" : "";
  const more = `For ε = ${figure(half, 2)}, train on at least ${neededFor(half, recipe.guarantee)}${each}.`;
  return h("p.hint", `${failures(monitor, nGroups)}: enough for ε ≥ ${figure(smallest)}. ${more}`);
}

/** The rule at each epsilon, with what was measured there. */
function pointsOf({ rules }, evaluation) {
  const measured = evaluation ? measuredPoints(evaluation) : [];
  return rules.map((rule) => ({ ...measured.find(({ epsilon }) => Math.abs(epsilon - rule.epsilon) < SAME), ...rule }));
}

function measuredPoints({ curves, at_epsilon: own }) {
  const at = (k) => Object.fromEntries(Object.entries(curves).map(([key, values]) => [key, values[k]]));
  return [...curves.epsilon.map((_, k) => at(k)), own];
}

function meter([name, key, rate, bounds, words]) {
  const value = h("strong.meter-value");
  const range = svg("rect.meter-range", { y: 3, height: 10 });
  const mark = svg("path.meter-mark");
  const promise = svg("path.meter-promise");
  const look = { viewBox: "0 0 300 16", preserveAspectRatio: "none", "aria-hidden": "true" };
  const track = svg("svg.meter", look, svg("rect.meter-track", { y: 6, width: 300, height: 4 }), range, promise, mark);
  const shown = h("span.hint");
  const parts = [h("span.meter-name", name), value, track, h("span.meter-words", words, " ", shown)];
  return { row: h("div.meter-row", { "data-measure": key }, parts), show };

  function show(point) {
    const share = point[rate];
    const isKnown = share != null;
    value.textContent = percent(share);
    shown.textContent = isKnown ? `(95 %: ${interval(point[bounds])})` : "(no such flight)";
    if (!isKnown) return;
    const [low, high] = point[bounds];
    range.setAttribute("x", 300 * low);
    range.setAttribute("width", Math.max(300 * (high - low), 1));
    mark.setAttribute("d", `M${300 * share} 0V16`);
    if (key === "miss") promise.setAttribute("d", `M${300 * point.epsilon} 0V16`);
  }
}
