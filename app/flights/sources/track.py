"""A source that is known from start to end."""

from dataclasses import dataclass, field

import numpy as np

from core.channels import N_CHANNELS
from core.simulation.attitude import attitude
from core.types import Array


class SourceError(ValueError):
    """A source that cannot be flown, or not with this monitor."""


@dataclass(frozen=True, eq=False)
class Track:
    """A source known from start to end.

    t: (n,) rising [s].   y: (n, 6), NaN where unknown.   dt: sample interval [s].
    attitude: (n, 3) phi, theta, psi [rad]; integrated from the rates for display unless given.
    theta: parameters of a simulated aircraft.   fail_index: first sample past a limit, if known.
    """

    t: Array
    y: Array
    dt: float
    attitude: Array = field(default_factory=lambda: np.empty((0, 3)))
    theta: dict[str, float] | None = None
    fail_index: int | None = None

    def __post_init__(self) -> None:
        n = len(self.t)
        if not n or self.y.shape != (n, N_CHANNELS):
            raise SourceError(
                f"the source has {n} times and samples of shape {self.y.shape}: it needs one row "
                f"of {N_CHANNELS} channels per time, and at least one"
            )
        if not (np.isfinite(self.t).all() and (np.diff(self.t) > 0).all()):
            raise SourceError("the source's times do not always increase: sort or resample it")
        if len(self.attitude) != n:
            object.__setattr__(self, "attitude", attitude(self.t, self.y))

    @property
    def duration(self) -> float:
        return float(self.t[-1] - self.t[0])


def times(n: int, dt: float) -> Array:
    """Times of n samples from 0 on [s], equal to the bit to those of batch scores."""
    return (np.arange(n) * dt).astype(np.float64)
