"""The shape of an input: by hand, of a stream as of a batch, and through a file."""

from dataclasses import replace

import numpy as np
import pytest

from core.channels import KEYS
from core.evaluation.robustness import DIFFERENCES
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.assessment import State
from core.monitor.file.loading import from_bytes
from core.monitor.validity.flown_input import InputSupport
from core.monitor.validity.input_shape import (
    HOLD_LEVEL,
    SOFT_LEVEL,
    FreshShapes,
    InputShape,
)
from core.planned_test.collection import DatasetRecipe, collect, fresh
from core.planned_test.planned_test import LateralSimulator
from core.types import Array

AILERON, RUDDER = KEYS.index("delta_a"), KEYS.index("delta_r")
SHAPE = InputShape(
    np.array([RUDDER]),
    np.array([0.05]),
    np.array([[0, 1500]]),
    np.array([[0.2, 0.4]]),
    np.zeros(1),
)
"""Holds of 0.2 s, then of 0.4 s at most."""
DT = 0.1
TIMES: Array = DT * np.arange(30.0)
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
    return (
        LateralSimulator(replace(RECIPE, maneuver=maneuver))
        .rollouts(20, np.random.default_rng(1))
        .y
    )


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
    wrong = SHAPE.first_wrong(t, y, np.ones(4, bool))
    assert (wrong and wrong.sample) == first
    assert SHAPE.first_wrong_of(y[None], DT).tolist() == [4 if first is None else first]
    if wrong:
        assert (wrong.t, wrong.channel) == (t[wrong.sample], "delta_r")
        assert wrong.p_value == 2 / 1501
        assert "positive in all 1,500 fresh flights" in wrong.words


@pytest.mark.parametrize(
    ("rudder", "first"),
    [
        ((0, 1, 1, 1, 0, 0), None),
        ((0, 1, 1, 1, 1, 0), 4),
        ((0, 1, 1, 0.04, 1, 1, 1, 1, 1), None),
        ((0, 1, 1, -1, -1, -1, -1, -1, -1), 8),
        ((1, 0, 1, 0, 1, 1, 1, 1, 1, 1, 1, 1), None),  # a third hold, of which nothing is known
        ((0, 1, np.nan, 1, 1, 1), None),
    ],
)
def test_a_hold_that_outlasts_those_of_its_number_is_wrong(
    rudder: tuple[float, ...], first: int | None
) -> None:
    y, t = flight(*rudder), TIMES[: len(rudder)]
    wrong = SHAPE.first_wrong(t, y, np.ones(len(y), bool))
    assert (wrong and wrong.sample) == first
    assert SHAPE.first_wrong_of(y[None], DT).tolist() == [len(y) if first is None else first]
    if wrong:
        number = 1 if first == 4 else 2
        assert f"at most {0.2 * number:.2f} s in all but" in wrong.words
        assert wrong.p_value == 2 * 3 / 1501  # two holds; a share of .002 of either lasts longer


@pytest.mark.parametrize(
    ("rudder", "first"),
    [
        ((0, 0.5, 1, 1), None),  # half of the largest deflection within a sample
        ((0, 0.3, 0.6, 0.9, 1), 3),  # 0.3 is less than 0.4 of 0.9
        ((0, 0.3, 0.6, 0.75, 0.75), None),
        ((0, 0.01, 0.02, 0.03, 0.04), None),  # not a hold
        ((0, 0.3, np.nan, 0.6, 0.9, 1), None),  # how fast it moved is not known
    ],
)
def test_an_input_softer_than_in_training_is_wrong(
    rudder: tuple[float, ...], first: int | None
) -> None:
    shape = replace(SHAPE, longest_s=np.empty((1, 0)), softest=np.array([0.4]))
    y, t = flight(*rudder), TIMES[: len(rudder)]
    wrong = shape.first_wrong(t, y, np.ones(len(y), bool))
    assert (wrong and wrong.sample) == first
    assert shape.first_wrong_of(y[None], DT).tolist() == [len(y) if first is None else first]
    if wrong:
        assert "more softly" in wrong.words
        assert wrong.p_value == 3 / 1501
    assert replace(shape, softest=np.zeros(1)).first_wrong(t, y, np.ones(len(y), bool)) is None


def test_a_missing_sample_hides_the_sharpness() -> None:
    shape = replace(SHAPE, longest_s=np.empty((1, 0)), softest=np.array([0.4]))
    y, t = flight(0, 0.3, 0.6, 0.9, 1), TIMES[:5]
    assert shape.first_wrong(t, y, np.array([True, True, False, True, True])) is None


@pytest.mark.parametrize("lag_s", [0.5, 0.8])
def test_a_much_softer_input_is_invalid_in_time(monitor: Monitor, lag_s: float) -> None:
    softer = replace(RECIPE, maneuver=replace(RECIPE.maneuver, pedal_lag_s=lag_s))
    retuned = softer.maneuver.with_peak((1 + lag_s) * RECIPE.maneuver.peak_deg)
    flown = LateralSimulator(replace(softer, maneuver=retuned)).rollouts(
        600, np.random.default_rng(3)
    )
    first = monitor.first_withdrawn(flown.y, flown.fail_index)
    fails = flown.is_unsafe
    assert np.count_nonzero(fails) > 50
    assert np.mean(first[fails] <= flown.fail_index[fails] - monitor.h) > 0.9


def test_a_gap_begins_a_hold_anew() -> None:
    y, t = flight(0, 1, 1, 1, 1, 1, 1), TIMES[:7]
    counts = np.array([True, True, True, False, True, True, True])
    assert SHAPE.first_wrong(t, y, counts) is None
    assert SHAPE.first_wrong(t, y, np.ones(7, bool)) is not None


