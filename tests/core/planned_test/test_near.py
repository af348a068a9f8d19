"""Flights of aircraft and hands near the planned ones."""

from dataclasses import replace

import numpy as np
import pytest

from core.planned_test import near
from core.planned_test.near import near_failures, near_rollouts
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.seeds import Branch, stream

RECIPE = DatasetRecipe(seed=6).as_trained()
N = 30


def test_forecasts_learn_from_aircraft_twice_as_far_apart_and_from_softer_hands() -> None:
    wide, plant = near_rollouts(RECIPE, 3000), LateralSimulator(RECIPE).plant
    planned = plant.sample(3000, np.random.default_rng(7))
    moves = planned.std(axis=0) > 0
    ratio = wide.theta.std(axis=0)[moves] / planned.std(axis=0)[moves]
    np.testing.assert_allclose(ratio, 2.0, rtol=0.1)
    rudder = np.abs(wide.y[:, :, -1])
    rates = np.abs(np.diff(rudder, axis=1)).max(axis=1) / rudder.max(axis=1)
    as_planned = np.abs(
        LateralSimulator(RECIPE).rollouts(3000, np.random.default_rng(8)).y[:, :, -1]
    )
    planned_rates = np.abs(np.diff(as_planned, axis=1)).max(axis=1) / as_planned.max(axis=1)
    assert np.median(rates) < 0.95 * np.median(planned_rates)


def test_each_population_has_one_failing_flight_of_each_aircraft() -> None:
    reports = []
    populations = near_failures(RECIPE, N, lambda done, total: reports.append((done, total)))
    assert reports == [(0, 4), (1, 4), (2, 4), (3, 4)]
    nominal = LateralSimulator(RECIPE).plant.nominal
    for flights, factor in zip(populations, (None, 1.5, 2.0, None), strict=True):
        assert len(flights.y) == N
        assert flights.is_unsafe.all()
        assert len(np.unique(flights.theta, axis=0)) == N
        if factor:
            moved = np.abs(np.log((flights.theta / nominal)[:, nominal != 0]))
            assert 0.95 * np.log(factor) < moved.max() <= np.log(factor)
    again = near_failures(RECIPE, N)
    for flights, same in zip(populations, again, strict=True):
        np.testing.assert_array_equal(flights.y, same.y)


def test_they_are_none_of_the_planned_tests_other_flights() -> None:
    first = near_failures(RECIPE, N)[0]
    for branch in set(Branch) - {Branch.NEAR}:
        flights = LateralSimulator(RECIPE).rollouts(50, stream(RECIPE.seed, branch))
        assert not (first.theta[:, None] == flights.theta[None]).all(axis=2).any()


def test_a_population_that_hardly_fails_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(near, "MOST_EACH", 20)
    maneuver = replace(RECIPE.maneuver, amplitude_deg=0.5 * RECIPE.maneuver.peak_deg)
    populations = near_failures(replace(RECIPE, maneuver=maneuver), N)
    assert 1 <= len(populations) < 4
