"""Scores and p-values of whole trajectories, with few searches for neighbours.

Calibration and evaluation need only the riskiest moment of a trajectory, and most samples score
above every calibration score and share the lowest p-value. A bound on the score shows which samples
need no search.
"""

import numpy as np

from core.kernels.assessing import (
    SAMPLES_A_TASK,
    Fitted,
    map_observation,
    rule_of,
    score_all,
    score_point,
)
from core.kernels.compiled import in_chunks, inlined, jit
from core.kernels.nearest import locate, nearest_at, squared_distance_at
from core.kernels.p_value import Transduction, simple_p
from core.types import Array, Flags, Indices

FLIGHTS_A_TASK = 32
ROUNDING = 1e-9
"""Relative slack of a bound, which is computed differently from the score it bounds."""


@jit
def _next_goal(lowest, levels):
    """Highest score at which the next candidate still matters."""
    if levels.shape[0] == 0:
        return lowest
    below = np.searchsorted(levels, lowest) - 1
    return levels[below] if below >= 0 else -np.inf


@jit
def _lowest_some(fitted, y, n_delay, first, last, left_out, levels, start, stop, lowest):
    z, anchor = np.empty(fitted.d), np.zeros(fitted.d)
    rule, unsafe_at, safe_at = rule_of(fitted), locate(fitted.unsafe), locate(fitted.safe)
    a, b, channel = rule
    bounded = channel < 0 and a > 0.0 and b > 0.0
    riskiest = 0
    for i in range(start, stop):
        flight = y[i]
        near_unsafe, near_safe = -1, -1
        goal = _next_goal(np.inf, levels)
        to_unsafe, to_safe = 0.0, np.inf
        # The riskiest moments of flights are close together: start at that of the last flight, go
        # on to the end, then back to the start. An early low score lets most others be skipped.
        begin = min(max(riskiest, first[i]), last[i])
        for k in range(last[i] + 1 - first[i]):
            t = begin + k if begin + k <= last[i] else last[i] - k
            map_observation(fitted, flight, t, n_delay, z)
            if channel >= 0:
                s = -abs(z[channel])
            elif not bounded:
                s, near_unsafe, near_safe = score_point(
                    rule, unsafe_at, safe_at, z, left_out[i], near_unsafe, near_safe
                )
            else:
                # A step away from the anchor changes each distance by at most its length.
                step = distance_between(z, anchor)
                unsafe = a * max(to_unsafe - step, 0.0) ** 2
                safe = b * (to_safe + step) ** 2
                if unsafe - safe - ROUNDING * (unsafe + safe) > goal:
                    continue
                # Any safe point bounds the distance to the nearest one: use the last neighbour.
                unsafe, near_unsafe = nearest_at(unsafe_at, z, left_out[i], near_unsafe)
                safe = squared_distance_at(safe_at, z, near_safe) if near_safe >= 0 else np.inf
                if a * unsafe - b * safe <= goal:
                    safe, near_safe = nearest_at(safe_at, z, -1, near_safe)
                anchor[:] = z
                to_unsafe, to_safe = np.sqrt(unsafe), np.sqrt(safe)
                s = a * unsafe - b * safe
            if s < lowest[i] and s <= goal:
                lowest[i], riskiest = s, t
                goal = _next_goal(s, levels)
                if goal == -np.inf:
                    break


@inlined
def distance_between(z, anchor):
    """Distance between two mapped points."""
    total = 0.0
    for k in range(z.shape[0]):
        total += (z[k] - anchor[k]) ** 2
    return np.sqrt(total)


def lowest_scores(
    fitted: Fitted,
    y: Array,
    n_delay: int,
    first: Indices,
    last: Indices,
    left_out: Indices,
    levels: Array,
) -> Array:
    """Lowest score of each trajectory over its samples first..last.

    y: (n, n_samples, 6), finite over those samples.
    first, last: (n,); +inf if last < first.   left_out: (n,) unsafe point to leave out, -1: none.
    levels: sorted scores. If given, the lowest score is only computed as far as needed to decide
    which levels are at least as high.
    """
    lowest = np.full(len(y), np.inf)
    in_chunks(
        len(y),
        FLIGHTS_A_TASK,
        lambda a, b: _lowest_some(fitted, y, n_delay, first, last, left_out, levels, a, b, lowest),
    )
    return lowest


def highest_p_values(
    fitted: Fitted, exact: Transduction, y: Array, n_delay: int, last: Indices
) -> Array:
    """Highest p-value of each trajectory over its samples 0..last; 0 if last < 0."""
    if len(exact.start) == 0:
        alphas, none_left_out = fitted.alphas, np.full(len(y), -1)
        s = lowest_scores(fitted, y, n_delay, np.zeros_like(last), last, none_left_out, alphas)
        at_least = len(alphas) - np.searchsorted(alphas, s)
        return np.where(last < 0, 0.0, (at_least + 1) / (len(alphas) + 1))
    highest = np.zeros(len(y))
    for i in np.flatnonzero(last >= 0):
        flight = y[i, : last[i] + 1]
        p = score_all(fitted, exact, flight, np.ones(len(flight), np.bool_), n_delay)[2]
        highest[i] = p.max()
    return highest


@jit
def _simple_p_some(fitted, y, ok, n_delay, start, stop, p):
    z, anchor = np.empty(fitted.d), np.zeros(fitted.d)
    rule, unsafe_at, safe_at = rule_of(fitted), locate(fitted.unsafe), locate(fitted.safe)
    a, b, channel = rule
    bounded = channel < 0 and a > 0.0 and b > 0.0
    n_finite = np.searchsorted(fitted.alphas, np.inf)
    highest = fitted.alphas[n_finite - 1] if n_finite > 0 else -np.inf
    lowest_p = (fitted.alphas.shape[0] - n_finite + 1) / (fitted.alphas.shape[0] + 1)
    near_unsafe, near_safe = -1, -1
    to_unsafe, safe = 0.0, np.inf
    for i in range(start, stop):
        if not ok[i]:
            continue
        map_observation(fitted, y, i, n_delay, z)
        if not bounded:
            s, near_unsafe, near_safe = score_point(
                rule, unsafe_at, safe_at, z, -1, near_unsafe, near_safe
            )
            p[i] = simple_p(fitted.alphas, s)
            continue
        # Any safe point bounds the distance to the nearest one: use the last neighbour. A step
        # away from the anchor changes the distance to the nearest unsafe one by at most its length.
        safe = b * squared_distance_at(safe_at, z, near_safe) if near_safe >= 0 else np.inf
        at_least = (1.0 - ROUNDING) * to_unsafe - (1.0 + ROUNDING) * distance_between(z, anchor)
        if a * max(at_least, 0.0) ** 2 - safe > highest:
            p[i] = lowest_p
            continue
        distance, near_unsafe = nearest_at(unsafe_at, z, -1, near_unsafe)
        anchor[:] = z
        to_unsafe = np.sqrt(distance)
        if a * distance - safe > highest:
            p[i] = lowest_p
            continue
        safe, near_safe = nearest_at(safe_at, z, -1, near_safe)
        p[i] = simple_p(fitted.alphas, a * distance - b * safe)


def simple_p_values(fitted: Fitted, y: Array, ok: Flags, n_delay: int) -> Array:
    """Simple p-value of each sample, bit for bit that of its score; NaN unless ok.

    y: (n, 6).   ok: (n,) whether the sample has a full history.   Returns (n,).
    """
    p = np.full(len(y), np.nan)
    in_chunks(len(y), SAMPLES_A_TASK, lambda a, b: _simple_p_some(fitted, y, ok, n_delay, a, b, p))
    return p
