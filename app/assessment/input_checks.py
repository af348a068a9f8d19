"""Checks of the samples as received: what a source sends may be no picture of the aircraft.

A source may freeze, two sources may contradict each other, and a surface channel may be dead. Each
sample is checked when it arrives, so a flight and the replay of its journal find the same.
"""

from collections import deque
from collections.abc import Sequence
from math import isnan
from typing import Literal, NamedTuple, get_args

import numpy as np

from app.assessment.planned_test import PlannedTest
from app.assessment.trim import BEGINNING, OTHER, RESTS, SHARE, SMALLEST
from core.channels import Channel
from core.kernels import input_motion as kernel
from core.kernels.compiled import entry
from core.kernels.input_motion import KEPT, REACTS_S, SurfaceRule, SurfaceState
from core.limits.limits import Envelope
from core.monitor.status import Level
from core.types import Array

DoubtKind = Literal["surfaces", "frozen", "contradiction"]
DOUBT_KINDS: tuple[DoubtKind, ...] = get_args(DoubtKind)

LOOK_S, MEASURE_S = 0.1, 0.5
"""Time between two looks at the recent samples, and between two measurements of noise [s]."""
APART_S = 0.019
"""Least time between two samples that are looked at [s]; a faster source has more."""
FIRST_LOOK, FEW = 8, 4.0
"""Samples: the least that show the noise, and the share by which few of them may underestimate it,
times their number."""
MOVES = 0.15
"""Share of the largest response in training that is a motion of the aircraft."""
NOISES, RESOLUTIONS = 8.0, 2.0
"""A motion exceeds this many standard deviations of the noise, and steps of the channel."""

FROZEN_S, FEWEST = 1.0, 3
"""Identical samples for longer than this [s], and more than this many, are frozen."""
VARIES, REVERSES = 0.5, 1.0 / 3.0
"""Noise changes this share of the samples and turns around in this share of its changes. A smooth
motion seldom turns, and a coarse channel at rest seldom changes."""

REMEMBERED = 1024
"""Newest samples that a later one may contradict."""
AGREES = 0.05
"""Share of a limit, or of the largest value in training, by which two samples may differ."""
CONTRADICTS_S = 1.0
"""A contradiction lasts until this time passes without another one [s]."""

UNMOVED = "aircraft moves, surfaces do not: {}check the channel"


class Doubt(NamedTuple):
    """Why the samples are no picture of the aircraft. t: when it began [s]."""

    kind: DoubtKind
    level: Level
    t: float
    reason: str


class InputChecks:
    """The checks of one source.

    usual: (n_channels,) largest magnitudes in training.   limits: of the monitor; None if unknown.
    by_hand: whether a manoeuvre can be begun by hand.
    """

    def __init__(
        self, planned: PlannedTest, usual: Array, limits: Envelope | None, by_hand: bool
    ) -> None:
        self._recent = _Recent(len(usual))
        self._frozen = _Frozen(self._recent)
        scales = usual
        if limits is not None:
            to_limit = np.minimum(limits.high - limits.rest, limits.rest - limits.low)
            scales = np.where(np.isfinite(to_limit), to_limit, usual)
        channels = planned.dictionary.channels
        self._contradictions = _Contradictions(self._recent, AGREES * scales, channels)
        self._surfaces = _Surfaces(self._recent, planned, usual, by_hand)
        self.doubts: tuple[Doubt, ...] = ()
        """those of the newest sample"""

    def push(self, arrived: float, t: float, y: Array, source: str, in_manoeuvre: bool) -> None:
        """Add a received sample. t: flight time [s].   source: its name for people."""
        looks = self._recent.push(t, y)
        found = (
            self._frozen.push(t, y),
            self._contradictions.push(arrived, t, y, source),
            self._surfaces.push(t, looks, in_manoeuvre),
        )
        if any(found) or self.doubts:
            self.doubts = tuple(filter(None, found))

    def restart(self) -> None:
        """The source's clock stepped: its times are no longer those of earlier samples."""
        self._contradictions.restart()


