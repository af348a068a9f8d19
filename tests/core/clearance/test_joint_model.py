"""The joint model of aircraft, law and surfaces, against exact matrices and dense covariances."""

import numpy as np
import pytest
from scipy.linalg import block_diag, expm
from scipy.signal import StateSpace, lsim

from core.channels import N_CHANNELS
from core.clearance.joint_model import (
    Law,
    SurfaceMotion,
    driven_response,
    exponential,
    joint_flow,
    joint_model,
    law_part,
)
from core.clearance.kalman import gains, white_residuals
from core.evaluation.lead_sweep import TESTS
from core.planned_test.planned_test import LateralSimulator
from core.simulation.control_law import closed_loops
from core.simulation.uncertain_plant import Plants
from core.types import Array

DT = 0.05
NOISE = np.array([0.001, 0.004, 0.001, 0.004, 0.003, 0.0003])


def made(name: str, n: int) -> tuple[Plants, Law, SurfaceMotion]:
    """Random aircraft of a planned test, its law, and a surface motion."""
    simulator = LateralSimulator(TESTS[name])
    plants = simulator.plant.plants(simulator.plant.sample(n, np.random.default_rng(1)))
    law = Law(simulator.controller, TESTS[name].control_law.actuator)
    motion = SurfaceMotion(np.full((n, 2), 0.2), np.array([[0.01, 0.1]] * n))
    return plants, law, motion


def test_exponential_equals_scipy() -> None:
    x = np.random.default_rng(2).normal(size=(4, 9, 9)) * np.array([0.01, 0.3, 2, 9])[:, None, None]
    for one, found in zip(x, exponential(x), strict=True):
        exact = expm(one)
        assert np.abs(found - exact).max() <= 1e-8 * np.abs(exact).max()


def test_driven_response_is_linear_between_samples() -> None:
    """As scipy's lsim."""
    plants, _, _ = made("ATTAS", 3)
    rng = np.random.default_rng(3)
    surfaces, start = rng.normal(size=(3, 60, 2)).cumsum(axis=1), rng.normal(size=(3, 3))
    found = driven_response(plants, surfaces, DT, start)
    for k in range(3):
        system = StateSpace(plants.a[k], plants.b[k], plants.c[k, :4], plants.d[k, :4])
        _, exact, _ = lsim(system, surfaces[k], DT * np.arange(60), start[k])
        np.testing.assert_allclose(found[k], exact, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("name", TESTS)
def test_white_residuals_have_the_likelihood_of_a_dense_covariance(name: str) -> None:
    """Sum of squares and determinant of a record of 150 samples."""
    n_samples = 150
    plants, law, motion = made(name, 2)
    model = joint_model(plants, law, motion, DT)
    filters = gains(model, NOISE[np.newaxis], n_samples)
    y = 0.01 * np.random.default_rng(4).normal(size=(2, n_samples, N_CHANNELS))
    k = model.f.shape[1]
    white = white_residuals(
        model.f[:, np.newaxis],
        model.h[:, np.newaxis],
        filters,
        y[:, np.newaxis],
        np.zeros((2, 1, k)),
        np.ones(N_CHANNELS, bool),
    )
    for i in range(2):
        covariance = dense(model.f[i], model.q[i], model.h[i], model.start[i], n_samples)
        covariance = covariance + np.asarray(block_diag(*[np.diag(NOISE**2)] * n_samples))
        flat = y[i].ravel()
        squares = flat @ np.linalg.solve(covariance, flat)
        assert np.square(white[i]).sum() == pytest.approx(squares, rel=1e-5)
        logs = np.log(np.diagonal(filters.root[i], axis1=1, axis2=2)).sum(axis=1)
        log_root = sum(logs) + (n_samples - len(logs)) * logs[-1]
        assert log_root == pytest.approx(-0.5 * np.linalg.slogdet(covariance)[1], abs=1e-3)
    settled = gains(model, NOISE[np.newaxis], 2_000).gain.shape[1]
    assert settled < 1_000, "they settle, and are kept"


def dense(f: Array, q: Array, h: Array, start: Array, n_samples: int) -> Array:
    """Covariance of all measured samples."""
    of_state = [start]
    for _ in range(n_samples - 1):
        of_state.append(f @ of_state[-1] @ f.T + q)
    blocks = np.zeros((n_samples, N_CHANNELS, n_samples, N_CHANNELS))
    for row in range(n_samples):
        across = of_state[row]
        for column in range(row, n_samples):
            blocks[row, :, column] = h @ across @ h.T
            blocks[column, :, row] = blocks[row, :, column].T
            across = across @ f.T
    return blocks.reshape(n_samples * N_CHANNELS, -1)


def test_joint_flow_without_pilot_is_the_closed_loop() -> None:
    """It has the poles of aircraft, law and actuators."""
    plants, law, motion = made("F-16", 1)
    flow, _ = joint_flow(plants, law, motion)
    (loop,), _ = closed_loops(plants, law.controller, law.actuator)
    n = len(loop)
    poles, found = (np.sort_complex(np.linalg.eigvals(x)) for x in (loop, flow[0, :n, :n]))
    np.testing.assert_allclose(found, poles, atol=1e-9)


def test_law_part_is_the_response_of_the_law() -> None:
    """A rollout's surfaces minus the law's part are the pilot's: none on the aileron."""
    simulator = LateralSimulator(TESTS["F-16"])
    rollouts, _ = simulator.fly(
        simulator.plant.sample(3, np.random.default_rng(5)), np.random.default_rng(6)
    )
    law = Law(simulator.controller, TESTS["F-16"].control_law.actuator)
    clean = rollouts.y.copy()
    part = law_part(law, clean, DT)
    aileron = clean[..., 4] - part[..., 0]
    assert np.abs(clean[..., 4]).max() > 0.02
    assert aileron.std() < 1.15 * NOISE[4], "what is left is the transducer's noise"


def test_motion_is_estimated_from_its_spectrum() -> None:
    """Resting surfaces have size 0; moving ones have their size."""
    t = DT * np.arange(400)
    rng = np.random.default_rng(7)
    moved = 0.1 * np.sin(2 * np.pi * 0.5 * t)
    surfaces = np.stack([np.zeros(400), moved], axis=1)[np.newaxis] + NOISE[4:] * rng.normal(
        size=(1, 400, 2)
    )
    motion = SurfaceMotion.likeliest(surfaces, NOISE[4:], DT)
    assert motion.size[0, 0] <= 0.3 * NOISE[4]
    assert 0.03 <= motion.size[0, 1] <= 0.3
