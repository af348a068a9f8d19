/**
 * The monitor's rule in numbers: rank, threshold, and the scatter of the miss rate.
 *
 * guarantee: "average" over calibration sets, or "95%" confidence in this monitor.
 *
 * rank(epsilon, n, guarantee) -> k                alert iff score <= alpha_(k); n + 1: always
 * alertAbove(epsilon, n, guarantee) -> risk       the same rule, as a risk
 * threshold(epsilon, alphas, guarantee) -> score  alphas sorted, null: failed too early for a warning
 * neededFor(epsilon, guarantee) -> n              fewest failures that are enough for epsilon
 * leastFor(n, guarantee) -> epsilon               smallest that n failures are enough for
 * scatter(epsilon, n, guarantee) -> [low, high]   5 to 95 % quantiles of the miss rate of monitors calibrated on n failures
 */

const DOUBT = 0.05;

export function rank(epsilon, n, guarantee = "average") {
  return n + 1 - allowed(epsilon, n, guarantee);
}

/** Number of failures whose score may lie above the threshold. */
function allowed(epsilon, n, guarantee) {
  if (guarantee === "average") return Math.floor(epsilon * (n + 1) + 1e-9);
  let [j, missed] = [0, 1 - atLeast(1, n, epsilon)]; // P(at most j of n failures are missed)
  while (j < n && missed <= DOUBT + 1e-12) missed = 1 - atLeast(++j + 1, n, epsilon);
  return j;
}

export function alertAbove(epsilon, n, guarantee = "average") {
  return guarantee === "average" ? epsilon : allowed(epsilon, n, guarantee) / (n + 1);
}

export function threshold(epsilon, alphas, guarantee = "average") {
  const k = rank(epsilon, alphas.length, guarantee);
  return k > alphas.length ? Infinity : (alphas[k - 1] ?? Infinity);
}

export function neededFor(epsilon, guarantee = "average") {
  const n = guarantee === "average" ? 1 / epsilon - 1 : Math.log(DOUBT) / Math.log1p(-epsilon);
  return Math.ceil(n - 1e-9);
}

export function leastFor(n, guarantee = "average") {
  return guarantee === "average" ? 1 / (n + 1) : 1 - DOUBT ** (1 / n);
}

export function scatter(epsilon, n, guarantee = "average") {
  // the miss rate given the calibration set is Beta(j, n + 1 - j), j failures above the threshold
  const j = allowed(epsilon, n, guarantee);
  return j < 1 ? [0, 0] : [quantile(0.05, j, n), quantile(0.95, j, n)];
}

function quantile(probability, j, n) {
  let [low, high] = [0, 1];
  for (let step = 0; step < 40; step++) {
    const middle = (low + high) / 2;
    if (atLeast(j, n, middle) < probability) low = middle;
    else high = middle;
  }
  return (low + high) / 2;
}

/** P(at least j of n), each with chance x: the distribution function of Beta(j, n + 1 - j) at x. */
function atLeast(j, n, x) {
  let logTerm = n * Math.log1p(-x);
  let below = 0;
  for (let i = 0; i < j; i++) {
    below += Math.exp(logTerm);
    logTerm += Math.log(((n - i) / (i + 1)) * (x / (1 - x)));
  }
  return 1 - below;
}
