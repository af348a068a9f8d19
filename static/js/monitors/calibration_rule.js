/**
 * The monitor's rule in numbers: rank, threshold, and how one calibration set's miss rate scatters.
 *
 * Exports
 *   rank(epsilon, n) -> k                alert iff score <= alpha_(k); n + 1 means always
 *   threshold(epsilon, alphas) -> score  alphas sorted, null: too early to be warned of
 *   neededFor(epsilon) -> n              failures that can serve epsilon
 *   scatter(epsilon, n) -> [low, high]   5-95 % of the miss rate of monitors calibrated on n failures
 */

export function rank(epsilon, n) {
  return n + 1 - Math.floor(epsilon * (n + 1) + 1e-9);
}

export function threshold(epsilon, alphas) {
  const k = rank(epsilon, alphas.length);
  return k > alphas.length ? Infinity : (alphas[k - 1] ?? Infinity);
}

export function neededFor(epsilon) {
  return Math.ceil(1 / epsilon - 1 - 1e-9);
}

export function scatter(epsilon, n) {
  // the miss rate given the calibration set is Beta(j, n + 1 - j), j failures above the threshold
  const j = n + 1 - rank(epsilon, n);
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
