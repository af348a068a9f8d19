from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from core.limits.limits import Limits
from core.monitor.group import GROUPINGS, LargestDeflection
from core.planned_test.collection import CollectionError, DatasetRecipe, collect
from core.planned_test.planned_test import LateralSimulator, SensorNoise
from core.simulation.aircraft import AIRCRAFT, PublishedAircraft, Uncertainty
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.imperfections import Imperfections
from core.simulation.maneuver import LATERAL_MANEUVERS, MANEUVERS
from core.simulation.pilot import PILOTS, usual_pilot
from core.simulation.rollout import roll_out
from core.types import Array

RECIPE = DatasetRecipe(n_unsafe=30)


def with_amplitude(degrees: float, recipe: DatasetRecipe = RECIPE) -> DatasetRecipe:
    return replace(recipe, maneuver=replace(recipe.maneuver, amplitude_deg=degrees))


def test_dataset_is_labelled_and_cut_at_the_failure():
    dataset = collect(RECIPE)
    assert dataset.unsafe.shape == (30, 121, 6)
    after = np.arange(121) > dataset.fail_index[:, None]
    assert np.isnan(dataset.unsafe[after]).all()
    assert np.isfinite(dataset.unsafe[~after]).all()
    limits = RECIPE.specification
    np.testing.assert_array_equal(limits.first_exceedance(dataset.unsafe), dataset.fail_index)
    assert (limits.first_exceedance(dataset.safe) == 121).all()
    assert len(dataset.safe) == dataset.n_safe_met == len(dataset.theta_safe)
    assert dataset.theta_unsafe.shape == (30, len(dataset.theta_names))


def test_safe_times_are_distinct_sorted_and_cover_the_horizon():
    times = collect(RECIPE).safe_times
    assert times.shape[1] == 50
    assert (np.diff(times, axis=1) > 0).all()
    assert times.min() == 0
    assert times.max() == 120


def test_theta_of_a_rollout_reproduces_it():
    dataset = collect(RECIPE)
    simulator = LateralSimulator(RECIPE)
    again = roll_out(
        simulator.plant.plants(dataset.theta_safe),
        simulator.controller,
        RECIPE.control_law.actuator,
        RECIPE.maneuver.pilot(RECIPE.dt, 1, np.random.default_rng(0)),
        RECIPE.dt,
        pedal_lag_s=RECIPE.maneuver.pedal_lag_s,
    )
    np.testing.assert_array_equal(again, dataset.safe)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_the_result_depends_only_on_the_recipe(workers: int):
    alone = collect(RECIPE)
    with ThreadPoolExecutor(workers) as executor:
        shared = collect(RECIPE, executor=executor)
    assert alone.digest() == shared.digest()
    assert alone.digest() != collect(replace(RECIPE, seed=1)).digest()


def test_a_larger_collection_starts_with_the_smaller_one():
    small, large = collect(RECIPE), collect(replace(RECIPE, n_unsafe=400))
    np.testing.assert_array_equal(small.theta_unsafe, large.theta_unsafe[:30])
    np.testing.assert_array_equal(small.safe, large.safe[: len(small.safe)])


def test_the_unsafe_rate_is_unbiased_although_collection_stops_at_a_failure():
    rates = [collect(replace(RECIPE, n_unsafe=8, seed=seed)).unsafe_rate for seed in range(400)]
    many = LateralSimulator(RECIPE).rollouts(40_000, np.random.default_rng(99)).is_unsafe
    error = np.hypot(np.std(rates) / 20, many.std() / 200)
    assert abs(np.mean(rates) - many.mean()) < 3 * error
    naive = np.mean([8 / (7 / rate + 1) for rate in rates])  # N / (N + M) of the same runs
    assert naive - many.mean() > 3 * error


def test_safe_rollouts_above_the_cap_are_counted_but_not_kept():
    everything, capped = collect(RECIPE), collect(replace(RECIPE, max_safe=20))
    np.testing.assert_array_equal(capped.safe, everything.safe[:20])
    np.testing.assert_array_equal(capped.unsafe, everything.unsafe)
    assert capped.unsafe_rate == everything.unsafe_rate


