"""The manoeuvres of a flight and their trim, from the samples so far."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import NamedTuple, Self

import numpy as np

from app.assessment.planned_test import PlannedTest, needed_channels, planned_test
from core.kernels import causal_trim as kernel
from core.kernels.causal_trim import TrimRule, TrimState
from core.kernels.compiled import entry
from core.limits.limits import Envelope
from core.monitor import Monitor
from core.monitor.assessment import Cause
from core.monitor.status import NO_MANOEUVRE
from core.types import Array, Indices

MEASURED_S = 0.1
"""Interval of trim measurements at rest [s]."""
GUARD_S = 0.2
"""The newest part of the rest does not count for trim [s]: a departure may have begun."""
CALM_S = 2.0
"""A channel that moves within this time has no trim [s]: half a swing looks like rest."""
USUAL_S = 20.0
"""Memory of how far the surfaces usually move at rest [s]."""
AFTERWARDS = 3.0
"""[s] A manoeuvre of unknown length continues this long after its last input."""
RESTED = 1.5
"""[s] Rest after which a manoeuvre of unknown length is over."""
SHARE = 0.25
"""Share of the planned amplitude that makes an input, small enough for a build-up."""
BEGINNING = 0.5
"""Share of the input at which a surface departs."""
OTHER = 2.0
"""Times the planned input: size of an input on a surface that should not move."""
SMALLEST = np.radians(0.1)
"""[rad] Smaller motion is never an input."""
TRIM_SHARE = 0.25
"""Share of a channel's largest in training; a response that moves further is not in trim."""
RESTS = 0.005
"""[rad, rad/s, g] Smaller motion always counts as rest."""
MOVING = "the surfaces move: trim is measured as soon as they rest"
RESTING = f"{NO_MANOEUVRE}: it begins with the first movement of a surface"
BEYOND = (
    "the trim of this rest is beyond a limit: values are as recorded until a manoeuvre begins from "
    "it"
)
EXCEEDED = (
    "a limit is exceeded at rest: no trim is measured until that ends; press G if the aircraft is "
    "trimmed so"
)
"""These reasons are stored: a journal that is rescored must give the same."""
BY_HAND = f"{NO_MANOEUVRE}: no channel is a control, so begin it by hand (press G)"


class FollowedManoeuvre(NamedTuple):
    """Samples begin to stop - 1.   trim: (n_channels,) NaN where unknown."""

    begin: int
    stop: int
    trim: Array


class TrimSteps(NamedTuple):
    """The trim over time.

    starts: (m,) times from which each applies, increasing [s]; the first applies before, too.
    values: (m, n_channels) NaN where unknown.
    """

    starts: Array
    values: Array

    @classmethod
    def constant(cls, trim: Array) -> Self:
        """trim: (n_channels,)."""
        return cls(np.array([-inf]), trim[None])

    @classmethod
    def of_samples(cls, t: Array, levels: Array) -> Self:
        """levels: (n, n_channels) trim of each sample at t (n,)."""
        bits = np.ascontiguousarray(levels).view(np.int64)
        changes = np.append(True, (bits[1:] != bits[:-1]).any(axis=1))
        return cls(t[changes], levels[changes])

    def at(self, t: Array | float) -> Array:
        """(..., n_channels) at times [s]."""
        return self.values[self.number(t)]

    def of_channel(self, c: int, t: Array) -> Array:
        """(n,) of channel c at times (n,) [s]."""
        return self.values[self.number(t), c]

    def number(self, t: Array | float) -> Indices:
        """Which of the steps applies at times [s]."""
        return np.maximum(np.searchsorted(self.starts, t, "right") - 1, 0)


