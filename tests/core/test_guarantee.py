"""The guarantee holds on plants it was not tuned for."""

from dataclasses import replace

import numpy as np
import pytest

from core.evaluation.baselines import BASELINES
from core.evaluation.rates import evaluate
from core.evaluation.study import METHODS, StudyRecipe, StudyResult, study
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, collect
from core.planned_test.planned_test import LateralSimulator
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.imperfections import Imperfections
from core.simulation.maneuver import Doublet

FITS = 16
PLANTS = {
    "f16": (PublishedAircraft("f16_sl_h0_v502", 3), "f16_damper", 9.5),
    "f104a": (PublishedAircraft("f104a_sl_m0p8", 3), "f104a_damper", 3.7),
    "attas": (PublishedAircraft("attas_id_16kft", 4), "none", 9.6),
    "dc8": (PublishedAircraft("dc8_15k_m0p44", 4), "none", 26.0),
}
EVERY_TIME = "dc8"
"""The plant that `make test` studies; `make fuzz` studies the others as well."""


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=() if name == EVERY_TIME else pytest.mark.fuzz) for name in PLANTS
    ],
)
def results(request: pytest.FixtureRequest) -> dict[str, StudyResult]:
    """Return the study of one plant with each calibration."""
    aircraft, law, amplitude = PLANTS[request.param]
    dataset = DatasetRecipe(
        aircraft=aircraft,
        control_law=CONTROL_LAWS[law],
        maneuver=Doublet(surface="rudder", amplitude_deg=amplitude),
        seed=11,
    )
    recipe = StudyRecipe(dataset=dataset, n_monitors=FITS, n_test=400)
    return {
        calibration: study(replace(recipe, monitor=MonitorRecipe(calibration=calibration)))
        for calibration in ("pointwise", "trajectory")
    }


def test_plants_are_worth_studying(results: dict[str, StudyResult]):
    assert 0.02 < results["pointwise"].unsafe_rate < 0.5


@pytest.mark.parametrize("calibration", ["pointwise", "trajectory"])
@pytest.mark.parametrize("method", [*METHODS, *BASELINES])
def test_mean_miss_rate_keeps_epsilon(results, calibration: str, method: str):
    result = results[calibration].methods[method]
    shares = result.misses / result.n_unsafe
    error = shares.std(axis=0, ddof=1) / np.sqrt(FITS)
    assert (shares.mean(axis=0) <= result.epsilons + 3 * error + 1e-12).all()


def test_trajectory_calibration_has_more_power(results):
    name = "linear + nearest neighbor"
    pointwise, trajectory = (
        results[calibration].methods[name] for calibration in ("pointwise", "trajectory")
    )
    assert (trajectory.false_alerts <= pointwise.false_alerts).all()
    below = pointwise.epsilons <= 0.3
    assert (trajectory.power - pointwise.power)[below].mean() > 0.005


def test_the_pointwise_guarantee_is_not_trivial(results):
    """A rule that always alerts keeps epsilon too, so failures must be missed about as often."""
    result = results["trajectory"].methods["linear + nearest neighbor"]
    assert result.miss_rate[result.epsilons >= 0.3].min() > 0.1


@pytest.fixture(scope="module")
def miss_rates() -> dict[str, np.ndarray]:
    """At epsilon 0.1, for monitors trained without and with the imperfections of the flights."""
    flown = DatasetRecipe.usual(PublishedAircraft("dc8_15k_m0p44", 4)).as_flown()
    flown = replace(flown, n_unsafe=100, n_obs=20)
    trained_on = {"lacking": replace(flown, imperfections=Imperfections()), "whole": flown}
    rates = {name: np.empty(8) for name in trained_on}
    for fit in range(8):
        flights = LateralSimulator(flown).rollouts(500, np.random.default_rng(100 + fit))
        for name, recipe in trained_on.items():
            monitor = train(collect(replace(recipe, seed=fit)), MonitorRecipe(epsilon=0.1))
            result = evaluate(monitor, flights.y, flights.fail_index, np.array([0.1]))
            rates[name][fit] = result.miss_rate[0]
    return rates


def test_imperfections_missing_in_training_break_the_guarantee(miss_rates: dict[str, np.ndarray]):
    lacking = miss_rates["lacking"]
    assert lacking.mean() - 3 * lacking.std(ddof=1) / np.sqrt(len(lacking)) > 0.13


def test_imperfections_in_training_keep_the_guarantee(miss_rates: dict[str, np.ndarray]):
    whole = miss_rates["whole"]
    assert whole.mean() <= 0.1 + 3 * whole.std(ddof=1) / np.sqrt(len(whole))
    assert whole.mean() < 0.6 * miss_rates["lacking"].mean()