def test_a_collection_that_would_not_end_stops_early_with_a_reason():
    with pytest.raises(CollectionError, match=r"0 of \d+ rollouts .* raise the amplitude"):
        collect(with_amplitude(0.5, replace(RECIPE, max_rollouts=20_000)))


def test_where_no_amplitude_fails_none_is_advised():
    capture = replace(MANEUVERS["bank_capture"], duration_s=3.0)
    test = replace(DatasetRecipe(), maneuver=capture, pilot=PILOTS["crossover"], max_rollouts=5_000)
    with pytest.raises(CollectionError, match=r"0 of .* even at 45 deg") as refused:
        collect(test)
    assert "raise the amplitude" not in f"{refused.value}"
    assert "lower the limit or choose another manoeuvre" in f"{refused.value}"


def test_the_budget_is_exact():
    with pytest.raises(CollectionError, match=r"of 100 rollouts"):
        collect(replace(RECIPE, n_unsafe=100, max_rollouts=100))
    enough = collect(replace(RECIPE, n_unsafe=10, max_rollouts=100))
    assert enough.n_safe_met <= 90


def test_certain_aircraft_without_failures_ends():
    certain = PublishedAircraft("f16_sl_h0_v502", 3, Uncertainty(0.0))
    with pytest.raises(CollectionError, match="out of reach"):
        collect(with_amplitude(1.0, replace(RECIPE, aircraft=certain, max_rollouts=5_000)))


def test_a_collection_without_safe_rollouts_is_refused():
    with pytest.raises(CollectionError, match=r"all 30 rollouts were unsafe.*lower the amplitude"):
        collect(with_amplitude(60.0))


def test_an_exception_in_progress_cancels():
    def cancel(found: int, made: int) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        collect(RECIPE, progress=cancel)


BY_LIMIT = replace(
    RECIPE, specification=Limits(Ny=0.5, p=0.35), groups=GROUPINGS["first_limit"], n_unsafe=40
)
"""About half of its rollouts exceed each limit first."""


@pytest.mark.parametrize(
    "recipe",
    [
        BY_LIMIT,
        replace(BY_LIMIT, groups=LargestDeflection()),
        replace(
            with_amplitude(9.5, RECIPE).as_flown(), groups=LargestDeflection(9.0, 10.5), n_unsafe=40
        ),
    ],
)
def test_collection_ends_when_the_last_group_has_enough(recipe: DatasetRecipe) -> None:
    seen: list[tuple[int, int]] = []
    dataset = collect(recipe, progress=lambda *counts: seen.append(counts))
    assert seen[-1] == (40, len(dataset.unsafe) + dataset.n_safe_met)

    def fewest(n: int) -> int:
        grouping = recipe.groups.fit(
            dataset.unsafe[:n], dataset.fail_index[:n], recipe.specification
        )
        assert grouping is not None
        rule, group = grouping
        return min(int(np.count_nonzero(group == k)) for k in range(len(rule.names)))

    assert fewest(len(dataset.unsafe)) == 40
    assert fewest(len(dataset.unsafe) - 1) == 39
    pooled = collect(replace(recipe, groups=GROUPINGS["pooled"], n_unsafe=len(dataset.unsafe)))
    assert pooled.digest() == dataset.digest()


def test_a_group_too_scarce_to_be_collected_is_named() -> None:
    with pytest.raises(CollectionError, match="in the group 'large deflections, from 30"):
        collect(replace(with_amplitude(9.5).as_flown(), groups=LargestDeflection(9.0, 30.0)))
    with pytest.raises(CollectionError, match=r"in a second group: .* choose groups pooled"):
        collect(replace(RECIPE, groups=GROUPINGS["first_limit"]))


def test_progress_reaches_the_wanted_number():
    seen = []
    dataset = collect(replace(RECIPE, n_unsafe=300), progress=lambda *counts: seen.append(counts))
    assert seen[-1] == (300, 300 + dataset.n_safe_met)
    assert seen == sorted(seen)


