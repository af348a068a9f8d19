"""Conformal calibration: from scores of past failures to p-values, ranks and alerts."""

import math

import numpy as np
import numpy.typing as npt

from core.types import Array


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


def smallest_epsilon(n_unsafe: int) -> float:
    """Smallest miss rate that n_unsafe failures can serve; below it every sample would alert."""
    return 1 / (n_unsafe + 1)


def check_epsilon(epsilon: float, n_unsafe: int) -> float:
    """Return epsilon, on the grid of p-values where a float just misses it; or refuse it.

    ValueError where n_unsafe failures cannot serve it, with how many could.
    """
    if not 0 < epsilon < 1:
        raise ValueError(f"epsilon={epsilon} was given: a miss rate lies between 0 and 1")
    if rank(epsilon, n_unsafe) > n_unsafe:
        needed = math.ceil(min(1 / epsilon, 1e18) - 1 - 1e-9)
        served = math.ceil(1e4 / (n_unsafe + 1)) / 1e4
        raise ValueError(
            f"epsilon={epsilon:g} needs at least {needed} unsafe rollouts; this monitor has "
            f"{n_unsafe}: raise epsilon to {served:g} or collect more"
        )
    on_grid = (n_unsafe + 1 - rank(epsilon, n_unsafe)) / (n_unsafe + 1)
    return max(epsilon, on_grid) if on_grid < 1 else epsilon
