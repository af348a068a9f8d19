/**
 * What the states of a campaign's points look like, and what is said of a point.
 *
 * Exports
 *   stateChip(state) -> element
 *   predictedWords(clearing), reachedWords(point) -> text
 *   promiseWords(clearing) -> text      what its clearance promises
 *   percentAtMost(share) -> text        a bound
 */

import { h } from "../lib/dom.js";
import { figure, percent } from "../lib/numbers.js";

const LEVELS = { planned: "off", "on condition": "caution", cleared: "ok", hold: "alert", complete: "advisory", aborted: "off" };

export function stateChip(state) {
  return h("span", { class: "chip", "data-level": LEVELS[state] }, state);
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

/** Rounded up, as it would be no bound otherwise. */
export function percentAtMost(share) {
  return percent(Math.ceil(1e4 * share - 1e-9) / 1e4, 2);
}

export function promiseWords({ recipe, n_exceeding: n, n_tried: tried, p_value: p, withdrawn, exceeding_at_most: most }) {
  if (withdrawn.length) return "Nothing is promised of this point, and what was predicted of it does not hold.";
  if (p === null) return `Hardly any of ${tried.toLocaleString("en")} simulated aircraft exceeds a limit there: ${n}${most === null ? "" : ` (at most ${percentAtMost(most)}, 95 % confidence)`}. The prediction alone decides.`;
  const how = recipe.guarantee === "average" ? "on average over calibrations" : "with 95 % confidence";
  return `Of the points that would exceed a limit, at most a share ${figure(recipe.epsilon)} is cleared, ${how}; calibrated on ${n} simulated aircraft that exceed, of flights as they were simulated.`;
}
