"""What the guarantee promises, on plants it was not tuned for."""

from dataclasses import replace

import numpy as np
import pytest

from core.collection import DatasetRecipe
from core.monitor import MonitorRecipe
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.maneuver import Doublet
from core.study import METHODS, StudyRecipe, StudyResult, study

FITS = 16
PLANTS = {
    "f16": (PublishedAircraft("f16_sl_h0_v502", 3), "f16_damper", 9.5),
    "f104a": (PublishedAircraft("f104a_sl_m0p8", 3), "f104a_damper", 3.7),
    "attas": (PublishedAircraft("attas_id_16kft", 4), "none", 9.6),
    "dc8": (PublishedAircraft("dc8_15k_m0p44", 4), "none", 26.0),
}


@pytest.fixture(scope="module", params=PLANTS)
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
@pytest.mark.parametrize("method", METHODS)
def test_mean_miss_rate_keeps_epsilon(results, calibration: str, method: str):
    found = results[calibration].methods[method]
    shares = found.misses / found.n_unsafe
    error = shares.std(axis=0, ddof=1) / np.sqrt(FITS)
    assert (shares.mean(axis=0) <= found.epsilons + 3 * error + 1e-12).all()


def test_trajectory_calibration_has_more_power(results):
    name = "linear + nearest neighbor"
    pointwise, trajectory = (
        results[calibration].methods[name] for calibration in ("pointwise", "trajectory")
    )
    assert (trajectory.false_alerts <= pointwise.false_alerts).all()
    below = pointwise.epsilons <= 0.3
    assert (trajectory.power - pointwise.power)[below].mean() > 0.005


def test_pointwise_guarantee_is_not_idle(results):
    """A rule that alerted always would keep epsilon too: failures must be missed about as often."""
    found = results["trajectory"].methods["linear + nearest neighbor"]
    assert found.miss_rate[found.epsilons >= 0.3].min() > 0.1