class _Recent:
    """The newest samples in order of time, and what noise and resolution make of a channel.

    t: (2 KEPT,) [s].   y: (2 KEPT, n_channels).   n: samples in them.
    """

    def __init__(self, n_channels: int) -> None:
        self.t, self.y = np.empty(2 * KEPT), np.empty((2 * KEPT, n_channels))
        self.n = 0
        self._newest = self._looked = self._measured = -np.inf
        self.uncertainty = np.zeros(n_channels)
        """(n_channels,) extent of a channel that is noise and resolution alone"""
        self.is_measured = False
        self._roughness = np.empty(n_channels), np.empty(n_channels)
        self._fill_roughness = entry(kernel.roughness, self.t, self.y, 0, *self._roughness)

    def push(self, t: float, y: Array) -> bool:
        """Add a sample. Returns whether it is time to look."""
        if t - self._newest < APART_S:
            return False
        if self.n == len(self.t):
            self.n = KEPT
            self.t[:KEPT], self.y[:KEPT] = self.t[KEPT:], self.y[KEPT:]
        self.t[self.n], self.y[self.n] = t, y
        self.n, self._newest = self.n + 1, t
        if self.n < FIRST_LOOK or t - self._looked < LOOK_S:
            return False
        self._looked = t
        if t - self._measured >= MEASURE_S:
            self._measured = t
            self._measure()
        return True

    def window(self, seconds: float) -> Array:
        """(n, n_channels) samples of the last seconds."""
        first = int(self.t[: self.n].searchsorted(self._newest - seconds - 1e-9))
        return self.y[max(first, self.n - KEPT) : self.n]

    def _measure(self) -> None:
        n = self._fill_roughness(self.t, self.y, self.n, *self._roughness)
        if n < FIRST_LOOK:
            return
        bends, steps = self._roughness
        noise = (1.0 + FEW / (n - 2)) * bends / (0.6745 * np.sqrt(6.0))
        self.uncertainty[:] = np.fmax(NOISES * noise, RESOLUTIONS * steps)
        self.is_measured = True


class _Frozen:
    """Identical samples: a caution if the seconds before had noise, else an advisory."""

    def __init__(self, recent: _Recent) -> None:
        self._recent = recent
        self._last, self._since, self._n = b"", -np.inf, 0
        self._measured = -np.inf
        self._n_measured = self._n_turning = 0
        self._varies = True

    def push(self, t: float, y: Array) -> Doubt | None:
        content = y.tobytes()
        if content != self._last:
            self._last, self._since, self._n = content, t, 1
            if t - self._measured >= REACTS_S:
                self._measure(t)
            return None
        self._n += 1
        if t - self._since <= FROZEN_S or self._n <= FEWEST or np.isnan(y).all():
            return None
        level = Level.CAUTION if self._has_noise else Level.ADVISORY
        reason = f"all channels frozen since {self._since:.2f} s"
        return Doubt("frozen", level, self._since, reason)

    @property
    def _has_noise(self) -> bool:
        return self._varies and 0 < self._n_measured <= 2 * self._n_turning

    def _measure(self, t: float) -> None:
        """Measure the second before this change."""
        is_first, self._measured = self._measured == -np.inf, t
        changes = np.diff(self._recent.window(REACTS_S), axis=0)
        if is_first or len(changes) < FEWEST:
            return
        self._n_measured += 1
        self._varies &= bool((changes != 0.0).any(axis=1).mean() >= VARIES)
        turns = changes[1:] * changes[:-1]
        n_turns, n = np.count_nonzero(turns < 0.0, axis=0), np.count_nonzero(turns, axis=0)
        self._n_turning += bool((n_turns > REVERSES * np.maximum(n, FEWEST)).any())


