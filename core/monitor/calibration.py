"""Conformal calibration: from scores of past failures to p-values, ranks and alerts."""

import math
from typing import Literal

import numpy as np
import numpy.typing as npt

from core.types import Array

Guarantee = Literal["average", "95%"]
"""Promise on the miss rate: on average over calibration sets, or for this monitor with 95 %
confidence over calibration sets."""
CONFIDENCE = 0.95


def p_values(scores: npt.ArrayLike, alphas: Array) -> Array:
    """Conformal p-value of each score: how similar it is to past failures. High means risk.

    scores: (n,) low means close to unsafe; NaN for none.
    alphas: (n_unsafe,) sorted calibration scores; +inf for failures too early for a warning.
    Returns (n,) in [1/(n_unsafe+1), 1], or NaN.
    """
    scores = np.asarray(scores, np.float64)
    at_least = len(alphas) - np.searchsorted(alphas, scores, side="left")
    return np.where(np.isnan(scores), np.nan, (at_least + 1) / (len(alphas) + 1))


def rank(epsilon: float, n_unsafe: int) -> int:
    """Rank k of the alert threshold: alert iff s <= alpha_(k); alpha_(n_unsafe+1) = +inf.

    k = ceil((n_unsafe + 1) (1 - epsilon)), in integers because floats can give k + 1.
    """
    return n_unsafe + 1 - math.floor(epsilon * (n_unsafe + 1) + 1e-9)


def threshold(epsilon: float, alphas: Array) -> float:
    """Highest score that alerts: equivalent to p_value > epsilon."""
    k = rank(epsilon, len(alphas))
    return math.inf if k > len(alphas) else float(alphas[k - 1]) if k >= 1 else -math.inf


def confident_rank(epsilon: float, n_unsafe: int) -> int:
    """Largest j with P(Beta(j, n_unsafe + 1 - j) > epsilon) <= 5 %; 0 for none.

    A monitor that alerts at p_value > j / (n_unsafe + 1) misses at most epsilon with 95 %
    confidence over calibration sets. This is exact if the calibration set chose nothing; for
    nearest-neighbour scores, which leave one failure out, it was found by simulation.
    """
    from scipy.special import bdtr  # slow to import, and only needed here

    missed = bdtr(np.arange(n_unsafe), n_unsafe, epsilon)
    return int(np.count_nonzero(missed <= 1 - CONFIDENCE + 1e-12))


def smallest_epsilon(n_unsafe: int, guarantee: Guarantee = "average", n_early: int = 0) -> float:
    """Smallest miss rate that n_unsafe failures support; below it every sample would alert.

    n_early: failures too early for a warning. They limit the guarantee with confidence; for the
    average, an epsilon too small for them only means that every sample alerts.
    """
    if guarantee == "average":
        return 1 / (n_unsafe + 1)
    if n_early >= n_unsafe:
        return 1.0
    from scipy.special import betaincinv  # slow to import, and only needed here

    return float(betaincinv(n_early + 1, n_unsafe - n_early, CONFIDENCE))


def failures_needed(epsilon: float, guarantee: Guarantee = "average") -> int:
    """Minimum number of failures that supports a miss rate."""
    if guarantee == "average":
        return math.ceil(min(1 / epsilon, 1e18) - 1 - 1e-9)
    return math.ceil(min(math.log(1 - CONFIDENCE) / math.log1p(-epsilon), 1e18) - 1e-9)


def alert_above(epsilon: float, n_unsafe: int, guarantee: Guarantee = "average") -> float:
    """p-value above which a monitor alerts, for this miss rate.

    For the average this is epsilon, moved onto the grid of p-values if rounding just misses it.
    ValueError if the failures are too few, with the number needed.
    """
    epsilon = check_epsilon(epsilon, n_unsafe, guarantee)
    if guarantee == "average":
        return epsilon
    return confident_rank(epsilon, n_unsafe) / (n_unsafe + 1)


def check_epsilon(epsilon: float, n_unsafe: int, guarantee: Guarantee = "average") -> float:
    """Return epsilon, moved onto the grid of p-values if rounding just misses it.

    ValueError if n_unsafe failures are too few, with the number needed.
    """
    if not 0 < epsilon < 1:
        raise ValueError(f"epsilon={epsilon} was given: give a miss rate between 0 and 1")
    needed = failures_needed(epsilon, guarantee)
    if n_unsafe < needed:
        smallest = math.ceil(1e4 * smallest_epsilon(n_unsafe, guarantee)) / 1e4
        with_confidence = "" if guarantee == "average" else " with 95 % confidence"
        raise ValueError(
            f"epsilon={epsilon:g}{with_confidence} needs at least {needed} unsafe rollouts; this "
            f"monitor has {n_unsafe}: raise epsilon to {smallest:g} or collect more"
        )
    if guarantee != "average":
        return epsilon
    on_grid = (n_unsafe + 1 - rank(epsilon, n_unsafe)) / (n_unsafe + 1)
    return max(epsilon, on_grid) if on_grid < 1 else epsilon
