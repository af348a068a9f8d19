"""Labelled trajectories to train a monitor on, simulated or flown."""

import hashlib
import json
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from core.limits.limits import Specification
from core.types import Array, Indices


@dataclass(frozen=True, eq=False)
class Dataset:
    """Unsafe and safe rollouts of one manoeuvre on aircraft drawn from D_theta.

    unsafe: (n_unsafe, n_samples, 6) measured outputs y, NaN after the failure sample.
    fail_index: (n_unsafe,) first sample that exceeds a limit.
    safe: (n_safe, n_samples, 6).
    safe_times: (n_safe, n_obs) sampled observation indices of each safe rollout, ascending.
    theta_unsafe, theta_safe: (n, n_parameters) parameters, named by `theta_names`.
    dt: sample interval [s].
    n_safe_met: safe rollouts before the last unsafe one, stored or not.
    specification: the limits that the unsafe ones exceed; None where unknown.
    recipe: of the simulation, as plain data; empty for flown trajectories.
    """

    unsafe: Array
    fail_index: Indices
    safe: Array
    safe_times: Indices
    theta_unsafe: Array
    theta_safe: Array
    dt: float
    theta_names: tuple[str, ...] = ()
    n_safe_met: int = 0
    seed: int | None = None
    recipe: dict[str, Any] = field(default_factory=dict)
    specification: Specification = None

    @property
    def unsafe_rate(self) -> float:
        """Unbiased share of unsafe rollouts; collection stopped at the last unsafe one."""
        n_unsafe = len(self.unsafe)
        return (n_unsafe - 1) / (n_unsafe + self.n_safe_met - 1)

    def digest(self) -> str:
        """SHA-256, in hexadecimal, of everything a monitor can learn from this dataset."""
        return self._digest

    @cached_property
    def _digest(self) -> str:
        sha = hashlib.sha256(json.dumps([self.dt, self.theta_names]).encode())
        for array in (self.unsafe, self.fail_index, self.safe, self.safe_times):
            sha.update(repr(array.shape).encode())
            sha.update(np.ascontiguousarray(array).data)
        return sha.hexdigest()
