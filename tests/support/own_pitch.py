"""The pitch doublets of `short_period` as simulators: an object, and a plain function."""

from typing import Any

import numpy as np

from core.planned_test.own import OwnSimulator, OwnTest
from core.simulation.python_simulator import simulator
from core.types import Array
from tests.support import short_period
from tests.support.short_period import DICTIONARY, DT, LIMITS, N_SAMPLES

PARAMETERS = {"stiffness": (6.0, 1.1), "gain": (1.0, 0.18)}


class Pitch:
    """The least that a simulator has."""

    dictionary, dt = DICTIONARY, DT
    parameters = PARAMETERS

    def rollouts(self, n: int, rng: np.random.Generator) -> tuple[Array, None, Array]:
        theta, y = short_period.fly(rng, n)
        return y, None, theta


def doublet(rng: np.random.Generator) -> Array:
    t = DT * np.arange(N_SAMPLES) - rng.normal(0.5, 0.1)
    return np.where(t < 0, 0.0, np.where(t < 0.8, -0.06, 0.06 * (t < 1.6)))


def fly(theta: dict[str, float], inputs: Array, t: Array) -> list[list[float]]:
    alpha, q, surface, rows = 0.05, 0.0, 0.0, []
    for command in (theta["gain"] * inputs[:, 0]).tolist():
        rows.append([alpha, q, 1.0 + 20.0 * (alpha - 0.05), surface - 0.02])
        for _ in range(5):
            surface += 0.2 * (command - surface)
            alpha += 0.01 * (q - 0.9 * (alpha - 0.05))
            q += 0.01 * (-theta["stiffness"] * (alpha - 0.05) - 1.2 * q - 9.0 * surface)
    return rows


NOISE = {"alpha": 1e-3, "q": 2e-3, "Nz": 0.01, "delta_e": 5e-4}
declared = simulator(channels=DICTIONARY, dt=DT, parameters=PARAMETERS, inputs=doublet, noise=NOISE)
pitch, thing = declared(fly), Pitch()


def small_test(own: object, limits: object = LIMITS, **sizes: Any) -> OwnTest:
    """A small test of a simulator, judged by limits."""
    made = OwnSimulator.of(own, "own_pitch:it").judged(DICTIONARY, limits, 0)  # pyright: ignore
    usual: dict[str, Any] = {"n_unsafe": 20, "max_rollouts": 2_000}
    return OwnTest(made, **usual | sizes)
