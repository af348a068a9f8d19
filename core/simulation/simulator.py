"""The protocol of simulators: they roll out one test on random aircraft.

What more a simulator can do decides which studies of a monitor exist.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np

from core.channels import Dictionary
from core.types import Array, Flags, Indices

Distribution = Literal["normal", "uniform"]
Stopped = Callable[[Indices, Indices], Indices]
"""Repeats flights with the manoeuvre stopped: from (m,) numbers of flights and (m,) samples from
which controls are neutral, to (m,) first samples that exceed a limit, n_samples for none."""


class Parameters(NamedTuple):
    """Uncertain parameters theta of the aircraft.

    nominal, spread: (n_parameters,) in the unit of each; the spread is a standard deviation of a
    normal distribution, or the half width of a uniform one.
    """

    names: tuple[str, ...]
    nominal: Array
    spread: Array
    distribution: Distribution = "normal"

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """Draw theta (n, n_parameters); certain parameters use no random numbers."""
        uncertain = np.flatnonzero(self.spread)
        shape = (n, len(uncertain))
        normal = self.distribution == "normal"
        deviation = rng.standard_normal(shape) if normal else rng.uniform(-1.0, 1.0, shape)
        deviation *= self.spread[uncertain]
        theta = np.repeat(self.nominal[np.newaxis], n, axis=0)
        theta[:, uncertain] += deviation
        return theta


class Rollouts(NamedTuple):
    """Labelled trajectories of one manoeuvre.

    y: (n, n_samples, n_channels) measured outputs.   fail_index: (n,) first sample that exceeds a
    limit, n_samples for a safe rollout.   theta: (n, n_parameters).
    """

    y: Array
    fail_index: Indices
    theta: Array

    @property
    def is_unsafe(self) -> Flags:
        """(n,) whether the rollout exceeds a limit."""
        return self.fail_index < self.y.shape[1]

    def some(self, which: slice | Flags | Indices) -> "Rollouts":
        return Rollouts(self.y[which], self.fail_index[which], self.theta[which])


class Simulator(Protocol):
    """Rolls out a test on random aircraft, sampled every dt [s]: a monitor needs no more."""

    @property
    def dictionary(self) -> Dictionary: ...

    @property
    def parameters(self) -> Parameters: ...

    @property
    def dt(self) -> float: ...

    def rollouts(self, n: int, rng: np.random.Generator) -> Rollouts: ...


@runtime_checkable
class Flies(Protocol):
    """Also flies given aircraft, so that others than the planned ones can test a monitor."""

    def fly(self, theta: Array, rng: np.random.Generator) -> tuple[Rollouts, Array]:
        """Fly theta (n, n_parameters). Returns the rollouts and (n,) the largest margin of each."""
        ...


@runtime_checkable
class Stops(Protocol):
    """Also stops a manoeuvre on the way, so that prevented failures can be counted."""

    def stopping(self, n: int, rng: np.random.Generator) -> Stopped:
        """Draw the n flights that `rollouts` draws from rng, to fly some of them again."""
        ...