def test_a_flight_under_way_is_told_what_the_whole_one_is() -> None:
    rng, n = np.random.default_rng(5), 30
    shape = InputShape(
        np.array([AILERON, RUDDER]),
        np.array([0.5, 0.8]),
        np.array([[600, 500], [1, 900]]),
        np.array([[0.3, 0.2, 0.5], [0.4, 0.0, 0.3]]),
        np.array([0.5, 0.7]),
    )
    found = set()
    for _ in range(300):
        y, t = np.cumsum(rng.normal(0, 0.3, (n, len(KEYS))), axis=0), TIMES
        counts, running = rng.random(n) < 0.95, shape.start()
        told = (running.update(k, t.item(k), y[k]) for k in np.flatnonzero(counts).tolist())
        first = next((wrong for wrong in told if wrong), None)
        assert first == shape.first_wrong(t, y, counts)
        found.add(first and first.words.split(" ")[1])
    assert found == {None, "began", "stayed", "moved"}


def test_samples_that_do_not_count_decide_nothing() -> None:
    y, counts = flight(0.0, -0.1, 0.1, -0.1), np.array([True, False, True, True])
    assert SHAPE.first_wrong(np.arange(4.0), y, counts) is None


def test_few_fresh_flights_say_nothing() -> None:
    few = replace(SHAPE, flights=np.array([[0, 499]]))
    y = flight(-0.1, 0.1)
    assert few.first_wrong(np.arange(2.0), y, np.ones(2, bool)) is None
    assert few.first_wrong_of(y[None], DT).tolist() == [2]


def test_flights_are_counted_by_their_first_deflection_up_to_the_last_sample() -> None:
    y = np.stack([flight(0, 1, -1), flight(0, -1, 1), flight(0, 0, -1), flight(0, 0, 0)])
    found = FreshShapes([AILERON, RUDDER], np.array([0.5, 0.5]), DT)
    found.add(y, np.array([2, 2, 1, 2]))
    assert found.shape(np.array([0, 1])).flights.tolist() == [[0, 0], [1, 1]]


def test_hardly_a_flight_as_planned_is_wrong(monitor: Monitor) -> None:
    flown = LateralSimulator(RECIPE).rollouts(4_000, np.random.default_rng(2))
    assert monitor.inputs
    assert monitor.inputs.shape
    first = monitor.inputs.shape.first_wrong_of(flown.y, monitor.dt)
    wrong = np.mean(first <= np.minimum(flown.fail_index, flown.y.shape[1] - 1))
    # as much as bounds from a thousand flights scatter, and as a share of these does
    level = HOLD_LEVEL + SOFT_LEVEL
    assert wrong < level + 3 * np.sqrt(level / 1_000 + level / 4_000)


def test_one_fresh_flight_that_began_otherwise_does_not_excuse_all() -> None:
    y, counts = flight(0.0, -0.1), np.ones(2, bool)
    for alike, n, is_wrong in ((1, 600, True), (6, 600, False), (6, 1_500, True)):
        wrong = replace(SHAPE, flights=np.array([[alike, n]])).first_wrong(
            np.arange(2.0), y, counts
        )
        assert (wrong is not None) == is_wrong
        if wrong:
            assert f"in all but {alike} of {alike + n:,} fresh flights" in wrong.words


def test_a_slower_input_is_invalid_before_most_of_its_failures(monitor: Monitor) -> None:
    slower = DIFFERENCES["slower_input"].recipe(RECIPE)
    flown = LateralSimulator(slower).rollouts(400, np.random.default_rng(3))
    first = monitor.first_withdrawn(flown.y, flown.fail_index)
    assert np.mean(first[~flown.is_unsafe] < flown.y.shape[1]) > 0.6
    which = int(np.flatnonzero(first < flown.y.shape[1])[0])
    t = np.arange(flown.y.shape[1]) * monitor.dt
    states = [a.state for a in map(monitor.stream().update, t.tolist(), flown.y[which])]
    assert states.index(State.INVALID) == first[which]


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
    assert inputs.shape
    for damaged in (
        replace(inputs.shape, begun=-inputs.shape.begun),
        replace(inputs.shape, begun=inputs.shape.begun[:0]),
        replace(inputs.shape, flights=inputs.shape.flights.astype(float)),
        replace(inputs.shape, flights=-inputs.shape.flights),
        replace(inputs.shape, longest_s=-inputs.shape.longest_s),
        replace(inputs.shape, longest_s=inputs.shape.longest_s[0]),
        replace(inputs.shape, softest=-inputs.shape.softest),
        replace(inputs.shape, softest=np.array([0.1, 0.1])),
    ):
        file = replace(monitor, inputs=replace(inputs, shape=damaged)).to_bytes()
        with pytest.raises(ValueError, match=r"input (begun|flights|longest_s|softest)"):
            from_bytes(file, "it")


def test_a_file_without_holds_is_read_as_one_that_knows_of_none(monitor: Monitor) -> None:
    assert monitor.inputs
    section = monitor.inputs.to_section()
    newer = "longest_s", "softest"
    arrays = {name: array for name, array in section.arrays.items() if name not in newer}
    shape = InputSupport.from_section(section._replace(arrays=arrays)).shape
    assert shape
    assert shape.longest_s.shape == (1, 0)
    assert shape.softest.tolist() == [0.0]
    assert shape.first_wrong_of(flight(*[1.0] * 50)[None], DT).tolist() == [50]
