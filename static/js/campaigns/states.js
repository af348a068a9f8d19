/** Words and levels of the points of a campaign. */

import { chip } from "../lib/dom.js";
import { count, figure, percent } from "../lib/numbers.js";

const LEVELS = {
  planned: "off",
  "on condition": "caution",
  cleared: "ok",
  hold: "alert",
  complete: "advisory",
  aborted: "off",
};

export function stateChip(state) {
  return chip(state, LEVELS[state]);
}

export function predictedWords(clearing) {
  if (!clearing) return "–";
  const [low, middle, high] = clearing.reached.map((part) => percent(part, 0));
  return `${clearing.withdrawn.length ? "withdrawn: " : ""}${middle} (${low} to ${high})`;
}

export function reachedWords({ state, flown: { reached, exceeded, passed } }) {
  if (exceeded) return `▲ ${percent(reached, 0)}, exceeded ${exceeded}`;
  return passed ? percent(reached, 0) : `◆ ${percent(reached, 0)}, ${state === "aborted" ? "aborted" : "not passed"}`;
}

export function failedWords({ name, state, flown: { reached, exceeded } }) {
  const fate = exceeded ? `exceeded ${exceeded}` : state === "aborted" ? "was aborted" : "did not pass";
  return `${exceeded ? "▲" : "◆"} The step before, ${name}, ${fate}: it reached ${percent(reached, 0)} of a limit.`;
}

/** Rounded up, to stay a bound. */
export function percentAtMost(share) {
  return percent(Math.ceil(1e4 * share - 1e-9) / 1e4, 2);
}

export function promiseWords({ recipe, n_exceeding: n, n_tried: tried, p_value: p, withdrawn, exceeding_at_most: most, monitor_epsilon: epsilon }) {
  if (withdrawn.length) return "No promise: the prediction for this point does not hold.";
  if (p === null) return `${n} of ${count(tried)} simulated aircraft exceed a limit here${most === null ? "" : ` (at most ${percentAtMost(most)}, 95 % confidence)`}: too few to calibrate on. The prediction alone decides.`;
  const how = recipe.guarantee === "average" ? "on average over calibrations" : "with 95 % confidence";
  const missed = epsilon ? `flown without an alert in time, with this point's monitor at ε = ${figure(epsilon, 2)}` : "cleared";
  return `At most ${percent(recipe.epsilon)} of the points that would exceed a limit are ${missed}, ${how}. The p-value is calibrated on ${n} simulated aircraft that exceed a limit.`;
}
