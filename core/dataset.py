"""Labelled trajectories to train a monitor on, simulated or flown."""

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from core.channels import LATERAL, Dictionary
from core.limits.limits import Specification
from core.rollouts import FlownManoeuvre, LabelledFlights
from core.seeds import Branch, stream
from core.types import Array, Indices

FLOWN = "flown"
"""Key of a recipe: the flown flights among the rollouts."""


@dataclass(frozen=True, eq=False)
class Dataset:
    """Unsafe and safe rollouts of one manoeuvre on aircraft drawn from D_theta.

    unsafe: (n_unsafe, n_samples, n_channels) measured outputs y, NaN after the failure sample.
    fail_index: (n_unsafe,) first sample that exceeds a limit.
    safe: (n_safe, n_samples, n_channels).
    safe_times: (n_safe, n_obs) sampled observation indices of each safe rollout, ascending.
    theta_unsafe, theta_safe: (n, n_parameters) parameters, named by `theta_names`.
    dt: sample interval [s].
    n_safe_met: safe rollouts before the last unsafe one, stored or not.
    specification: the limits that the unsafe ones exceed; None where unknown.
    recipe: of the simulation, as plain data; empty for other trajectories. `flown` lists the flown
    ones: the number of each rollout, unsafe ones first, and its FlownManoeuvre.
    dictionary: of the channels.
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
    dictionary: Dictionary = LATERAL

    @classmethod
    def from_rollouts(
        cls, y: npt.ArrayLike, *, n_obs: int = 50, seed: int = 0, **labelled: Any
    ) -> "Dataset":
        """Dataset of flights of any simulator, or of flown ones.

        y, labelled: see `LabelledFlights.of`: dt, channels, fail_index, limits, theta, theta_names.
        n_obs: observation times kept of each safe flight.   RolloutsError.
        """
        return cls.from_flights(LabelledFlights.of(y, **labelled), n_obs, seed)

    @classmethod
    def from_flights(cls, flights: LabelledFlights, n_obs: int = 50, seed: int = 0) -> "Dataset":
        fails, rng = flights.fails, stream(seed, Branch.SAFE_TIMES)
        safe, n_samples = flights.y[~fails], flights.y.shape[1]
        order = rng.random((len(safe), n_samples)).argsort(axis=1)
        flown = flights.some(np.argsort(~fails, kind="stable")).flown
        numbered = [{"rollout": k} | asdict(each) for k, each in enumerate(flown) if each]
        return cls(
            unsafe=flights.y[fails],
            fail_index=flights.fail_index[fails],
            safe=safe,
            safe_times=np.sort(order[:, :n_obs], axis=1),
            theta_unsafe=flights.theta[fails],
            theta_safe=flights.theta[~fails],
            dt=flights.dt,
            theta_names=flights.theta_names,
            n_safe_met=len(safe),
            recipe={FLOWN: numbered} if numbered else {},
            specification=flights.specification,
            dictionary=flights.dictionary,
        )

    def flights(self) -> LabelledFlights:
        """All rollouts, failing ones first, to be split by flight."""
        n_safe, n_samples = len(self.safe), self.safe.shape[1]
        flown: list[FlownManoeuvre | None] = [None] * (len(self.unsafe) + n_safe)
        for each in self.recipe.get(FLOWN, ()):
            about = {key: value for key, value in each.items() if key != "rollout"}
            flown[each["rollout"]] = FlownManoeuvre(**about)
        return LabelledFlights(
            np.concatenate([self.unsafe, self.safe]),
            np.concatenate([self.fail_index, np.full(n_safe, n_samples)]),
            np.concatenate([self.theta_unsafe, self.theta_safe]),
            self.dt,
            self.dictionary,
            self.specification,
            self.theta_names,
            flown=tuple(flown) if FLOWN in self.recipe else (),
        )

    def without_theta(self) -> "Dataset":
        unsafe, safe = (np.empty((len(y), 0)) for y in (self.unsafe, self.safe))
        return replace(self, theta_names=(), theta_unsafe=unsafe, theta_safe=safe)

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
        named: list[Any] = [self.dt, self.theta_names]
        if self.dictionary != LATERAL:
            named.append(self.dictionary.to_plain())
        sha = hashlib.sha256(json.dumps(named).encode())
        for array in (self.unsafe, self.fail_index, self.safe, self.safe_times):
            sha.update(repr(array.shape).encode())
            sha.update(np.ascontiguousarray(array).data)
        return sha.hexdigest()