def test_an_exceedance_between_samples_counts_at_the_later_sample():
    coarse = LateralSimulator(RECIPE).rollouts(2000, np.random.default_rng(5))
    fine = LateralSimulator(replace(RECIPE, substeps=10)).rollouts(2000, np.random.default_rng(5))
    np.testing.assert_allclose(fine.y, coarse.y, atol=1e-12)
    assert (fine.fail_index <= coarse.fail_index).all()
    assert fine.is_unsafe.sum() > coarse.is_unsafe.sum()


def test_noise_has_its_deviation_and_does_not_change_the_labels():
    noise = SensorNoise(beta=0.01, Ny=0.2)
    quiet = LateralSimulator(RECIPE).rollouts(500, np.random.default_rng(5))
    noisy = LateralSimulator(replace(RECIPE, noise=noise)).rollouts(500, np.random.default_rng(5))
    np.testing.assert_array_equal(noisy.fail_index, quiet.fail_index)
    deviation = (noisy.y - quiet.y).std(axis=(0, 1))
    np.testing.assert_allclose(deviation, [0.01, 0, 0, 0.2, 0, 0], rtol=0.02)


@pytest.mark.parametrize("name", AIRCRAFT)
@pytest.mark.parametrize("maneuver", LATERAL_MANEUVERS)
def test_every_aircraft_flies_every_manoeuvre(name: str, maneuver: str):
    planned = LATERAL_MANEUVERS[maneuver]
    pilot = usual_pilot(planned)
    simulator = LateralSimulator(
        replace(RECIPE, aircraft=AIRCRAFT[name], maneuver=planned, pilot=pilot)
    )
    rollouts = simulator.rollouts(16, np.random.default_rng(0))
    assert np.isfinite(rollouts.y).all()
    assert np.abs(rollouts.y).max() > 0


@pytest.mark.parametrize("name", CONTROL_LAWS)
def test_every_control_law_closes_the_loop(name: str):
    aircraft = PublishedAircraft("f16_sl_h0_v502", 4)

    def flown_with(law: str) -> np.ndarray:
        recipe = replace(RECIPE, aircraft=aircraft, control_law=CONTROL_LAWS[law])
        return LateralSimulator(recipe).rollouts(16, np.random.default_rng(0)).y

    closed, opened = flown_with(name), flown_with("none")
    assert np.isfinite(closed).all()
    assert (name == "none") == np.array_equal(closed, opened)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dt": 0.0}, "dt=0.0 s was given"),
        ({"n_unsafe": 1}, "n_unsafe=1 was given: it must be at least 2"),
        ({"n_obs": 122}, "n_obs=122 was given: a rollout has 121 samples"),
        ({"substeps": 0}, "substeps=0"),
        ({"seed": -1}, "seed=-1"),
    ],
)
def test_impossible_recipe_is_refused(change: dict, message: str):
    with pytest.raises(ValueError, match=message):
        replace(RECIPE, **change)


def test_a_limit_on_several_channels_fails_at_the_first_of_them():
    both = replace(RECIPE, specification=Limits(Ny=0.5, beta=0.05))
    single = LateralSimulator(RECIPE).rollouts(500, np.random.default_rng(5))
    two = LateralSimulator(both).rollouts(500, np.random.default_rng(5))
    beta = Limits(Ny=None, beta=0.05).first_exceedance(two.y)
    np.testing.assert_array_equal(two.fail_index, np.minimum(single.fail_index, beta))


def test_records_are_the_true_outputs_from_the_reported_trim() -> None:
    inexact = Imperfections(trim_deg=0.2)
    recipe = replace(DatasetRecipe(), imperfections=inexact, noise=SensorNoise())
    seen: list[tuple[Array, Array]] = []
    flown = LateralSimulator(recipe).recorded(
        20, np.random.default_rng(3), lambda block, y, trim: seen.append((y, trim))
    )
    ((true, trim),) = seen
    np.testing.assert_allclose(flown.y, true, rtol=0, atol=1e-15)
    assert (np.abs(trim).max(axis=1) > 0.0).all()
    again = LateralSimulator(recipe).rollouts(20, np.random.default_rng(3))
    np.testing.assert_array_equal(flown.y, again.y)
