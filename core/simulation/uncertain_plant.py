"""A plant with an uncertain parameter vector theta: D_theta, and (A, B, C, D) for each theta.

x_dot = A x + B u,  y = C x + D u,  u = (delta_a, delta_r) [rad], y in the order of core.channels.
"""

from dataclasses import dataclass, field
from math import isfinite
from typing import Literal, NamedTuple

import numpy as np

from core.bounds import check_bounds
from core.simulation.simulator import Distribution, Parameters
from core.types import Array

Unit = Literal["fraction", "absolute"]


class Plants(NamedTuple):
    """A batch of plants, C-contiguous: a (n, nx, nx), b (n, nx, 2), c (n, 6, nx), d (n, 6, 2)."""

    a: Array
    b: Array
    c: Array
    d: Array


class Effect(NamedTuple):
    """Parameter `parameter` adds `gain * theta` to entry [row, column] of one of the matrices."""

    matrix: int
    row: int
    column: int
    parameter: int
    gain: float


@dataclass(frozen=True)
class Uncertainty:
    """Scatter of each parameter about its nominal value, independent of the others.

    Raises ValueError for a spread that is negative or not finite, or an unknown word.
    """

    spread: float | dict[str, float] = field(hash=False)
    """width of the uncertainty: one number for all parameters, or by name; parameters not named are
    certain. A standard deviation for a normal distribution (not truncated), a half width for a
    uniform one."""
    distribution: Distribution = "normal"
    """shape of the uncertainty: normal, its width a standard deviation, or uniform, a half
    width."""
    unit: Unit = "fraction"
    """unit of the width: a fraction of the nominal value, or absolute in the parameter's own
    unit."""

    def __post_init__(self) -> None:
        check_bounds(self)
        numbers = self.spread if isinstance(self.spread, dict) else {"every parameter": self.spread}
        for name, number in numbers.items():
            if not (isinstance(number, int | float) and isfinite(number) and number >= 0):
                raise ValueError(
                    f"the spread of {name} is {number!r}; give a finite number, zero or more"
                )

    def absolute(self, names: tuple[str, ...], nominal: Array) -> Array:
        """Spread of each named parameter in its own unit, (n_params,); ValueError: unknown name."""
        by_name = (
            self.spread if isinstance(self.spread, dict) else dict.fromkeys(names, self.spread)
        )
        if unknown := [name for name in by_name if name not in names]:
            raise ValueError(
                f"the uncertainty names {', '.join(unknown)}; this aircraft's parameters are "
                f"{', '.join(names)}"
            )
        spread = np.array([by_name.get(name, 0.0) for name in names], dtype=np.float64)
        return spread * np.abs(nominal) if self.unit == "fraction" else spread


@dataclass(frozen=True, eq=False)
class UncertainPlant:
    """A parameter vector theta, its distribution, and the linear map from theta to the plant.

    states: names of x.   names, nominal, spread: (n_params,); spread in the parameter's own unit.
    fixed: a batch of one, the part of the plant without theta (kinematics, the surfaces' rows).
    effects: entries that depend on theta; an entry may depend on several parameters.
    joint_root: (n_params, m) map from m standard normal deviates to theta, for dependent
    parameters with covariance joint_root joint_root'. None for independent ones.
    """

    states: tuple[str, ...]
    names: tuple[str, ...]
    nominal: Array
    spread: Array
    distribution: Distribution
    fixed: Plants
    effects: tuple[Effect, ...]
    joint_root: Array | None = None

    @property
    def parameters(self) -> Parameters:
        return Parameters(self.names, self.nominal, self.spread, self.distribution)

    @property
    def root(self) -> Array:
        """(n_params, m) map from m deviates of variance 1 to theta."""
        if self.joint_root is not None:
            return self.joint_root
        deviation = self.spread if self.distribution == "normal" else 3**-0.5 * self.spread
        return np.diag(deviation)[:, np.flatnonzero(self.spread)]

    def theta_of(self, deviates: Array) -> Array:
        """Theta (n, n_params) of deviates (n, m)."""
        return self.nominal + deviates @ self.root.T

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """Draw theta (n, n_params); certain parameters use no random numbers."""
        if self.joint_root is not None:
            return self.theta_of(rng.standard_normal((n, self.joint_root.shape[1])))
        return self.parameters.sample(n, rng)

    def plants(self, theta: Array) -> Plants:
        """The plants of theta (n, n_params), in fresh arrays."""
        if theta.ndim != 2 or theta.shape[1] != len(self.names):
            raise ValueError(
                f"theta has shape {theta.shape}; this aircraft needs (n, {len(self.names)})"
            )
        plants = Plants(*(np.repeat(matrix, len(theta), axis=0) for matrix in self.fixed))
        for effect in self.effects:
            entry = plants[effect.matrix][:, effect.row, effect.column]
            entry += effect.gain * theta[:, effect.parameter]
        return plants

    def nominal_plant(self) -> Plants:
        """The plant of the nominal parameters, a batch of one."""
        return self.plants(self.nominal[np.newaxis])