class CausalTrim:
    """Phases of a flight: rest, in which trim is measured, and manoeuvres.

    A manoeuvre begins when a surface first departs from rest; trim is the mean of the rest before
    it. A response that moves keeps the trim of an earlier rest; without one its trim is unknown.

    moving: (n_channels,) a channel that moves further within CALM_S has no trim.   sizes:
    (n_controls,) inputs of the controls; those of the planned test unless given.
    """

    def __init__(
        self, planned: PlannedTest, moving: Array | None = None, sizes: Array | None = None
    ) -> None:
        self.planned, dt = planned, planned.dt
        self._limits = planned.limits
        n_trim = max(2, round(planned.trim_segment_s / dt))
        n_rest = n_trim + round(GUARD_S / dt)
        threshold = departure(input_sizes(planned) if sizes is None else sizes)
        length, n_channels = planned.duration, len(planned.dictionary)
        most = 0 if length is None else max(1, round((length - planned.trim_segment_s) / dt))
        absolute = np.zeros(n_channels, bool)
        absolute[list(planned.dictionary.absolute)] = True
        self._rule = TrimRule(
            np.array(planned.controls, np.int64),
            threshold,
            np.full(n_channels, np.inf) if moving is None else moving,
            absolute,
            n_trim,
            max(1, round(MEASURED_S / dt)),
            most,
            round(AFTERWARDS / dt),
            round(USUAL_S / dt),
        )
        self._state = TrimState(
            np.zeros(kernel.N_COUNT, np.int64),
            np.full(n_channels, np.nan),
            planned.limits.low.copy(),
            planned.limits.high.copy(),
            threshold.copy(),
            np.zeros(len(threshold)),
            np.empty((n_rest, n_channels)),
            np.empty((n_rest + round(CALM_S / dt), n_channels)),
            np.empty((round(RESTED / dt), len(threshold))),
        )
        compiled = self._rule, self._state
        self._follow_one = entry(kernel.follow_one, *compiled, np.empty(n_channels))
        self._begin = entry(kernel.begin, *compiled)
        self._level = entry(kernel.level, *compiled, np.empty(n_channels))

    @classmethod
    def of(cls, *monitors: Monitor) -> "CausalTrim":
        """For monitors of one test: the least motion and input that counts for any of them."""
        tests = [planned_test(monitor) for monitor in monitors]
        longest = max(tests, key=lambda test: inf if test.duration is None else test.duration)
        moving = [_moving(*each) for each in zip(monitors, tests, strict=True)]
        return cls(longest, np.min(moving, axis=0), np.min([*map(input_sizes, tests)], axis=0))

    @property
    def manoeuvre(self) -> int:
        """Number of the current one; 0 at rest."""
        return int(self._state.counts[kernel.MANOEUVRE])

    @property
    def level(self) -> Array:
        """The last trim (n_channels,), NaN where unknown; 0 where it is not subtracted."""
        level = np.empty(len(self._state.trim))
        self._level(self._rule, self._state, level)
        return level

    @property
    def rest(self) -> Array:
        """(n_channels,) mean of the newest rest that counts; NaN where unknown."""
        memory, n_rest = self._state.rest, int(self._state.counts[kernel.N_REST])
        if n_rest < len(memory):
            return np.full(memory.shape[1], np.nan)
        return mean_of_rest(memory[(n_rest + np.arange(self._rule.n_trim)) % len(memory)])

    @property
    def waits(self) -> tuple[str, Cause]:
        """Why there is no manoeuvre, in words and in one."""
        if self._state.counts[kernel.HAS_TRIM]:
            if (np.isnan(self.level) & np.isfinite(self._state.trim)).any():
                return BEYOND, Cause.READY
            unmeasured = np.isnan(self._state.trim) & np.isfinite(self._rule.moving)
            if unmeasured.any():
                keys = self.planned.dictionary.keys
                return moved([keys[c] for c in np.flatnonzero(unmeasured)]), Cause.MOVING
            return RESTING if self.planned.controls else BY_HAND, Cause.READY
        n_rest, counts = len(self._state.rest), self._state.counts
        if 0 < counts[kernel.BEYOND] == counts[kernel.N_REST]:
            return EXCEEDED, Cause.MOVING
        if counts[kernel.N_REST] - counts[kernel.BEYOND] >= n_rest:
            return MOVING, Cause.MOVING
        needed = n_rest * self.planned.dt
        return (
            f"trim is measured: it needs {needed:.3g} s of rest before the manoeuvre",
            Cause.REST,
        )

    def judge_by(self, limits: Envelope | None) -> None:
        """Apply limits from the next sample on; None, for unknown ones, keeps the last."""
        if limits is not None and limits is not self._limits:
            self._limits = limits
            self._state.low[:], self._state.high[:] = limits.low, limits.high

    def update(self, y: Array) -> bool:
        """Add a sample (n_channels,). Returns whether a manoeuvre begins with it."""
        return bool(self._follow_one(self._rule, self._state, np.ascontiguousarray(y)))

    def follow(
        self,
        y: Array,
        begun: Sequence[int] = (),
        in_force: Mapping[int, Envelope | None] | None = None,
        levels: Array | None = None,
    ) -> list[FollowedManoeuvre]:
        """Add samples (n, n_channels) of a whole recording; return its manoeuvres.

        begun: samples with which one is begun by hand.   in_force: other limits, by the sample from
        which they apply.   levels: (n, n_channels) filled with the trim after each sample.
        """
        levels = np.empty(y.shape) if levels is None else levels
        y, at, in_force = np.ascontiguousarray(y), 0, in_force or {}
        edges = list[tuple[int, int, Array]]()
        for stop in sorted({*begun, *in_force, len(y)}):
            while at < stop:
                before = self.manoeuvre
                at = kernel.follow(self._rule, self._state, y[:stop], at, levels)
                if self.manoeuvre != before:
                    edges.append((at - 1, self.manoeuvre, self.level))
            self.judge_by(in_force.get(stop))
            if stop in begun and stop < len(y) and self.begin():
                edges.append((stop, self.manoeuvre, self.level))
        ends = [at for at, *_ in edges[1:]] + [len(y)]
        return [
            FollowedManoeuvre(begin, stop, trim)
            for (begin, number, trim), stop in zip(edges, ends, strict=False)
            if number
        ]

    def begin(self) -> bool:
        """Begin a manoeuvre with the current trim. Returns False during a manoeuvre."""
        return bool(self._begin(self._rule, self._state))


