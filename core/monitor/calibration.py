"""Conformal calibration: from scores of past failures to p-values, ranks and alerts."""

import math
from typing import Literal

import numpy as np
import numpy.typing as npt

from core.types import Array

Guarantee = Literal["average", "95%"]
"""The promise on the miss rate: on average over calibration sets, or of this monitor by itself, but
for one calibration set in twenty."""
CONFIDENCE = 0.95


def p_values(scores: npt.ArrayLike, alphas: Array) -> Array:
    """Conformal p-value of each score: how much it resembles a past failure; high means risk.

    scores: (n,) low means close to unsafe; NaN where there is no score.
    alphas: (n_unsafe,) sorted calibration scores; +inf for a failure too early to be warned of.
    Returns (n,) in [1/(n_unsafe+1), 1]; NaN where the score is NaN.
    """
    scores = np.asarray(scores, np.float64)
    at_least = len(alphas) - np.searchsorted(alphas, scores, side="left")
    return np.where(np.isnan(scores), np.nan, (at_least + 1) / (len(alphas) + 1))


def rank(epsilon: float, n_unsafe: int) -> int:
    """Rank k of the alert threshold: alert iff s <= alpha_(k); alpha_(n_unsafe+1) = +inf.

    k = ceil((n_unsafe + 1) (1 - epsilon)), in integers: floats get it one too high.
    """
    return n_unsafe + 1 - math.floor(epsilon * (n_unsafe + 1) + 1e-9)


def threshold(epsilon: float, alphas: Array) -> float:
    """Highest score that alerts: the same rule as p_value > epsilon, strictly."""
    k = rank(epsilon, len(alphas))
    return math.inf if k > len(alphas) else float(alphas[k - 1]) if k >= 1 else -math.inf


def confident_rank(epsilon: float, n_unsafe: int) -> int:
    """Largest j with P(Beta(j, n_unsafe + 1 - j) > epsilon) <= 5 %; 0 where there is none.

    A monitor that alerts at p_value > j / (n_unsafe + 1) misses at most epsilon with 95 %
    confidence over calibration sets: exactly so where these chose nothing, by experience for scores
    of nearest neighbours, which leave one failure out.
    """
    from scipy.special import bdtr  # slow to import, and only needed here

    missed = bdtr(np.arange(n_unsafe), n_unsafe, epsilon)
    return int(np.count_nonzero(missed <= 1 - CONFIDENCE + 1e-12))


def smallest_epsilon(n_unsafe: int, guarantee: Guarantee = "average", n_early: int = 0) -> float:
    """Smallest miss rate that n_unsafe failures can serve; below it every sample would alert.

    n_early: failures before any warning; the promise with confidence is refused for them, the one
    on average only alerts always.
    """
    if guarantee == "average":
        return 1 / (n_unsafe + 1)
    if n_early >= n_unsafe:
        return 1.0
    from scipy.special import betaincinv  # slow to import, and only needed here

    return float(betaincinv(n_early + 1, n_unsafe - n_early, CONFIDENCE))


def failures_needed(epsilon: float, guarantee: Guarantee = "average") -> int:
    """Failures that serve a miss rate at least."""
    if guarantee == "average":
        return math.ceil(min(1 / epsilon, 1e18) - 1 - 1e-9)
    return math.ceil(min(math.log(1 - CONFIDENCE) / math.log1p(-epsilon), 1e18) - 1e-9)


def alert_above(epsilon: float, n_unsafe: int, guarantee: Guarantee = "average") -> float:
    """Return the p-value above which a monitor alerts that promises this miss rate.

    For the promise on average that is epsilon, on the grid of p-values where a float just misses
    it.   ValueError where so few failures cannot serve it, with how many could.
    """
    epsilon = check_epsilon(epsilon, n_unsafe, guarantee)
    if guarantee == "average":
        return epsilon
    return confident_rank(epsilon, n_unsafe) / (n_unsafe + 1)


def check_epsilon(epsilon: float, n_unsafe: int, guarantee: Guarantee = "average") -> float:
    """Return epsilon, on the grid of p-values where a float just misses it; or refuse it.

    ValueError where n_unsafe failures cannot serve it, with how many could.
    """
    if not 0 < epsilon < 1:
        raise ValueError(f"epsilon={epsilon} was given: a miss rate lies between 0 and 1")
    needed = failures_needed(epsilon, guarantee)
    if n_unsafe < needed:
        served = math.ceil(1e4 * smallest_epsilon(n_unsafe, guarantee)) / 1e4
        with_confidence = "" if guarantee == "average" else " with 95 % confidence"
        raise ValueError(
            f"epsilon={epsilon:g}{with_confidence} needs at least {needed} unsafe rollouts; this "
            f"monitor has {n_unsafe}: raise epsilon to {served:g} or collect more"
        )
    if guarantee != "average":
        return epsilon
    on_grid = (n_unsafe + 1 - rank(epsilon, n_unsafe)) / (n_unsafe + 1)
    return max(epsilon, on_grid) if on_grid < 1 else epsilon
