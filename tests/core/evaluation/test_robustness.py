"""Flights that differ from the planned test, and the monitor on them."""

from dataclasses import replace

import numpy as np
import pytest

from app.recipes.recipes import USUAL_MONITOR
from core.evaluation.lead_sweep import METHODS, TESTS
from core.evaluation.rates import Evaluation
from core.evaluation.robustness import (
    DIFFERENCES,
    _flown,
    _other_types,
    by_aircraft,
    robustness,
)
from core.limits.limits import Limits
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import (
    DatasetRecipe,
    collect,
    combination_failures,
    fresh,
    training_rollouts,
)
from core.planned_test.near import (
    FLIGHTS_EACH,
    fly_each,
    near_aircraft,
    near_failures,
    near_rollouts,
    softer,
)
from core.planned_test.nonlinear_test import NonlinearTest
from core.planned_test.planned_test import LateralSimulator, SensorNoise
from core.seeds import Branch
from core.simulation.aircraft import AIRCRAFT, IdentifiedAircraft
from core.simulation.imperfections import USUAL_IMPERFECTIONS, Imperfections
from core.simulation.maneuver import MANEUVERS
from core.simulation.pilot import Crossover
from core.simulation.published import MODELS

RECIPE = DatasetRecipe(n_unsafe=30, noise=SensorNoise(beta=0.001, Ny=0.004), seed=4)


def test_each_difference_changes_one_thing() -> None:
    recipes = {name: difference.recipe(RECIPE) for name, difference in DIFFERENCES.items()}
    assert recipes["opposite_input"].maneuver.peak_deg == -RECIPE.maneuver.peak_deg
    assert recipes["doubled_noise"].noise == SensorNoise(beta=0.002, Ny=0.008)
    assert recipes["wider_theta"] == RECIPE
    assert replace(recipes["opposite_input"], maneuver=RECIPE.maneuver) == RECIPE
    assert len({difference.number for difference in DIFFERENCES.values()}) == len(DIFFERENCES)


def test_a_slower_input_is_the_planned_one_on_a_stretched_time() -> None:
    slower = DIFFERENCES["slower_input"].recipe(RECIPE).maneuver
    planned, flown = (
        maneuver.pilot(0.05, 1, np.random.default_rng(0))[0]
        for maneuver in (RECIPE.maneuver, slower)
    )
    at = round(RECIPE.maneuver.lead_in_s / 0.05)
    last = (len(planned) - 1 - at) // 3
    np.testing.assert_array_equal(flown[at::3][: last + 1], planned[at::2][: last + 1])
    assert np.count_nonzero(flown) == 1.5 * np.count_nonzero(planned)


def test_a_stopped_input_is_the_planned_one_up_to_its_middle() -> None:
    stopped = DIFFERENCES["stopped_input"].recipe(RECIPE).maneuver
    planned, flown = (
        maneuver.pilot(0.05, 1, np.random.default_rng(0))[0]
        for maneuver in (RECIPE.maneuver, stopped)
    )
    middle = round((RECIPE.maneuver.lead_in_s + 1.0) / 0.05)  # of two halves of 1 s
    np.testing.assert_array_equal(flown[:middle], planned[:middle])
    assert not flown[middle:].any()
    assert planned[middle:].any()


def test_imperfections_are_usual_or_worse_than_trained() -> None:
    worse = DIFFERENCES["imperfections"].recipe
    assert worse(RECIPE).imperfections == USUAL_IMPERFECTIONS
    rougher = worse(RECIPE.as_flown()).imperfections
    assert rougher.turbulence == "light"
    assert (rougher.gain, rougher.lag_s) == (0.04, 0.06)
    given = replace(RECIPE, imperfections=Imperfections("given", 0.2))
    assert worse(given).imperfections.gust_sigma_deg == 0.4
    assert DIFFERENCES["timing"].recipe(RECIPE).maneuver.timing_jitter_s == 0.1


def test_a_wider_theta_has_the_same_mean() -> None:
    narrow, wide = (
        LateralSimulator(RECIPE, spread).rollouts(50, np.random.default_rng(3)).theta
        for spread in (1.0, 1.5)
    )
    nominal = LateralSimulator(RECIPE).plant.nominal
    np.testing.assert_allclose(wide - nominal, 1.5 * (narrow - nominal), atol=1e-12)