def departure(sizes: Array) -> Array:
    """(n_controls,) how far each control departs from rest. sizes: of its input."""
    return np.maximum(BEGINNING * SHARE * sizes, SMALLEST)


def input_sizes(planned: PlannedTest) -> Array:
    """(n_controls,) inputs of the controls of a planned test."""
    amplitudes = planned.amplitudes
    return np.where(amplitudes > 0.0, amplitudes, OTHER * amplitudes.max(initial=0.0))


def _moving(monitor: Monitor, planned: PlannedTest) -> Array:
    moving = motion(planned, monitor.training_max_abs)
    moving[~needed_channels(monitor)] = np.inf
    return moving


def motion(planned: PlannedTest, usual: Array) -> Array:
    """(n_channels,) what counts as motion of each. usual: its largest in training.

    The next larger power of two, so that other monitors of the same test measure the same trim.
    """
    moving = 2.0 ** np.ceil(np.log2(largest_at_rest(usual)))
    moving[[*planned.controls, *planned.dictionary.absolute]] = np.inf
    return moving


def largest_at_rest(usual: Array) -> Array:
    """Extent of each channel that still counts as rest. usual: its largest in training."""
    return np.maximum(TRIM_SHARE * usual, RESTS)


def moved(keys: list[str]) -> str:
    """Why a trim is unknown."""
    return f"the aircraft moves: the trim of {', '.join(keys)} is unknown until it rests"


def mean_of_rest(rest: Array) -> Array:
    """Trim from a rest (n, k): (k,) mean of each channel's known samples, NaN without any."""
    known = np.isfinite(rest)
    count = known.sum(axis=0)
    total = np.where(known, rest, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def of_earlier_rest(monitor: Monitor, trim: Array, rest: Array) -> tuple[str, str]:
    """Key of the output that counts from the trim of an earlier rest, since it moved, and why.

    Both empty for none.   trim: (n_channels,) of a manoeuvre.   rest: (n_channels,) mean before it.
    """
    dictionary, counted = monitor.dictionary, np.zeros(len(trim), bool)
    counted[[*dictionary.of_role("output")]] = True
    counted[[*dictionary.absolute]] = False
    counted &= needed_channels(monitor)
    away = np.abs(rest - trim) / largest_at_rest(monitor.training_max_abs)
    share = np.where(counted & np.isfinite(away), away, 0.0)
    c = int(share.argmax())
    if share[c] <= 1.0:
        return "", ""
    channel, calm = dictionary.channels[c], planned_test(monitor).trim_segment_s + GUARD_S + CALM_S
    return channel.key, (
        f"{channel.key} moved within {calm:.3g} s before the first input, so it counts from the "
        f"trim of an earlier rest, {channel.read(trim.item(c))}, and begins at "
        f"{channel.read(rest.item(c))}"
    )