class _Contradictions:
    """Samples of one time that differ. agrees: (n_channels,) differences that are none.

    A repeated time counts once the source goes on: a source that is set back repeats times as well.
    """

    def __init__(self, recent: _Recent, agrees: Array, channels: Sequence[Channel]) -> None:
        self._recent, self._agrees, self._channels = recent, agrees, channels
        self._known: dict[float, tuple[Array, str]] = {}
        self._times: deque[float] = deque()
        self._newest = self._seen = -np.inf
        self._waiting: Doubt | None = None
        self._doubt: Doubt | None = None

    def restart(self) -> None:
        self._known.clear()
        self._times.clear()
        self._newest, self._waiting = -np.inf, None

    def push(self, arrived: float, t: float, y: Array, source: str) -> Doubt | None:
        at, sample = round(t, 6), (y, source)
        known = self._known.setdefault(at, sample)
        if known is sample:
            self._times.append(at)
            if len(self._times) > REMEMBERED:
                del self._known[self._times.popleft()]
            if t > self._newest:
                self._go_on(t)
        else:
            self._compare(arrived, t, y, source, *known)
        if self._doubt is not None and arrived - self._seen > CONTRADICTS_S:
            self._doubt = None
        return self._doubt

    def _go_on(self, t: float) -> None:
        self._newest = t
        if self._waiting is not None:
            self._doubt, self._waiting = self._doubt or self._waiting, None

    def _compare(
        self, arrived: float, t: float, y: Array, source: str, first: Array, first_source: str
    ) -> None:
        excess = np.abs(y - first) - np.fmax(self._agrees, self._recent.uncertainty)
        if not self._recent.is_measured or not (excess > 0.0).any():
            return
        c, self._seen = int(np.nanargmax(excess)), arrived
        if self._doubt is None and self._waiting is None:
            channel = self._channels[c]
            values = f"{channel.symbol} {channel.read(first[c])}", channel.read(y[c])
            reason = f"samples of {t:.2f} s contradict: {values[0]} and {values[1]}"
            if source != first_source:
                reason = (
                    f"two sources contradict at {t:.2f} s: {values[0]} from {first_source}, "
                    f"{values[1]} from {source}: end one of them"
                )
            self._waiting = Doubt("contradiction", Level.CAUTION, t, reason)


class _Surfaces:
    """The aircraft moves while its surfaces rest: one of them is not the aircraft's.

    A motion is explained for SWINGS_S after a surface moved; later it may swing on, not grow.
    Another surface than the planned ones must make an input, as long as one of them may be dead.
    """

    def __init__(self, recent: _Recent, planned: PlannedTest, usual: Array, by_hand: bool) -> None:
        self._recent = recent
        outputs = np.array(planned.dictionary.of_role("output"), np.int64)
        amplitudes = planned.amplitudes
        largest = amplitudes.max(initial=0.0)
        is_planned = (amplitudes > 0.0) | (largest == 0.0)
        an_input = max(BEGINNING * SHARE * OTHER * largest, SMALLEST)
        self._rule = SurfaceRule(
            np.array(planned.controls, np.int64),
            outputs,
            np.maximum(MOVES * usual[outputs], RESTS),
            is_planned,
            float(SMALLEST),
            np.where(is_planned, SMALLEST, an_input),
        )
        self._applies = bool(planned.controls) and len(outputs) > 0
        unmoved = np.zeros(len(amplitudes), bool), np.zeros(len(outputs)), np.array([-np.inf])
        self._state, self._since = SurfaceState(*unmoved), np.nan
        self._reason = UNMOVED.format("press G or " if by_hand else "")
        self._look = entry(kernel.look, *self._arguments)

    @property
    def _arguments(self) -> tuple[object, ...]:
        recent = self._recent
        about = self._rule, self._state, recent.t, recent.y, recent.n
        return *about, recent.uncertainty, self._since

    def push(self, t: float, looks: bool, in_manoeuvre: bool) -> Doubt | None:
        if in_manoeuvre:
            self._state.moved[0], self._since = t, np.nan
        elif looks and self._applies:
            self._since = self._look(*self._arguments)
        if isnan(self._since):
            return None
        return Doubt("surfaces", Level.CAUTION, self._since, self._reason)
