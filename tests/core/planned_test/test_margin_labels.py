"""Stability margins label rollouts by their aircraft, and nothing else of a test changes."""

from dataclasses import replace

import numpy as np
import pytest

from app.campaigns.point import Condition
from core.evaluation.study import StudyRecipe
from core.monitor import MonitorRecipe, load, train
from core.planned_test.amplitude import suggest_amplitude
from core.planned_test.collection import CollectionError, collect
from core.planned_test.nonlinear_test import NonlinearTest
from core.planned_test.planned_test import DatasetRecipe
from core.simulation.aircraft import AIRCRAFT
from core.simulation.control_law import NoFeedback
from core.simulation.pilot import Crossover, Intervention
from core.simulation.stability_margins import LeastMargins, stability_margins
from core.types import Array

PLANNED = replace(
    DatasetRecipe.usual(AIRCRAFT["attas_id_16kft"]).as_flown(), n_unsafe=15, n_obs=20, seed=3
)
LABELLED = replace(PLANNED, margins=LeastMargins(phase_deg=73.0, disk=1.25))


def margins_of(planned: DatasetRecipe, theta: Array) -> tuple[Array, Array, Array]:
    plant = planned.aircraft.uncertain_plant()
    law = planned.control_law
    return stability_margins(plant.plants(theta), law.controller(plant), law.actuator)


def test_a_rollout_fails_at_its_last_sample_iff_its_aircraft_has_too_little_margin():
    dataset = collect(LABELLED)
    assert len(dataset.unsafe) == 15
    assert (dataset.fail_index == dataset.unsafe.shape[1] - 1).all()
    for theta, fails in ((dataset.theta_unsafe, True), (dataset.theta_safe, False)):
        _, phase, disk = margins_of(PLANNED, theta)
        assert (((phase <= 73.0) | (disk <= 1.25)) == fails).all()
    assert np.isfinite(dataset.unsafe).all()


def test_flights_are_those_of_the_planned_test():
    flights = PLANNED.simulator().rollouts(30, np.random.default_rng(1))
    simulator = LABELLED.simulator()
    labelled = simulator.rollouts(30, np.random.default_rng(1))
    np.testing.assert_array_equal(labelled.y, flights.y)
    np.testing.assert_array_equal(labelled.theta, flights.theta)
    assert 0 < labelled.is_unsafe.sum() < 30
    again, _ = simulator.fly(flights.theta, np.random.default_rng(2))
    np.testing.assert_array_equal(again.is_unsafe, labelled.is_unsafe)


def test_a_monitor_names_the_requirement_and_has_no_limits(tmp_path):
    dataset = collect(LABELLED)
    monitor = train(dataset, MonitorRecipe(epsilon=0.2))
    monitor.save(tmp_path / "margin.fwm")
    again = load(tmp_path / "margin.fwm")
    assert again.specification == "requirement phase margin > 73 deg and disk margin > 1.25"
    assert again.envelope is None
    recipe = LABELLED.to_plain()
    assert again.dataset_recipe == recipe
    assert recipe.pop("margins") == {"gain_db": None, "phase_deg": 73.0, "disk": 1.25}
    assert recipe == PLANNED.to_plain()


def test_nonlinear_aircraft_are_linearised_at_their_own_trim():
    planned = NonlinearTest()
    simulator = planned.simulator()
    theta = planned.aircraft.parameters.sample(3, np.random.default_rng(5))
    together = simulator.margins(theta)
    for k in range(3):
        alone = simulator.margins(theta[k : k + 1])
        np.testing.assert_allclose([each[k] for each in together], np.ravel(alone), rtol=1e-9)
    assert len(set(together.disk.tolist())) == 3


def test_bounds_that_no_aircraft_violates_are_refused_with_the_margins_there_are():
    test = replace(PLANNED, max_rollouts=600, margins=LeastMargins(phase_deg=5.0))
    with pytest.raises(
        CollectionError, match=r"phase margins of 6\d\.\d to 8\d\.?\d* deg.*raise"
    ) as refused:
        collect(test)
    assert "max_rollouts" not in str(refused.value)
    bare = replace(test, control_law=NoFeedback(), margins=LeastMargins(gain_db=6.0))
    with pytest.raises(ValueError, match="a law with feedback"):
        bare.first_margins()


@pytest.mark.parametrize(("name", "value"), [("phase_deg", 180), ("gain_db", -6), ("disk", 3)])
def test_margins_that_no_loop_has_are_refused_with_their_range(name: str, value: float):
    with pytest.raises(ValueError, match=f"{name}={value} was given: give its least .* below"):
        LeastMargins(**{name: value})


def test_a_pilot_who_gives_up_labels_alone():
    gives_up = Crossover(intervention=Intervention(error_deg=10.0))
    with pytest.raises(ValueError, match="omit one"):
        replace(LABELLED, pilot=gives_up)


def test_what_compares_limits_refuses_margins():
    with pytest.raises(ValueError, match="a study needs limits"):
        StudyRecipe(LABELLED)
    with pytest.raises(ValueError, match="a campaign needs limits"):
        Condition("Mach 0.6", LABELLED)
    with pytest.raises(ValueError, match="choose it yourself"):
        suggest_amplitude(LABELLED)