@pytest.mark.parametrize("lag_s", [0.2, 0.3, 0.5])
def test_a_softer_input_is_as_large_as_a_quarter_of_flights_needs_to_exceed(lag_s: float) -> None:
    softer = DIFFERENCES[f"lag_{lag_s}"].recipe(RECIPE.as_trained())
    peak = softer.maneuver.peak_deg
    assert peak > RECIPE.maneuver.peak_deg
    planned = replace(RECIPE.as_flown().maneuver, pedal_lag_s=lag_s)
    assert softer.maneuver == planned.with_peak(peak)
    assert softer.imperfections == USUAL_IMPERFECTIONS
    flown = LateralSimulator(softer).rollouts(400, np.random.default_rng(6))
    assert flown.is_unsafe.mean() == pytest.approx(0.25, abs=0.08)


def test_an_input_that_exceeds_at_no_amplitude_is_flown_as_planned() -> None:
    never = replace(RECIPE, specification=Limits(Ny=1e3))
    assert softer(never, 0.3).maneuver == replace(never.maneuver, pedal_lag_s=0.3)


def test_near_aircraft_have_each_derivative_within_the_factor() -> None:
    simulator = LateralSimulator(RECIPE)
    rng = np.random.default_rng(2)
    theta = near_aircraft(simulator.parameters, 1.25, 40, rng)
    flights, aircraft = fly_each(simulator, theta, rng, FLIGHTS_EACH, 5, 1)
    factors = flights.theta / simulator.plant.nominal
    assert (np.abs(np.log(factors)) <= np.log(1.25)).all()
    assert np.log(factors).std() == pytest.approx(np.log(1.25) / np.sqrt(3), rel=0.1)
    for number in np.unique(aircraft):
        own = flights.some(aircraft == number)
        assert (own.theta == own.theta[0]).all()
        assert np.count_nonzero(own.is_unsafe) <= 5
        assert np.count_nonzero(~own.is_unsafe) <= 1


def test_every_other_published_type_flies_the_test() -> None:
    flown = _other_types(RECIPE, 60, np.random.default_rng(0))
    assert flown is not None
    flights, type_of = flown
    assert np.bincount(type_of).tolist() == [10] * 6
    nominal = [replace(RECIPE.aircraft, name=name).uncertain_plant().nominal for name in MODELS]
    nearest = [
        int(np.argmin([np.linalg.norm(theta - each) for each in nominal]))
        for theta in flights.theta
    ]
    others = [k for k, name in enumerate(MODELS) if name != "f16_sl_h0_v502"]
    assert nearest == np.repeat(others, 10).tolist()


def test_an_identified_aircraft_is_no_other_type_than_its_base() -> None:
    identified = IdentifiedAircraft.undetermined(RECIPE.aircraft)
    flown = _other_types(replace(RECIPE, aircraft=identified), 60, np.random.default_rng(0))
    assert flown is not None
    assert flown[1].max() == 5
    own_model = _other_types(
        replace(RECIPE, aircraft=AIRCRAFT["matrices"]), 70, np.random.default_rng(0)
    )
    assert own_model is not None
    assert own_model[1].max() == 6


def test_other_types_that_cannot_fly_the_test_leave_no_row(monkeypatch) -> None:
    def refused(*_: object) -> None:
        raise ValueError("unstable")

    monkeypatch.setattr("core.evaluation.robustness.retuned", refused)
    assert _other_types(RECIPE, 60, np.random.default_rng(0)) is None


def test_the_worst_aircraft_has_enough_failures() -> None:
    counts = Evaluation(
        np.array([0.1]), 14, 0, 0, *[np.array([4])] * 4,
        failures_of=np.array([1, 5, 5, 3]), misses_of=np.array([[1], [2], [1], [3]]),
    )  # fmt: skip
    assert by_aircraft(counts) == {"n_aircraft": 4, "worst": [2, 5]}
    few = replace(counts, failures_of=np.array([1, 1, 1, 3]))
    assert by_aircraft(few) == {"n_aircraft": 4, "worst": None}
    assert by_aircraft(replace(counts, failures_of=None, misses_of=None)) == {}


