"""The riskiest moment of each trajectory: its lowest score, its highest p-value.

Calibration and evaluation need only the extreme of a trajectory. A bound on their scores shows that
most samples cannot be it, so they are skipped.
"""

import numpy as np

from core.kernels.assessing import (
    Fitted,
    rule_of,
    score_point,
)
from core.kernels.compiled import in_chunks, inlined, jit
from core.kernels.mapping import map_observation
from core.kernels.nearest import locate, nearest_at, squared_distance_at
from core.kernels.p_value import Transduction, p_value_of
from core.types import Array, Indices

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


@jit
def _highest_p_some(fitted, exact, y, n_delay, last, start, stop, highest):
    z = np.empty(fitted.d)
    rule, unsafe_at, safe_at = rule_of(fitted), locate(fitted.unsafe), locate(fitted.safe)
    for i in range(start, stop):
        near_unsafe, near_safe = -1, -1
        lowest = np.inf
        for t in range(last[i] + 1):
            map_observation(fitted, y[i], t, n_delay, z)
            s, near_unsafe, near_safe = score_point(
                rule, unsafe_at, safe_at, z, -1, near_unsafe, near_safe
            )
            lowest = min(lowest, s)
            highest[i] = max(highest[i], p_value_of(fitted, exact, z, s, lowest))


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
    in_chunks(
        len(y),
        FLIGHTS_A_TASK,
        lambda a, b: _highest_p_some(fitted, exact, y, n_delay, last, a, b, highest),
    )
    return highest
