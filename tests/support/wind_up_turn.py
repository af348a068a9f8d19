"""A cheap wind-up turn for tests: pulled tighter and tighter, with the speed lost to drag.

It knows nothing of `core.simulation`. About a third of the flights exceed the angle of attack.
"""

from typing import NamedTuple

import numpy as np

from core.channels import Dictionary, channel
from core.limits.limits import IntervalLimits, SafeInterval
from core.types import Array

DT, N_SAMPLES = 0.1, 121
G = 9.81
DICTIONARY = Dictionary(
    "turn",
    (
        channel("alpha", "α", "rad", "angle of attack", "output", "absolute"),
        channel("q", "q", "rad/s", "pitch rate"),
        channel("phi", "φ", "rad", "bank angle", "output", "absolute"),
        channel("Nz", "N_z", "g", "normal acceleration", "output", "absolute"),
        channel("V", "V", "m/s", "airspeed", "output", "absolute"),
        channel("delta_e", "δ_e", "rad", "elevator", "control", "absolute"),
    ),
)
LIMITS = IntervalLimits(DICTIONARY, {"alpha": SafeInterval(high=0.27, rest=0.06)})
NOISE = np.array([1e-3, 2e-3, 5e-3, 0.01, 0.3, 5e-4])


class Aircraft(NamedTuple):
    """Nominal values. lift: [g/rad] at V0.   stiffness, damping, elevator: of the pitch."""

    lift: float = 17.0
    stiffness: float = 5.0
    damping: float = 2.0
    elevator: float = 12.0
    drag: float = 0.035
    V0: float = 160.0


TRAINED = Aircraft()
OTHER = Aircraft(lift=24.0, stiffness=14.0, damping=2.0, elevator=12.0)
"""Another type: stiffer, and with more lift."""


def fly(rng: np.random.Generator, n: int, aircraft: Aircraft = TRAINED) -> tuple[Array, Array]:
    """theta (n, 3) and y (n, 121, 6): straight for about a second, then the turn.

    theta: shares of the nominal lift, stiffness and drag.
    """
    theta = rng.normal(1.0, 0.12, (n, 3))
    lift = aircraft.lift * theta[:, 0]
    stiffness, drag = aircraft.stiffness * theta[:, 1], aircraft.drag * theta[:, 2]
    begin, pull = 1.0 + 0.1 * rng.standard_normal(n), rng.normal(0.34, 0.04, n)
    V, q, phi, surface = np.full(n, aircraft.V0), np.zeros(n), np.zeros(n), np.zeros(n)
    level = alpha = 1.0 / lift
    y = np.empty((n, N_SAMPLES, len(DICTIONARY)))
    for k in range(N_SAMPLES):
        since = np.maximum(k * DT - begin, 0.0)
        N_z = lift * (V / aircraft.V0) ** 2 * alpha
        y[:, k] = np.column_stack([alpha, q, phi, N_z, V, surface])
        asked = 1.0 + pull * since
        for _ in range(10):
            h = DT / 10
            N_z = lift * (V / aircraft.V0) ** 2 * alpha
            surface = surface + h * 0.06 * (asked - N_z - 4.0 * q)
            phi = phi + h * 2.0 * (np.arccos(1.0 / np.maximum(asked, 1.0)) - phi)
            q_dot = aircraft.elevator * surface - stiffness * (alpha - level) - aircraft.damping * q
            alpha = alpha + h * (q - (G / V) * (N_z - 1.0))
            q = q + h * q_dot
            V = V - h * G * drag * (N_z**2 - 1.0)
    return theta, y + rng.standard_normal(y.shape) * NOISE
