"""Failures that alerts prevent: by hand, and with stopped flights."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from core.evaluation.prevention import VARIATION, prevention
from core.planned_test.collection import DatasetRecipe, evaluation_flights, stopping_flights
from core.types import Indices

RECIPE = DatasetRecipe(n_unsafe=30, seed=4)
N = 40


@pytest.mark.parametrize("recipe", [RECIPE, RECIPE.as_flown()], ids=["bare", "as flown"])
def test_a_stopped_flight_is_the_same_until_it_is_stopped(recipe: DatasetRecipe) -> None:
    flown = evaluation_flights(recipe, N)
    n_samples, which = flown.y.shape[1], np.flatnonzero(flown.is_unsafe)
    again = partial(stopping_flights(recipe, N), which)
    assert (again(np.full(len(which), n_samples)) == flown.fail_index[which]).all()
    assert (again(np.zeros_like(which)) == n_samples).all()
    late = again(flown.fail_index[which])
    assert (late == flown.fail_index[which]).all()
    assert len(which) >= 5


def test_stopping_too_late_does_not_undo_the_input() -> None:
    """Neutral controls just before the failure come too late, early ones do not."""
    flown = evaluation_flights(RECIPE, N)
    which = np.flatnonzero(flown.is_unsafe)
    late = stopping_flights(RECIPE, N)(which, flown.fail_index[which] - 1)
    assert (late == flown.fail_index[which]).any()


def test_a_failure_is_prevented_if_the_stopped_flight_stays_within_limits() -> None:
    fails = np.array([5, 7, 9, 10, 10, 10])
    alerts = np.array([2, 10, 6, 3, 10, 4])
    asked: list[tuple[Indices, Indices]] = []

    def stopped(which: Indices, neutral_from: Indices) -> Indices:
        asked.append((which, neutral_from))
        return np.array([10, 9, 10, 8])

    counts = prevention(alerts, fails, 10, 0.1, stopped, np.random.default_rng(0), (0.3, 0.6))
    assert (counts.n_unsafe, counts.n_safe, counts.stopped) == (3, 3, 2)
    assert counts.prevented.tolist() == [1, 1]
    assert counts.caused.tolist() == [1, 1]
    assert asked[0][0].tolist() == [0, 2, 3, 5]
    assert (asked[0][1] > [2, 6, 3, 4]).all()
    assert (asked[1][1] > asked[0][1]).all()


def test_reactions_have_their_mean_and_scatter() -> None:
    n, seen = 20_000, []
    prevention(
        np.zeros(n, np.int64),
        np.zeros(n, np.int64),
        9,
        1e-4,
        lambda which, neutral_from: seen.append(neutral_from * 1e-4) or which,
        np.random.default_rng(1),
        (0.5,),
    )
    assert seen[0].mean() == pytest.approx(0.5, rel=0.01)
    assert seen[0].std() == pytest.approx(0.5 * VARIATION, rel=0.03)


def test_a_faster_reaction_prevents_more() -> None:
    recipe = replace(RECIPE, seed=6)
    flown = evaluation_flights(recipe, 300)
    n_samples = flown.y.shape[1]
    alerts = np.where(flown.is_unsafe, np.maximum(flown.fail_index - 10, 0), n_samples)
    again = stopping_flights(recipe, 300)
    counts = prevention(alerts, flown.fail_index, n_samples, 0.05, again, np.random.default_rng(2))
    assert (np.diff(counts.prevented) <= 0).all()
    assert counts.prevented[0] > 0.5 * counts.n_unsafe
    assert counts.prevented[-1] < 0.2 * counts.n_unsafe
    assert counts.stopped == 0


def test_without_an_alert_nothing_is_stopped_or_prevented() -> None:
    never, again = np.full(N, 121), stopping_flights(RECIPE, N)
    result = prevention(never, never, 121, 0.05, again, np.random.default_rng(0))
    assert (result.stopped, result.prevented.any(), result.caused.any()) == (0, False, False)
