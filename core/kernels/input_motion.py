"""How far the newest samples of a source move, and what noise and resolution make of it."""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import brief, inlined
from core.types import Array, Flags, Indices

REACTS_S, SWINGS_S = 1.0, 3.0
"""The aircraft moves within the first window [s]; within the second it passes half a swing."""
KEPT = 160
"""Samples looked at: SWINGS_S of a fast source."""
GROWS = 2.0
"""A motion that no surface explains grows by this factor over the smallest one since."""


class SurfaceRule(NamedTuple):
    """controls, outputs: their channels.   moves: (n_outputs,) motion of the aircraft.
    is_planned: (n_controls,).   least: least motion of a surface.   least_if_dead: (n_controls,)
    the same as long as a planned surface may be dead."""

    controls: Indices
    outputs: Indices
    moves: Array
    is_planned: Flags
    least: float
    least_if_dead: Array


class SurfaceState(NamedTuple):
    """has_changed: (n_controls,).   quiet: (n_outputs,) smallest swing since a surface moved.
    moved: (1,) when that was [s]."""

    has_changed: Flags
    quiet: Array
    moved: Array


@brief
def roughness(t, y, n, bends, steps):
    """Fill in the median bend and the smallest change of each channel over SWINGS_S.

    t: (m,) [s].   y: (m, n_channels).   n: samples in them.   bends, steps: (n_channels,); a bend
    is NaN where most samples are unknown, a step 0 where nothing changes.   Returns the number of
    samples.
    """
    first = _first(t, n, SWINGS_S)
    if n - first < 3:
        return n - first
    bent = np.empty(n - first - 2)
    for c in range(y.shape[1]):
        steps[c] = np.inf
        for i in range(first + 1, n):
            change = abs(y[i, c] - y[i - 1, c])
            if 0.0 < change < steps[c]:
                steps[c] = change
        if steps[c] == np.inf:
            steps[c] = 0.0
        for i in range(first + 2, n):
            bent[i - first - 2] = abs(y[i, c] - 2.0 * y[i - 1, c] + y[i - 2, c])
        bends[c] = np.sort(bent)[len(bent) // 2]
    return n - first


@brief
def look(rule, state, t, y, n, uncertainty, since):
    """Whether the aircraft moves while its surfaces rest.

    t, y, n: see `roughness`.   uncertainty: (n_channels,) motion that is noise and resolution.
    since: when it began to [s]; NaN if it did not.   Returns the new one.
    """
    now, reacts = t[n - 1], _first(t, n, REACTS_S)
    all_changed, surface_moves = True, False
    for k in range(rule.controls.shape[0]):
        state.has_changed[k] |= _extent(y, reacts, n, rule.controls[k]) > 0.0
        all_changed &= state.has_changed[k] or not rule.is_planned[k]
    for k in range(rule.controls.shape[0]):
        c = rule.controls[k]
        least = rule.least if all_changed else rule.least_if_dead[k]
        surface_moves |= _extent(y, reacts, n, c) > np.fmax(least, uncertainty[c])
    if surface_moves:
        state.moved[0], since = now, np.nan
    if now - state.moved[0] < SWINGS_S:
        state.quiet[:] = np.inf
        return since
    moves, swings, swing_first = False, False, _first(t, n, SWINGS_S)
    for k in range(rule.outputs.shape[0]):
        c = rule.outputs[k]
        swing = _extent(y, swing_first, n, c)
        state.quiet[k] = np.fmin(state.quiet[k], swing)
        least = np.fmax(rule.moves[k], uncertainty[c])
        moves |= _extent(y, reacts, n, c) > least and swing > GROWS * state.quiet[k]
        swings |= swing > rule.moves[k]
    if np.isnan(since):
        return now if moves else np.nan
    return since if swings else np.nan


@inlined
def _first(t, n, seconds):
    """First sample of the last seconds, of at most KEPT."""
    first, since = n, t[n - 1] - seconds - 1e-9
    while first > max(0, n - KEPT) and t[first - 1] >= since:
        first -= 1
    return first


@inlined
def _extent(y, first, n, c):
    """Largest less smallest value of a channel; NaN where all are unknown."""
    low, high = np.inf, -np.inf
    for i in range(first, n):
        low, high = np.fmin(low, y[i, c]), np.fmax(high, y[i, c])
    return high - low if high >= low else np.nan
