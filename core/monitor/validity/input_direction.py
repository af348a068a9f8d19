"""The direction in which an input begins: a card that is flown the other way is another card."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from core.channels import CHANNELS
from core.types import Array, Flags, Indices

BEGUN = 0.5
"""Share of the usual peak from which on a surface has begun to move as the manoeuvre wants it."""
FEWEST = 500
"""Fresh flights of which none began so: with fewer, one like them might."""


class WrongInput(NamedTuple):
    """An input that begins as none of training did.

    sample, t: number and time [s] of the sample that shows it.   channel: its key.
    p_value: conformal, of all surfaces and both ways by Bonferroni's rule.   words: the reason.
    """

    sample: int
    t: float
    channel: str
    p_value: float
    words: str


@dataclass(frozen=True, eq=False)
class InputDirection:
    """Which way surfaces began to move in fresh flights.

    surfaces: (k,) numbers of channels.   begun: (k,) magnitude that tells [rad].
    flights: (k, 2) fresh flights whose first sample of that magnitude is negative, positive.

    Of flights drawn like them at most 1 in n + 1 begins in a way that none of these n did.
    """

    surfaces: Indices
    begun: Array
    flights: Indices

    def check(self) -> None:
        """Refuse arrays that do not fit together; ValueError."""
        k = len(self.surfaces)
        if self.begun.dtype != np.float64 or self.begun.shape != (k,):
            raise ValueError(f"input begun is {self.begun.dtype} {self.begun.shape}")
        if not (np.isfinite(self.begun).all() and (self.begun > 0).all()):
            raise ValueError("input begun holds what is no deflection")
        if self.flights.dtype != np.int64 or self.flights.shape != (k, 2):
            raise ValueError(f"input flights is {self.flights.dtype} {self.flights.shape}")
        if (self.flights < 0).any():
            raise ValueError("input flights holds what is no count")

    def first_wrong(self, t: Array, y: Array, counts: Flags) -> WrongInput | None:
        """The first sample by which a surface began to move as in none of the fresh flights.

        t: (n,) [s].   y: (n, 6) from trim.   counts: (n,) samples that are looked at.
        """
        running = RunningDirection(self)
        moved = (np.abs(y[:, self.surfaces]) >= self.begun).any(axis=1) & counts
        for sample in np.flatnonzero(moved).tolist():
            if wrong := running.update(sample, float(t[sample]), y[sample]):
                return wrong
            if running.is_over:
                break
        return None

    def first_wrong_of(self, y: Array) -> Indices:
        """(n,) that sample of each trajectory y (n, n_samples, 6); n_samples for none."""
        first, value = _first_beyond(y[..., self.surfaces], self.begun)
        wrong = self._untaken[np.arange(len(self.surfaces)), (value > 0).astype(int)]
        return np.where(wrong, first, y.shape[1]).min(axis=1, initial=y.shape[1])

    @cached_property
    def _untaken(self) -> Flags:
        """(k, 2) sides, negative and positive, to which none of enough fresh flights began."""
        return (self.flights == 0) & (self.flights.sum(axis=1, keepdims=True) >= FEWEST)

    def wrong(self, sample: int, t: float, k: int, value: float) -> WrongInput | None:
        """What is wrong with a surface k that begins with this value [rad]; None where nothing."""
        if not self._untaken[k, int(value > 0)]:
            return None
        n, channel = int(self.flights[k].sum()), CHANNELS[self.surfaces[k]]
        way, other = ("positive", "negative") if value > 0 else ("negative", "positive")
        return WrongInput(
            sample,
            t,
            channel.key,
            self.flights.size / (n + 1),
            f"{channel.label} began to the {way} side at {t:.2f} s, in all {n:,} fresh flights "
            f"to the {other} one: the input is not the planned one",
        )


class RunningDirection:
    """The same of a flight under way, sample by sample."""

    def __init__(self, direction: InputDirection) -> None:
        self._direction = direction
        self._waiting = list(
            zip(
                range(len(direction.surfaces)),
                direction.surfaces.tolist(),
                direction.begun.tolist(),
                strict=True,
            )
        )

    @property
    def is_over(self) -> bool:
        """Whether every surface has begun to move."""
        return not self._waiting

    def update(self, sample: int, t: float, y: Array) -> WrongInput | None:
        """Take a sample y (6,) that counts; what is wrong with it, if anything is."""
        for k, channel, begun in self._waiting:
            if abs(y[channel]) >= begun:
                self._waiting = [other for other in self._waiting if other[0] != k]
                if wrong := self._direction.wrong(sample, t, k, float(y[channel])):
                    return wrong
        return None


def begins(y: Array, last: Indices, surfaces: Sequence[int], begun: Array) -> Indices:
    """(k, 2) flights whose first sample beyond `begun`, of 0..last, is negative, positive.

    y: (n, n_samples, 6) from trim.   last: (n,).
    """
    _, first = _first_beyond(deflections(y, last, surfaces), begun)
    return np.column_stack([(first < 0).sum(axis=0), (first > 0).sum(axis=0)])


def deflections(y: Array, last: Indices, surfaces: Sequence[int] | Indices) -> Array:
    """(n, n_samples, k) surfaces over samples 0..last; 0 after, and where it is not known.

    y: (n, n_samples, 6) from trim.   last: (n,).
    """
    counts = np.arange(y.shape[1])[np.newaxis, :, np.newaxis] <= last[:, np.newaxis, np.newaxis]
    return np.where(counts, np.nan_to_num(y[..., list(surfaces)]), 0.0)


def _first_beyond(deflection: Array, begun: Array) -> tuple[Indices, Array]:
    """First sample of `begun` or more, n_samples for none, and its deflection, 0 for none: (n, k).

    deflection: (n, n_samples, k).   begun: (k,).
    """
    moved = np.abs(deflection) >= begun
    at = moved.argmax(axis=1)
    value = np.take_along_axis(deflection, at[:, np.newaxis], axis=1)[:, 0]
    any_moved = moved.any(axis=1)
    return np.where(any_moved, at, deflection.shape[1]), np.where(any_moved, value, 0.0)
