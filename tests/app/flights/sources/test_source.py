"""Sources: simulated and stored rollouts as tracks."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.flights.sources.simulated import (
    SourceError,
    Track,
    planned_attitude,
    simulate,
    times,
    trim_angles,
)
from app.flights.sources.source import Replay, Simulated
from app.recipes.recipes import RecipeError, to_plain
from app.store.store import NotFound, Store, open_store
from core.monitor import Monitor, MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, collect
from core.planned_test.planned_test import LateralSimulator, SensorNoise

RECIPE = DatasetRecipe(n_unsafe=4, n_obs=10, seed=3)
NOISY = replace(RECIPE, noise=SensorNoise(p=0.01))


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Store, str, str, Monitor]:
    """A store with a dataset, a noisy one, and a monitor of the first."""
    store: Path = tmp_path_factory.mktemp("sources")
    opened = open_store(store / "store.db")
    datasets = [collect(recipe) for recipe in (RECIPE, NOISY)]
    clean, noisy = (opened.datasets.add(dataset, "test").id for dataset in datasets)
    monitor = train(datasets[0], MonitorRecipe(epsilon=0.3))
    return opened, clean, noisy, replace(monitor, dataset_recipe=to_plain(RECIPE))


def simulated(**choices: Any) -> Simulated:
    return Simulated(kind="simulated", **choices)


def fly(stored: tuple, request: Any) -> Track:
    store, _, _, monitor = stored
    return request.track(store, monitor)


def test_the_same_seed_is_the_same_flight() -> None:
    first, again, other = (simulate(RECIPE, seed=seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.y, again.y)
    assert first.theta == again.theta
    assert (first.y != other.y).any()


@pytest.mark.parametrize("outcome", ["unsafe", "safe"])
def test_a_random_aircraft_has_the_outcome_asked_for(outcome: Any) -> None:
    for seed in range(4):
        track = simulate(RECIPE, seed=seed, outcome=outcome)
        first = RECIPE.specification.first_exceedance(track.y[np.newaxis])[0]
        assert (first < len(track.t)) == (outcome == "unsafe")
        assert track.fail_index == (first if outcome == "unsafe" else None)


def test_a_simulated_flight_goes_on_past_its_failure() -> None:
    track = simulate(RECIPE, outcome="unsafe")
    assert track.fail_index is not None
    assert len(track.t) == 121 > track.fail_index
    assert np.isfinite(track.y).all()


def test_a_chosen_theta_flies_that_very_aircraft() -> None:
    """Against the simulator: the rollout of a drawn theta comes back from its numbers."""
    simulator = LateralSimulator(RECIPE)
    drawn = simulator.rollouts(3, np.random.default_rng(0))
    for y, theta in zip(drawn.y, drawn.theta.tolist(), strict=True):
        chosen = dict(zip(simulator.plant.names, theta, strict=True))
        track = simulate(RECIPE, theta=chosen)
        np.testing.assert_array_equal(track.y, y)
        assert track.theta == chosen


def test_parameters_that_are_not_chosen_are_nominal() -> None:
    plant = RECIPE.aircraft.uncertain_plant()
    nominal = dict(zip(plant.names, plant.nominal.tolist(), strict=True))
    track = simulate(RECIPE, theta={"N_beta": 9.0})
    assert track.theta == nominal | {"N_beta": 9.0}
    assert simulate(RECIPE, theta={}).theta == nominal


@pytest.mark.parametrize(
    ("theta", "message"),
    [({"C_n_beta": 1.0}, "parameters C_n_beta: .* Y_beta"), ({"N_beta": np.inf}, "finite")],
)
def test_a_theta_that_cannot_be_is_refused(theta: dict[str, float], message: str) -> None:
    with pytest.raises(SourceError, match=message):
        simulate(RECIPE, theta=theta)


def test_an_outcome_that_never_happens_is_refused() -> None:
    tame = replace(RECIPE, specification=replace(RECIPE.specification, Ny=1000.0))
    with pytest.raises(SourceError, match="none of 16384 random aircraft was unsafe"):
        simulate(tame, outcome="unsafe")


def test_the_test_is_the_recipes_the_datasets_or_the_monitors(stored: tuple) -> None:
    _, clean, noisy, _ = stored
    of_monitor = fly(stored, simulated(seed=1))
    np.testing.assert_array_equal(fly(stored, simulated(seed=1, dataset=clean)).y, of_monitor.y)
    recipe = to_plain(NOISY)
    of_recipe = fly(stored, simulated(seed=1, recipe=recipe))
    np.testing.assert_array_equal(fly(stored, simulated(seed=1, dataset=noisy)).y, of_recipe.y)
    assert (of_recipe.y != of_monitor.y).any()
    with pytest.raises(SourceError, match="both dataset and recipe"):
        fly(stored, simulated(dataset=clean, recipe=recipe))
    with pytest.raises(RecipeError, match="dataset has no 'aeroplane'"):
        fly(stored, simulated(recipe={"aeroplane": "747"}))
    with pytest.raises(NotFound):
        fly(stored, simulated(dataset="none"))


def test_a_monitor_of_flown_data_needs_a_recipe(stored: tuple) -> None:
    store, _, _, monitor = stored
    with pytest.raises(SourceError, match="no test to simulate"):
        simulated().track(store, replace(monitor, dataset_recipe={}))


def test_another_interval_than_the_monitors_is_refused(stored: tuple) -> None:
    with pytest.raises(SourceError, match=r"every 0\.1 s, the monitor needs one every 0\.05 s"):
        fly(stored, simulated(recipe=to_plain(replace(RECIPE, dt=0.1))))


@pytest.mark.parametrize("rollout", range(4))
def test_an_unsafe_replay_is_the_stored_one_and_goes_on_past_it(
    rollout: int, stored: tuple
) -> None:
    store, clean, _, _ = stored
    request = Replay(kind="replay", dataset=clean, outcome="unsafe", rollout=rollout)
    track, kept = fly(stored, request), store.datasets.rollout(clean, "unsafe", rollout)
    np.testing.assert_array_equal(track.y[: len(kept.y)], kept.y)
    assert len(track.t) == 121
    assert track.fail_index == kept.fail_index
    assert track.theta == kept.theta


def test_a_replay_that_cannot_be_simulated_again_ends_at_the_failure(stored: tuple) -> None:
    """Sensor noise is not stored: other numbers would come out."""
    store, _, noisy, _ = stored
    request = Replay(kind="replay", dataset=noisy, outcome="unsafe", rollout=1)
    track, kept = fly(stored, request), store.datasets.rollout(noisy, "unsafe", 1)
    np.testing.assert_array_equal(track.y, kept.y)
    assert track.fail_index == len(track.t) - 1 < 120


def test_a_safe_replay_is_the_stored_one(stored: tuple) -> None:
    store, clean, _, _ = stored
    track = fly(stored, Replay(kind="replay", dataset=clean, outcome="safe", rollout=2))
    np.testing.assert_array_equal(track.y, store.datasets.rollout(clean, "safe", 2).y)
    assert track.fail_index is None
    with pytest.raises(NotFound, match="numbered from 0"):
        fly(stored, Replay(kind="replay", dataset=clean, outcome="safe", rollout=10**6))


def test_attitude_is_integrated_where_it_was_not_measured() -> None:
    y = np.zeros((21, 6))
    y[:, 1] = 0.1
    track = Track(times(21, 0.05), y, 0.05)
    assert track.attitude[-1, 0] == pytest.approx(0.1, rel=0.02)
    measured = np.full((21, 3), 0.5)
    assert Track(track.t, y, 0.05, measured).attitude is measured


def test_the_aircraft_of_a_recipe_gives_the_trim() -> None:
    plain = to_plain(RECIPE)
    assert trim_angles(plain)[0] > 0
    for unknown in ({}, {"aircraft": "oscillator"}):
        assert trim_angles(unknown) == (0.0, 0.0)


def test_the_planned_attitude_is_that_of_the_exact_flight_of_the_nominal_aircraft(
    stored: tuple,
) -> None:
    exact = simulate(RECIPE, theta={})
    flown = simulate(RECIPE.as_flown(), seed=5)
    np.testing.assert_array_equal(exact.planned, exact.attitude)
    np.testing.assert_array_equal(flown.planned, exact.attitude[: len(flown.t)])
    assert (flown.attitude != flown.planned).any()
    assert planned_attitude(RECIPE, len(exact.t) + 1) is None
    replayed = fly(stored, Replay(kind="replay", dataset=stored[1], outcome="safe", rollout=0))
    np.testing.assert_array_equal(replayed.planned, exact.attitude[: len(replayed.t)])
