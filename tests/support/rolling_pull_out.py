"""A cheap rolling pull-out for tests: the wing's load, which nobody measures, is limited.

A pull on a short period, then a roll. About a quarter of the flights exceed LIMIT.
"""

import numpy as np

from core.channels import Dictionary, channel
from core.types import Array, Indices

DT, N_SAMPLES = 0.05, 81
DICTIONARY = Dictionary(
    "rolling pull-out",
    (
        channel("alpha", "α", "rad", "angle of attack", "output", "absolute"),
        channel("q", "q", "rad/s", "pitch rate"),
        channel("Nz", "N_z", "g", "normal acceleration", "output", "absolute"),
        channel("p", "p", "rad/s", "roll rate"),
        channel("delta_e", "δ_e", "rad", "elevator", "control", "absolute"),
        channel("delta_a", "δ_a", "rad", "aileron", "control", "absolute"),
    ),
)
LOAD = "load [kN*m] = 40*Nz + 30*abs(p)"
LIMIT = 172.0
NOISE = np.array([1e-3, 2e-3, 0.01, 5e-3, 5e-4, 5e-4])


def fly(rng: np.random.Generator, n: int) -> tuple[Array, Array, Indices]:
    """theta (n, 3), y (n, 81, 6), and the first sample over the limit, -1 for none.

    theta: shares of the nominal stiffness, roll damping, and of the inputs.   The label comes from
    the true load, the channels carry noise.
    """
    theta = rng.normal(1.0, 0.15, (n, 3))
    stiffness, damping, size = 6.0 * theta[:, 0], 2.5 * theta[:, 1], theta[:, 2]
    pull, roll = 0.5 + 0.1 * rng.standard_normal(n), 1.1 + 0.1 * rng.standard_normal(n)
    alpha, q, p = np.full(n, 0.05), np.zeros(n), np.zeros(n)
    elevator, aileron = np.zeros(n), np.zeros(n)
    y = np.empty((n, N_SAMPLES, 6))
    for k in range(N_SAMPLES):
        t, h = k * DT, DT / 5
        columns = [alpha, q, 1.0 + 20.0 * (alpha - 0.05), p, elevator - 0.02, aileron]
        y[:, k] = np.column_stack(columns)
        pulled = -0.07 * size * ((t >= pull) & (t < pull + 1.6))
        rolled = 0.12 * size * ((t >= roll) & (t < roll + 1.0))
        for _ in range(5):
            elevator = elevator + h * 20.0 * (pulled - elevator)
            aileron = aileron + h * 20.0 * (rolled - aileron)
            alpha = alpha + h * (q - 0.9 * (alpha - 0.05) - 0.02 * p * p)
            q = q + h * (-stiffness * (alpha - 0.05) - 1.2 * q - 9.0 * elevator)
            p = p + h * (-damping * p + 25.0 * aileron)
    over = 40.0 * y[..., 2] + 30.0 * np.abs(y[..., 3]) >= LIMIT
    fail_index = np.where(over.any(axis=1), over.argmax(axis=1), -1)
    return theta, y + NOISE * rng.standard_normal(y.shape), fail_index
