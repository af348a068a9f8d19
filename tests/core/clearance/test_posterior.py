"""Posteriors of simulated aircraft cover them, and show what a record does not determine."""

from dataclasses import replace

import numpy as np
import pytest

from core.clearance.joint_model import Law
from core.clearance.posterior import Fit, PlantPosterior, RecordedStep, fit, prior_of
from core.evaluation.lead_sweep import TESTS
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.simulation.imperfections import channel_array
from core.types import Array

N = 60


def step(test: DatasetRecipe, fraction: float = 0.6) -> LateralSimulator:
    """A step of a build-up to the test."""
    maneuver = test.maneuver.with_peak(fraction * test.maneuver.peak_deg)
    return LateralSimulator(replace(test, maneuver=maneuver))


def identified(
    simulator: LateralSimulator, n: int = N, prior: PlantPosterior | None = None, seed: int = 21
) -> tuple[Array, Fit]:
    """Deviates of n aircraft (n, m), and the fit of one flight of each."""
    test, plant, rng = simulator.recipe, simulator.plant, np.random.default_rng(seed)
    deviates = rng.standard_normal((n, plant.root.shape[1]))
    rollouts, _ = simulator.fly(plant.theta_of(deviates), rng)
    law = Law(simulator.controller, test.control_law.actuator)
    record = RecordedStep(rollouts.y, test.dt, channel_array(test.noise))
    return deviates, fit(plant, law, [record], prior or prior_of(plant, n))


@pytest.mark.parametrize("name", TESTS)
def test_intervals_and_ellipsoids_cover(name: str) -> None:
    """For 60 aircraft: 95 % intervals of all derivatives, and the mean squared distance."""
    deviates, found = identified(step(TESTS[name]))
    mean, covariance = found.posterior
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert 0.92 <= (np.abs(deviates - mean) < 1.96 * sigma).mean() <= 0.985
    off = deviates - mean
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    assert squares.mean() / off.shape[1] == pytest.approx(1.0, abs=0.2)
    np.testing.assert_allclose(found.chi_square.mean(), 1.0, atol=0.1)
    assert sigma.mean() < 0.5, "and a flight tells much"


def test_a_rudder_record_does_not_determine_aileron_derivatives() -> None:
    """If the aileron rests, or its transducer's noise hides its motion."""
    simulator = step(TESTS["ATTAS"])
    _, found = identified(simulator)
    names = np.array(simulator.plant.names)[np.flatnonzero(simulator.plant.spread)]
    of_aileron = np.flatnonzero([name.endswith("_da") for name in names])
    sigma = np.sqrt(np.diagonal(found.posterior.covariance, axis1=1, axis2=2))
    assert (sigma[:, of_aileron] > 0.95).all()
    assert np.abs(found.posterior.mean[:, of_aileron]).max() < 0.5


def test_a_second_step_continues_from_the_first() -> None:
    """One after the other equals both at once."""
    test = TESTS["ATTAS"]
    simulators = step(test, 0.4), step(test, 0.6)
    plant, rng, n = simulators[0].plant, np.random.default_rng(8), 20
    theta = plant.sample(n, rng)
    law = Law(simulators[0].controller, test.control_law.actuator)
    records = [
        RecordedStep(simulator.fly(theta, rng)[0].y, test.dt, channel_array(test.noise))
        for simulator in simulators
    ]
    first = fit(plant, law, records[:1], prior_of(plant, n))
    second = fit(plant, law, records[1:], first.posterior)
    both = fit(plant, law, records, prior_of(plant, n))
    sigma = np.sqrt(np.diagonal(both.posterior.covariance, axis1=1, axis2=2))
    assert (np.abs(second.posterior.mean - both.posterior.mean) / sigma).max() < 0.7
    assert (
        np.diagonal(second.posterior.covariance, axis1=1, axis2=2)
        < 1.001 * np.diagonal(first.posterior.covariance, axis1=1, axis2=2)
    ).all()
    assert second.distance.mean() < 1.5


def test_aircraft_of_a_batch_are_independent() -> None:
    simulator = step(TESTS["F-16"])
    _, three = identified(simulator, 3)
    theta = simulator.plant.theta_of(three.posterior.mean)
    assert theta.shape == (3, 15)
    rng = np.random.default_rng(21)
    deviates = rng.standard_normal((3, simulator.plant.root.shape[1]))
    y = simulator.fly(simulator.plant.theta_of(deviates), rng)[0].y
    law = Law(simulator.controller, simulator.recipe.control_law.actuator)
    noise = channel_array(simulator.recipe.noise)
    for k in range(3):
        alone = fit(
            simulator.plant,
            law,
            [RecordedStep(y[k : k + 1], simulator.recipe.dt, noise)],
            prior_of(simulator.plant, 1),
        )
        np.testing.assert_allclose(alone.posterior.mean[0], three.posterior.mean[k], atol=1e-4)
