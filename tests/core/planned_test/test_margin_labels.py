"""Stability margins label rollouts by their aircraft, and nothing else of a test changes."""

from dataclasses import replace

import numpy as np
import pytest

from core.monitor import MonitorRecipe, load, train
from core.planned_test.collection import CollectionError, collect
from core.planned_test.margin_labels import MarginBound, MarginSimulator, labelled_by_margins
from core.planned_test.nonlinear_test import NonlinearTest
from core.planned_test.planned_test import DatasetRecipe
from core.simulation.aircraft import AIRCRAFT
from core.simulation.control_law import NoFeedback
from core.simulation.stability_margins import stability_margins
from core.types import Array

PLANNED = replace(
    DatasetRecipe.usual(AIRCRAFT["attas_id_16kft"]).as_flown(), n_unsafe=15, n_obs=20, seed=3
)
BOUNDS = (MarginBound("phase", 73.0), MarginBound("disk", 1.25))


def margins_of(planned: DatasetRecipe, theta: Array) -> tuple[Array, Array, Array]:
    plant = planned.aircraft.uncertain_plant()
    law = planned.control_law
    return stability_margins(plant.plants(theta), law.controller(plant), law.actuator)


def test_a_rollout_fails_at_its_last_sample_iff_its_aircraft_has_too_little_margin():
    dataset = collect(labelled_by_margins(PLANNED, BOUNDS))
    assert len(dataset.unsafe) == 15
    assert (dataset.fail_index == dataset.unsafe.shape[1] - 1).all()
    for theta, fails in ((dataset.theta_unsafe, True), (dataset.theta_safe, False)):
        _, phase, disk = margins_of(PLANNED, theta)
        assert (((phase <= 73.0) | (disk <= 1.25)) == fails).all()
    assert np.isfinite(dataset.unsafe).all()


def test_flights_are_those_of_the_planned_test():
    flights = PLANNED.simulator().rollouts(30, np.random.default_rng(1))
    test = labelled_by_margins(PLANNED, BOUNDS)
    labelled = test.simulator().rollouts(30, np.random.default_rng(1))
    np.testing.assert_array_equal(labelled.y, flights.y)
    np.testing.assert_array_equal(labelled.theta, flights.theta)
    assert 0 < labelled.is_unsafe.sum() < 30
    again, _ = test.simulator().fly(flights.theta, np.random.default_rng(2))  # type: ignore[attr]
    np.testing.assert_array_equal(again.is_unsafe, labelled.is_unsafe)


def test_a_monitor_names_the_requirement_and_has_no_limits(tmp_path):
    dataset = collect(labelled_by_margins(PLANNED, BOUNDS))
    monitor = train(dataset, MonitorRecipe(epsilon=0.2))
    monitor.save(tmp_path / "margin.fwm")
    again = load(tmp_path / "margin.fwm")
    assert again.specification == "requirement phase margin > 73 deg and disk margin > 1.25"
    assert again.envelope is None
    assert again.dataset_recipe["planned"] == PLANNED.to_plain()


def test_nonlinear_aircraft_are_linearised_at_their_own_trim():
    planned = NonlinearTest()
    simulator = MarginSimulator(planned, ())
    theta = planned.aircraft.parameters.sample(3, np.random.default_rng(5))
    together = simulator.margins(theta)
    for k in range(3):
        alone = simulator.margins(theta[k : k + 1])
        np.testing.assert_allclose([each[k] for each in together], np.ravel(alone), rtol=1e-9)
    assert len(set(together.disk.tolist())) == 3


def test_bounds_that_no_aircraft_violates_are_refused_with_the_margins_there_are():
    test = replace(PLANNED, max_rollouts=600)
    with pytest.raises(CollectionError, match=r"phase margins of 6\d\.\d to 8\d\.?\d* deg.*bound"):
        collect(labelled_by_margins(test, [MarginBound("phase", 5.0)]))
    with pytest.raises(ValueError, match="a law with feedback"):
        labelled_by_margins(replace(test, control_law=NoFeedback()), [MarginBound("gain", 6.0)])
