"""The direction of an input: by hand, of a stream as of a batch, and through a file."""

from dataclasses import replace

import numpy as np
import pytest

from core.channels import KEYS
from core.collection import DatasetRecipe, collect, fresh
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.assessment import State
from core.monitor.file.loading import from_bytes
from core.monitor.validity.input_direction import InputDirection, begins
from core.planned_test import Simulator
from core.types import Array

AILERON, RUDDER = KEYS.index("delta_a"), KEYS.index("delta_r")
DIRECTION = InputDirection(np.array([RUDDER]), np.array([0.05]), np.array([[0, 1500]]))
RECIPE = DatasetRecipe(n_unsafe=30, seed=4).as_flown()


def flight(*rudder: float) -> Array:
    y = np.zeros((len(rudder), len(KEYS)))
    y[:, RUDDER] = rudder
    return y


@pytest.fixture(scope="module")
def monitor() -> Monitor:
    return train(collect(RECIPE), MonitorRecipe(t_early=0.5), fresh(RECIPE))


@pytest.fixture(scope="module")
def opposite() -> Array:
    maneuver = RECIPE.maneuver.with_peak(-RECIPE.maneuver.peak_deg)
    return Simulator(replace(RECIPE, maneuver=maneuver)).rollouts(20, np.random.default_rng(1)).y


@pytest.mark.parametrize(
    ("rudder", "first"),
    [
        ((0.0, -0.04, 0.04, 0.0), None),
        ((0.0, 0.05, -0.2, 0.0), None),
        ((0.0, -0.05, 0.2, 0.0), 1),
        ((0.0, np.nan, -0.1, 0.1), 2),
    ],
)
def test_the_first_large_deflection_decides(rudder: tuple[float, ...], first: int | None) -> None:
    y, t = flight(*rudder), 0.1 * np.arange(4.0)
    wrong = DIRECTION.first_wrong(t, y, np.ones(4, bool))
    assert (wrong and wrong.sample) == first
    assert DIRECTION.first_wrong_of(y[None]).tolist() == [4 if first is None else first]
    if wrong:
        assert (wrong.t, wrong.channel) == (t[wrong.sample], "delta_r")
        assert wrong.p_value == 2 / 1501
        assert "in all 1,500 fresh flights to the positive one" in wrong.words


def test_samples_that_do_not_count_decide_nothing() -> None:
    y, counts = flight(0.0, -0.1, 0.1, -0.1), np.array([True, False, True, True])
    assert DIRECTION.first_wrong(np.arange(4.0), y, counts) is None


def test_few_fresh_flights_say_nothing() -> None:
    few = replace(DIRECTION, flights=np.array([[0, 499]]))
    y = flight(-0.1, 0.1)
    assert few.first_wrong(np.arange(2.0), y, np.ones(2, bool)) is None
    assert few.first_wrong_of(y[None]).tolist() == [2]


def test_flights_are_counted_by_their_first_deflection_up_to_the_last_sample() -> None:
    y = np.stack([flight(0, 1, -1), flight(0, -1, 1), flight(0, 0, -1), flight(0, 0, 0)])
    found = begins(y, np.array([2, 2, 1, 2]), [AILERON, RUDDER], np.array([0.5, 0.5]))
    assert found.tolist() == [[0, 0], [1, 1]]


def test_flights_as_planned_keep_their_direction(monitor: Monitor) -> None:
    y = Simulator(RECIPE).rollouts(500, np.random.default_rng(2)).y
    assert monitor.inputs
    assert monitor.inputs.direction
    assert (monitor.inputs.direction.first_wrong_of(y) == y.shape[1]).all()


def test_an_opposite_input_is_invalid_from_its_first_deflection_on(
    monitor: Monitor, opposite: Array
) -> None:
    """As a stream, as a batch and in the evaluation, at one sample, within 0.4 s of the input."""
    n_samples = opposite.shape[1]
    t = np.arange(n_samples) * monitor.dt
    first = monitor.first_withdrawn(opposite, np.full(len(opposite), n_samples))
    for y, expected in zip(opposite, first.tolist(), strict=True):
        states = [a.state for a in map(monitor.stream().update, t.tolist(), y)]
        assert states.index(State.INVALID) == expected
        assessed = monitor.assess(t, y)
        assert np.isnan(assessed.p_value[expected:]).all()
        assert not np.isnan(assessed.p_value[:expected]).any()
        verdict, withdrawal = monitor.judge_and_withdraw(t, y, monitor.assess(t, y, withdraw=False))
        assert withdrawal
        assert withdrawal.first == expected
        assert verdict.valid is False
        assert verdict.p_value is not None
        assert verdict.p_value <= (verdict.level or 0)
        moves = np.flatnonzero(np.abs(y[:, RUDDER]) > np.deg2rad(1.0))[0]
        assert moves <= expected <= moves + round(0.4 / monitor.dt)


def test_a_file_keeps_it_and_refuses_a_damaged_one(monitor: Monitor, opposite: Array) -> None:
    again = from_bytes(monitor.to_bytes(), "it")
    everywhere = np.full(len(opposite), opposite.shape[1])
    expected = monitor.first_withdrawn(opposite, everywhere)
    assert (again.first_withdrawn(opposite, everywhere) == expected).all()
    inputs = monitor.inputs
    assert inputs
    assert inputs.direction
    for damaged in (
        replace(inputs.direction, begun=-inputs.direction.begun),
        replace(inputs.direction, begun=inputs.direction.begun[:0]),
        replace(inputs.direction, flights=inputs.direction.flights.astype(float)),
        replace(inputs.direction, flights=-inputs.direction.flights),
    ):
        file = replace(monitor, inputs=replace(inputs, direction=damaged)).to_bytes()
        with pytest.raises(ValueError, match=r"input (begun|flights)"):
            from_bytes(file, "it")
