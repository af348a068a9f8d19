"""Attitude for display, from rates if it was not measured, with bounded drift.

phi_dot = p + tan(theta0) r - phi / WASH_OUT_S,   psi_dot = r / cos(theta0),   theta = theta0

The kinematics of the linear model about wings-level trim (see core.simulation.aircraft), plus a
slow return to wings level: a rate bias b leads to a bank of b WASH_OUT_S, not to a continuous roll.
Only for drawing the aircraft: no monitor or limit may use these angles.
"""

from dataclasses import dataclass
from math import cos, exp, isfinite, pi, tan
from typing import NamedTuple

import numpy as np

from core.channels import KEYS, LATERAL, Dictionary
from core.simulation.uncertain_plant import UncertainPlant
from core.types import Array

P, R = KEYS.index("p"), KEYS.index("r")
WASH_OUT_S = 60.0
"""Time constant of the return to wings level [s]; a 6 s doublet loses a tenth of its bank."""
LONGEST_GAP_S = 0.5
"""Across a longer gap the attitude is held instead of integrated [s]."""


class Attitude(NamedTuple):
    """Bank, pitch and heading [rad]; bank and heading in (-pi, pi]."""

    phi: float
    theta: float
    psi: float


@dataclass
class DisplayAttitude:
    """Integrates sample by sample with the trapezoidal rule; starts and restarts at trim.

    theta0: pitch at trim [rad]. ValueError beyond the vertical.
    A step back in time starts a new run. Gaps and samples without finite rates hold the attitude.
    """

    theta0: float = 0.0

    def __post_init__(self) -> None:
        if not abs(self.theta0) < pi / 2:
            raise ValueError(f"theta0 is {self.theta0} rad; pitch at trim lies within 90 degrees")
        self._climb, self._turn = tan(self.theta0), 1.0 / cos(self.theta0)
        self.restart()

    def restart(self) -> None:
        """Return to trim: the next sample is the first of a new run."""
        self._phi = self._psi = 0.0
        self._last: tuple[float, float, float] | None = None

    def update(self, t: float, p: float, r: float) -> Attitude:
        """Attitude at a sample: time [s], roll and yaw rate [rad/s]."""
        if self._last is not None and t < self._last[0]:
            self.restart()
        if isfinite(p) and isfinite(r):
            phi_dot, psi_dot = p + self._climb * r, self._turn * r
            if self._last is not None:
                then, phi_dot_then, psi_dot_then = self._last
                dt = t - then
                if dt <= LONGEST_GAP_S:
                    fade = exp(-dt / WASH_OUT_S)
                    self._phi = wrapped(
                        fade * (self._phi + 0.5 * dt * phi_dot_then) + 0.5 * dt * phi_dot
                    )
                    self._psi = wrapped(self._psi + 0.5 * dt * (psi_dot_then + psi_dot))
            self._last = t, phi_dot, psi_dot
        return Attitude(self._phi, self.theta0, self._psi)


def attitude(t: Array, y: Array, theta0: float = 0.0) -> Array:
    """Attitude (n, 3) of a whole trajectory: phi, theta, psi [rad], by DisplayAttitude.

    t: (n,) [s].   y: (n, 6) in the order of core.channels.
    """
    display = DisplayAttitude(theta0)
    rows = zip(t.tolist(), y[:, P].tolist(), y[:, R].tolist(), strict=True)
    return np.array([display.update(*row) for row in rows]).reshape(-1, 3)


def attitude_of(dictionary: Dictionary, t: Array, y: Array, theta0: float = 0.0) -> Array:
    """Attitude (n, 3) [rad]: integrated from lateral rates; else from channels, NaN if unknown.

    t: (n,) [s].   y: (n, n_channels).
    """
    if dictionary == LATERAL:
        return attitude(t, y, theta0)
    angles = np.full((len(t), 3), np.nan)
    for column, key in enumerate(Attitude._fields):
        if key in dictionary.keys:
            angles[:, column] = y[:, dictionary.index(key)]
    return angles


class SurfaceSigns(NamedTuple):
    """Response to a positive deflection: +1 rolls or yaws right, -1 left."""

    aileron: int
    rudder: int


def surface_signs(plant: UncertainPlant) -> SurfaceSigns:
    """Signs of nominal dp_dot/d(delta_a) and dr_dot/d(delta_r); published models differ."""
    nominal = plant.nominal_plant()
    effect = nominal.c[0] @ nominal.b[0]
    return SurfaceSigns(_sign(effect[P, 0]), _sign(effect[R, 1]))


def _sign(number: float) -> int:
    return -1 if number < 0.0 else 1


def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return pi - (pi - angle) % (2.0 * pi)
