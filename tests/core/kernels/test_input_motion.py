"""The kernels of the input checks against the same in NumPy, to the bit."""

import numpy as np
import pytest

from core.kernels.input_motion import (
    GROWS,
    KEPT,
    REACTS_S,
    SWINGS_S,
    SurfaceRule,
    SurfaceState,
    look,
    roughness,
)
from core.types import Array

OUTPUTS, CONTROLS = np.array([0, 1, 2]), np.array([3, 4])
RULE = SurfaceRule(
    CONTROLS, OUTPUTS, np.full(3, 0.05), np.array([True, False]), 0.01, np.array([0.01, 0.4])
)


def window(t: Array, y: Array, seconds: float) -> Array:
    first = int(t.searchsorted(t[-1] - seconds - 1e-9))
    return y[max(first, len(t) - KEPT) :]


def extent(y: Array) -> Array:
    return np.fmax.reduce(y, axis=0) - np.fmin.reduce(y, axis=0)


def samples(seed: int) -> tuple[Array, Array]:
    """A source with unknown values, coarse and constant channels, which moves at times."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.019, 0.04, 500))
    y = 0.02 * np.cumsum(rng.normal(size=(500, 5)), axis=0) * (rng.random((500, 1)) < 0.5)
    y[:, 1] = y[:, 1].round(1)
    y[rng.random(y.shape) < 0.05] = np.nan
    y[200:320, seed % 5] = [np.nan, 0.25][seed % 2]
    y[:120, 3] = 0.0
    return t, y


@pytest.mark.parametrize("seed", range(4))
def test_roughness_is_the_median_bend_and_the_smallest_change(seed: int) -> None:
    t, y = samples(seed)
    for n in range(3, 500, 7):
        bends, steps = np.empty(5), np.empty(5)
        recent = window(t[:n], y[:n], SWINGS_S)
        assert roughness(t, y, n, bends, steps) == len(recent)
        bent = np.sort(np.abs(recent[2:] - 2.0 * recent[1:-1] + recent[:-2]), axis=0)
        changes = np.abs(np.diff(recent, axis=0))
        smallest = np.where(changes > 0.0, changes, np.inf).min(axis=0)
        assert np.array_equal(bends, bent[len(bent) // 2], equal_nan=True)
        assert np.array_equal(steps, np.where(smallest == np.inf, 0.0, smallest))


@pytest.mark.parametrize("seed", range(8))
def test_the_aircraft_moves_while_no_surface_explains_it(seed: int) -> None:
    t, y = samples(seed)
    y[250:, CONTROLS] = 0.0
    uncertainty = np.array([0.1, np.nan, 0.2, 0.05, np.nan])
    state = SurfaceState(np.zeros(2, bool), np.zeros(3), np.array([-np.inf]))
    changed, quiet, moved = np.zeros(2, bool), np.zeros(3), -np.inf
    since = expected = np.nan
    found = set[bool]()
    for n in range(8, 500, 5):
        since = look(RULE, state, t, y, n, uncertainty, since)
        now, reacts = t[n - 1], extent(window(t[:n], y[:n], REACTS_S))
        swing = extent(window(t[:n], y[:n], SWINGS_S))[OUTPUTS]
        changed |= reacts[CONTROLS] > 0.0
        least = 0.01 if changed[0] else RULE.least_if_dead
        if (reacts[CONTROLS] > np.fmax(least, uncertainty[CONTROLS])).any():
            moved, expected = now, np.nan
        if now - moved < SWINGS_S:
            quiet = np.full(3, np.inf)
        else:
            quiet = np.fmin(quiet, swing)
            moves = reacts[OUTPUTS] > np.fmax(RULE.moves, uncertainty[OUTPUTS])
            if np.isnan(expected):
                expected = now if (moves & (swing > GROWS * quiet)).any() else np.nan
            elif not (swing > RULE.moves).any():
                expected = np.nan
        assert np.array_equal(since, expected, equal_nan=True)
        assert np.array_equal(state.quiet, quiet)
        found.add(bool(np.isnan(since)))
    assert found == {True, False}