def test_an_opposite_input_is_invalid_and_not_silent() -> None:
    monitor = train(collect(RECIPE), MonitorRecipe(t_early=0.5), fresh(RECIPE))
    evaluations = robustness(monitor, RECIPE, 200)
    opposite = evaluations["opposite_input"]
    assert opposite.n_unsafe + opposite.n_safe == 200
    assert opposite.withdrawn[0] > 0.9 * opposite.n_unsafe
    assert opposite.safe_withdrawn[0] > 0.9 * opposite.n_safe
    assert (opposite.safe_withdrawn <= opposite.n_safe - opposite.false_alerts).all()
    near = by_aircraft(evaluations["near_1.5"])
    assert 60 <= near["n_aircraft"] <= 150
    assert by_aircraft(opposite) == {}
    assert 1 <= by_aircraft(evaluations["other_type"])["n_aircraft"] <= 6
    assert evaluations["doubled_noise"].withdrawn[0] < 0.2 * evaluations["doubled_noise"].n_unsafe


@pytest.mark.parametrize("test", [RECIPE, NonlinearTest(maneuver=MANEUVERS["rudder_doublet"])])
def test_another_pilot_flies_in_the_loop(test: DatasetRecipe | NonlinearTest) -> None:
    for name, gain, delay in (
        ("pilot_high_gain", 1.5, 0.0),
        ("pilot_low_gain", 2 / 3, 0.0),
        ("pilot_delay", 1.0, 0.1),
    ):
        change = DIFFERENCES[name].pilot
        assert change is not None
        for planned in (Crossover(), Crossover(axis="bank", crossover_rad_s=1.0)):
            pilot = change(replace(test, pilot=planned)).pilot
            assert isinstance(pilot, Crossover)
            assert pilot.crossover_rad_s == pytest.approx(gain * planned.crossover_rad_s)
            assert pilot.delay_s == pytest.approx(planned.delay_s + delay)
        assert change(test) == change(replace(test, pilot=Crossover()))


def test_pilots_leave_no_row_where_the_manoeuvre_moves_their_surface() -> None:
    rng, difference = np.random.default_rng(0), DIFFERENCES["pilot_delay"]
    assert _flown(RECIPE, difference, 20, rng) is not None
    aileron = replace(RECIPE, maneuver=MANEUVERS["aileron_doublet"])
    assert _flown(aileron, difference, 20, rng) is None


@pytest.mark.fuzz
@pytest.mark.parametrize("plant", TESTS)
def test_the_default_misses_at_most_epsilon_and_a_half_near_its_test(plant: str) -> None:
    """Aircraft beside the planned one, and softer hands, every aircraft of the same weight."""
    recipe = replace(TESTS[plant].as_trained(), n_unsafe=500, seed=9)
    failures, _ = combination_failures(recipe, 500, branch=Branch.ENSEMBLE)
    monitor = train(
        collect(recipe),
        USUAL_MONITOR,
        fresh(recipe),
        rollouts=near_rollouts(recipe),
        failures=failures,
        near=near_failures(recipe, 500),
    )
    for name, counts in robustness(monitor, recipe, 2000).items():
        if name.startswith(("lag_", "near_")):
            assert counts.n_unsafe > 50, name
            assert counts.miss_rate[0] <= 1.5 * USUAL_MONITOR.epsilon, (name, counts)


@pytest.mark.fuzz
@pytest.mark.parametrize("method", ["linear + nearest neighbor", "peaks ahead: rest"])
@pytest.mark.parametrize("plant", TESTS)
def test_few_failures_are_valid_and_missed_when_the_card_differs(plant: str, method: str) -> None:
    """The guarantee does not cover these; nearly all with the opposite card are invalid.

    Under softer inputs and on near aircraft each of these methods alone misses more on some plant.
    """
    recipe = replace(TESTS[plant], n_unsafe=300, seed=2_026_11).as_flown()
    predictor, score = METHODS[method]
    epsilon, rollouts = 0.05, training_rollouts(recipe) if score.reads_card else None
    monitor = train(
        collect(recipe),
        MonitorRecipe(epsilon=epsilon, predictor=predictor, score=score),
        fresh(recipe),
        rollouts=rollouts,
    )
    evaluations = robustness(monitor, recipe, 800)
    for name, counts in evaluations.items():
        n = max(counts.n_unsafe, 1)
        if name.startswith(("lag_", "near_")):
            assert counts.n_unsafe > 0, name
            continue
        most = 3 * epsilon + 3 * np.sqrt(3 * epsilon / n)
        assert counts.misses[0] / n <= most, (name, counts)
    opposite = evaluations["opposite_input"]
    assert opposite.misses[0] <= 0.02 * opposite.n_unsafe
    assert opposite.withdrawn[0] >= 0.9 * opposite.n_unsafe
