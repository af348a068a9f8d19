"""The shape of an input: its first direction, the duration of its holds and its sharpness.

A hold is a deflection of at least half the usual peak to one side without a break. An input that
begins to the other side than fresh flights do, or whose hold lasts longer than theirs with the same
number, shows that the card was flown the other way or more slowly. An input that is softer than
theirs shows other hands: its sharpness is the largest change between two samples, as a share of the
largest deflection so far.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, isnan
from typing import NamedTuple

import numpy as np

from core.channels import LATERAL, Dictionary
from core.monitor.file.values import check_array
from core.types import Array, Flags, Indices

BEGUN = 0.5
"""A surface has begun to move once it exceeds this share of its usual peak."""
FEWEST = 500
"""Minimum number of fresh flights: with fewer, rare shapes may be missing by chance."""
SIDE_LEVEL = 0.02
"""Largest p-value for a wrong first direction."""
HOLD_LEVEL = 0.004
"""Share of fresh flights that may be flagged because of their holds."""
SOFT_LEVEL = 0.002
"""Share of fresh flights that may be flagged because of their soft input."""
MOST_HOLDS = 8
"""Number of holds per flight that are checked, from the first."""
GUARD_S, GUARD = 1e-4, 1e-9
"""Tolerance on times [s], and on shares."""


class WrongInput(NamedTuple):
    """An input flown differently from almost all training flights.

    sample, t: number and time [s] of the sample that shows it.   channel: key of the surface.
    p_value: conformal, Bonferroni over surfaces, sides and holds.   words: the reason.
    """

    sample: int
    t: float
    channel: str
    p_value: float
    words: str


class Holds(NamedTuple):
    """Holds of surfaces, sample by sample: (..., n_samples, k).

    side: -1 or 1 while a surface is held, else 0.   number: of the hold, from 1.
    lasted: time since its begin or the last gap [s].
    step: largest change between two samples so far, inf once one is missing.   peak: largest
    deflection so far.
    """

    side: Indices
    number: Indices
    lasted: Array
    step: Array
    peak: Array

    @classmethod
    def of(cls, deflection: Array, begun: Array, t: Array, follows: Flags) -> "Holds":
        """Find the holds of deflections (..., n_samples, k), NaN for none.

        begun: (k,).   t: (n_samples,) [s].   follows: (n_samples,) false after a missing sample.
        """
        side = np.where(np.abs(deflection) >= begun, np.sign(deflection), 0.0).astype(np.int64)
        before = np.zeros_like(side)
        before[..., 1:, :] = side[..., :-1, :]
        begins = (side != 0) & (side != before)
        anew = begins | ~follows[:, np.newaxis]
        at = np.where(anew, np.arange(len(t))[:, np.newaxis], 0)
        since = t[np.maximum.accumulate(at, axis=-2)]
        step = np.abs(np.diff(deflection, axis=-2, prepend=deflection[..., :1, :]))
        step[np.isnan(step) | ~follows[:, np.newaxis]] = np.inf
        return cls(
            side,
            begins.cumsum(axis=-2),
            t[:, np.newaxis] - since,
            np.maximum.accumulate(step, axis=-2),
            np.fmax.accumulate(np.abs(deflection), axis=-2),
        )


@dataclass(frozen=True, eq=False)
class InputShape:
    """First direction of surfaces in fresh flights, duration of their holds, and sharpness.

    surfaces: (k,) channel numbers.   begun: (k,) magnitude from which they are held [rad].
    flights: (k, 2) fresh flights whose first hold is negative, positive.
    longest_s: (k, m) duration that almost no flight exceeds, for holds 1..m [s]; empty in older
    files.
    softest: (k,) sharpness that almost no flight falls below; 0 in older files.
    dictionary: of the channels.

    Among similar flights at most SIDE_LEVEL are flagged for their direction (in fact as few as
    among these flights), HOLD_LEVEL for their holds, and SOFT_LEVEL for a soft input.
    """

    surfaces: Indices
    begun: Array
    flights: Indices
    longest_s: Array
    softest: Array
    dictionary: Dictionary = LATERAL

    def check(self) -> None:
        k, m = len(self.surfaces), self.longest_s.shape[-1]
        check_array("input begun", self.begun, (k,), above=0)
        check_array("input flights", self.flights, (k, 2), np.int64, least=0)
        check_array("input longest_s", self.longest_s, (k, m), least=0)
        check_array("input softest", self.softest, (k,), least=0)

    def first_wrong(self, t: Array, y: Array, counts: Flags) -> WrongInput | None:
        """The first sample at which a surface moves differently from almost all fresh flights.

        t: (n,) [s].   y: (n, 6) from trim.   counts: (n,) samples to check.
        """
        samples = np.flatnonzero(counts)
        if not len(samples):
            return None
        follows = np.diff(samples, prepend=samples[0] - 1) == 1
        holds = Holds.of(y[samples][:, self.surfaces], self.begun, t[samples], follows)
        wrong = self._wrong(holds)
        if not wrong.any():
            return None
        first = int(wrong.any(axis=-1).argmax())
        k, sample = int(wrong[first].argmax()), int(samples[first])
        side, number, lasted, *_ = (part[first, k].item() for part in holds)
        return self.wrong(sample, float(t[sample]), k, (side, number, lasted))

    def first_wrong_of(self, y: Array, dt: float) -> Indices:
        """(n,) that sample for each trajectory y (n, n_samples, 6); n_samples for none."""
        t = dt * np.arange(y.shape[1])
        follows = np.ones(len(t), bool)
        holds = Holds.of(y[..., self.surfaces], self.begun, t, follows)
        wrong: Flags = np.any(self._wrong(holds), axis=-1)
        return np.where(np.any(wrong, axis=1), np.argmax(wrong, axis=1), len(t))

    def _wrong(self, holds: Holds) -> Flags:
        """(..., n_samples, k) samples of holds that begin wrong, last too long or are too soft."""
        k = np.arange(len(self.surfaces))
        begins_wrong = (holds.number == 1) & self._untaken[k, (holds.side > 0).astype(int)]
        number = np.minimum(holds.number, self._bounds_s.shape[1] - 1)
        lasts = holds.lasted > self._bounds_s[k, number]
        is_soft = holds.step < self._softest * holds.peak
        return (holds.side != 0) & (begins_wrong | lasts | is_soft)

    @cached_property
    def _n(self) -> Indices:
        """(k,) fresh flights that moved a surface."""
        return self.flights.sum(axis=1)

    @cached_property
    def _untaken(self) -> Flags:
        """(k, 2) sides, negative and positive, to which almost no flight began."""
        n, chances = self._n[:, np.newaxis], self.flights.size
        return (n >= FEWEST) & (chances * (self.flights + 1) <= SIDE_LEVEL * (n + 1))

    @cached_property
    def _bounds_s(self) -> Array:
        """(k, m + 2) longest valid duration by number of the hold [s]; inf if unknown."""
        known = np.where(self._n[:, np.newaxis] >= FEWEST, self.longest_s + GUARD_S, np.inf)
        return np.pad(known, ((0, 0), (1, 1)), constant_values=np.inf)

    @cached_property
    def _softest(self) -> Array:
        """(k,) least valid sharpness; 0 if unknown."""
        return np.where(self._n >= FEWEST, (1 - GUARD) * self.softest, 0.0)

    def wrong(self, sample: int, t: float, k: int, hold: tuple[int, int, float]) -> WrongInput:
        """Describe a wrong hold of surface k.

        hold: its side, number and duration so far [s].
        """
        side, number, lasted = hold
        n, channel = int(self._n[k]), self.dictionary.channels[self.surfaces[k]]
        side_name, other_side = ("positive", "negative") if side > 0 else ("negative", "positive")
        if number == 1 and self._untaken[k, int(side > 0)]:
            rest, chances = int(self.flights[k, int(side > 0)]), self.flights.size
            words = (
                f"{channel.label} began {side_name} at {t:.2f} s, but {other_side} in "
                f"{_all_but(rest, n)} fresh flights"
            )
        elif lasted <= self._bounds_s[k, min(number, self._bounds_s.shape[1] - 1)]:
            chances = len(self.surfaces)
            rest = _rank(n, chances, SOFT_LEVEL) - 1
            words = (
                f"{channel.label} moved more softly until {t:.2f} s than in {_all_but(rest, n)} "
                "fresh flights"
            )
        else:
            rest, chances = _rank(n, self.longest_s.shape[1]) - 1, self.longest_s.size
            words = (
                f"{channel.label} stayed {side_name} for {lasted:.2f} s until {t:.2f} s, but at "
                f"most {self.longest_s[k, number - 1]:.2f} s in {_all_but(rest, n)} fresh flights"
            )
        p_value = chances * (rest + 1) / (n + 1)
        words = f"{words}: the input differs from the planned one"
        return WrongInput(sample, t, channel.key, p_value, words)

    def start(self) -> "RunningShape":
        return RunningShape(self)


def _all_but(some: int, n: int) -> str:
    return f"all but {some} of {n:,}" if some else f"all {n:,}"


def _rank(n: int, m: int, level: float = HOLD_LEVEL) -> int:
    """Rank, from the most extreme of n values, of the bound for each of m hold numbers."""
    return max(1, int(level / m * (n + 1)))


class RunningShape:
    """Checks the input of one flight, sample by sample."""

    def __init__(self, shape: InputShape) -> None:
        k = len(shape.surfaces)
        self._shape = shape
        self._untaken: list[list[bool]] = shape._untaken.tolist()
        self._bounds_s: list[list[float]] = shape._bounds_s.tolist()
        self._softest: list[float] = shape._softest.tolist()
        self._surfaces = list(
            zip(range(k), shape.surfaces.tolist(), shape.begun.tolist(), strict=True)
        )
        self._sides, self._numbers, self._since = [0] * k, [0] * k, [0.0] * k
        self._before: list[float] | None = None
        self._steps, self._peaks = [0.0] * k, [0.0] * k
        self._newest = -2

    def update(self, sample: int, t: float, y: Array) -> WrongInput | None:
        """Check the next sample y (6,) that counts."""
        follows, self._newest = sample == self._newest + 1, sample
        moved = [y.item(channel) for _, channel, _ in self._surfaces]
        before, self._before = self._before or moved, moved
        is_gap = before is not moved and not follows
        wrong = None
        for k, _, begun in self._surfaces:
            deflection = moved[k]
            step = abs(deflection - before[k])
            self._steps[k] = max(self._steps[k], inf if is_gap or isnan(step) else step)
            self._peaks[k] = max(self._peaks[k], abs(deflection))  # a NaN is never larger
            side = 0 if not abs(deflection) >= begun else 1 if deflection > 0 else -1
            begins = side not in (0, self._sides[k])
            self._sides[k] = side
            self._numbers[k] += begins
            if begins or not follows:
                self._since[k] = t
            if side == 0 or wrong is not None:
                continue
            number, lasted, bounds = self._numbers[k], t - self._since[k], self._bounds_s[k]
            begins_wrong = number == 1 and self._untaken[k][side > 0]
            lasts = lasted > bounds[min(number, len(bounds) - 1)]
            if begins_wrong or lasts or self._steps[k] < self._softest[k] * self._peaks[k]:
                wrong = self._shape.wrong(sample, t, k, (side, number, lasted))
        return wrong


class FreshShapes:
    """Gathers the input shapes of fresh flights, batch by batch.

    surfaces: channel numbers.   begun: (k,) [rad].   dt: [s].
    """

    def __init__(
        self, surfaces: Sequence[int], begun: Array, dt: float, dictionary: Dictionary = LATERAL
    ) -> None:
        self._surfaces, self._begun, self._dt = surfaces, begun, dt
        self._dictionary = dictionary
        self._flights = np.zeros((len(surfaces), 2), np.int64)
        self._longest: list[Array] = []
        self._softest: list[Array] = []

    def add(self, y: Array, last: Indices) -> None:
        """Add flights over their samples 0..last.

        y: (n, n_samples, 6) from trim.   last: (n,).
        """
        t = self._dt * np.arange(y.shape[1])
        moved = deflections(y, last, self._surfaces)
        holds = Holds.of(moved, self._begun, t, np.ones(len(t), bool))
        for column, side in enumerate((-1, 1)):
            first = (holds.number == 1) & (holds.side == side)
            self._flights[:, column] += first.any(axis=1).sum(axis=0)
        numbers = np.arange(1, MOST_HOLDS + 1)
        in_hold = (holds.number[..., np.newaxis] == numbers) & (holds.side != 0)[..., np.newaxis]
        self._longest.append(np.where(in_hold, holds.lasted[..., np.newaxis], -1.0).max(axis=1))
        sharpness = holds.step / np.where(holds.side == 0, -1.0, holds.peak)
        self._softest.append(np.where(holds.side == 0, np.inf, sharpness).min(axis=1))

    def shape(self, main: Indices) -> InputShape:
        """Shape of all flights added, for some of the surfaces."""
        longest = np.sort(np.concatenate(self._longest)[:, main], axis=0)
        m = max(1, int((longest[-1] >= 0).any(axis=0).sum()))
        n = self._flights[main].sum(axis=1)
        ranks = [_rank(flights, m) for flights in n.tolist()]
        bounds = np.array([longest[-rank, k, :m] for k, rank in enumerate(ranks)])
        softest = np.sort(np.concatenate(self._softest)[:, main], axis=0)
        soft_ranks = [_rank(flights, len(main), SOFT_LEVEL) for flights in n.tolist()]
        soft = np.array([softest[rank - 1, k] for k, rank in enumerate(soft_ranks)])
        return InputShape(
            np.array(self._surfaces)[main],
            self._begun[main],
            self._flights[main],
            np.maximum(bounds, 0.0),
            np.where(np.isfinite(soft), soft, 0.0),
            self._dictionary,
        )


def deflections(y: Array, last: Indices, surfaces: Sequence[int] | Indices) -> Array:
    """(n, n_samples, k) surfaces over samples 0..last; 0 later and if unknown.

    y: (n, n_samples, 6) from trim.   last: (n,).
    """
    counts = np.arange(y.shape[1])[np.newaxis, :, np.newaxis] <= last[:, np.newaxis, np.newaxis]
    return np.where(counts, np.nan_to_num(y[..., list(surfaces)]), 0.0)
