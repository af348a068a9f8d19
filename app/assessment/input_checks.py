"""Checks of the samples as received: what a source sends may be no picture of the aircraft.

A source or one of its channels may freeze, two sources may contradict each other, and a surface
channel may be dead. Each sample is checked when it arrives, so a flight and the replay of its
journal find the same.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from math import isnan
from typing import Literal, NamedTuple, get_args

import numpy as np

from app.assessment.planned_test import PlannedTest
from app.assessment.trim import BEGINNING, OTHER, RESTS, SHARE, SMALLEST
from core.channels import Channel, Dictionary
from core.flight_events import TrimChange
from core.kernels import input_motion as kernel
from core.kernels.compiled import entry
from core.kernels.input_motion import (
    FEWEST,
    FIRST_LOOK,
    FROZEN_S,
    GOES_ON,
    HOLDS,
    KEPT,
    LOOK_S,
    LOOKS,
    REACTS_S,
    REMEMBERED,
    SAME,
    NewestSamples,
    SurfaceRule,
    SurfaceState,
)
from core.limits.limits import Envelope
from core.monitor.status import Level
from core.types import Array, Flags

DoubtKind = Literal["surfaces", "frozen", "contradiction", "trim"]
DOUBT_KINDS: tuple[DoubtKind, ...] = get_args(DoubtKind)

MEASURE_S = 0.5
"""Time between two measurements of noise [s]."""
FEW = 4.0
"""Few samples may underestimate the noise by this share, times their number."""
MOVES = 0.15
"""Share of the largest response in training that is a motion of the aircraft."""
NOISES, RESOLUTIONS = 8.0, 2.0
"""A motion exceeds this many standard deviations of the noise, and steps of the channel."""

VARIES, REVERSES = 0.5, 1.0 / 3.0
"""Noise changes this share of the samples and turns around in this share of its changes. A smooth
motion seldom turns, and a coarse channel at rest seldom changes."""
NOISY = 0.25
"""A control with noise in this share of the seconds in which it changed is not held exactly."""

AGREES = 0.05
"""Share of a limit, or of the largest value in training, by which two samples may differ."""
CONTRADICTS_S = 1.0
"""A contradiction lasts until this time passes without another one [s]."""

FAR, NOTABLE = 0.5, 0.2
"""A trim of this share of a limit is a caution, or an advisory."""
SETTLED = 0.1
"""A trim that changes by less, as a share of the limit, is the same."""

CHANGES_KEPT = 50
"""Newest changes of trim that are shown."""
LOOKED_AHEAD = 512
"""Trims of a recording in which the next change is looked for at once."""

UNMOVED = "aircraft moves, surfaces do not: {}check the channel"


NONE = None, None, None


class Doubt(NamedTuple):
    """Why the samples are no picture of the aircraft. t: when it began [s].   channels: keys.

    kind: of its alarm; None where that is the alarm of the stale or invalid samples.
    """

    kind: DoubtKind | None
    level: Level
    t: float
    reason: str
    channels: tuple[str, ...] = ()


class InputChecks:
    """The checks of one source.

    usual: (n_channels,) largest magnitudes in training.   limits: of the monitor; None if unknown.
    by_hand: whether a manoeuvre can be begun by hand.
    """

    def __init__(
        self, planned: PlannedTest, usual: Array, limits: Envelope | None, by_hand: bool
    ) -> None:
        self._recent = _Recent(len(usual))
        self._frozen = _Frozen(self._recent, planned.dictionary)
        scales = usual
        if limits is not None:
            to_limit = np.minimum(limits.high - limits.rest, limits.rest - limits.low)
            scales = np.where(np.isfinite(to_limit), to_limit, usual)
        channels = planned.dictionary.channels
        self._contradictions = _Contradictions(self._recent, AGREES * scales, channels)
        self._surfaces = _Surfaces(self._recent, planned, usual, by_hand)
        self._sources: dict[str, int] = {}
        self.doubts: tuple[Doubt, ...] = ()
        """those of the newest sample"""

    def push(self, arrived: float, t: float, y: Array, source: str, in_manoeuvre: bool) -> None:
        """Add a received sample. t: flight time [s].   source: its name for people."""
        number = self._sources.setdefault(source, len(self._sources))
        flags, repeated = self._recent.push(t, y, number)
        if repeated >= 0:
            self._contradictions.compare(arrived, t, y, repeated, number, [*self._sources])
        found = (
            self._frozen.push(t, y, is_same=bool(flags & SAME), holds=bool(flags & HOLDS)),
            self._contradictions.push(arrived, goes_on=bool(flags & GOES_ON)),
            self._surfaces.push(t, bool(flags & LOOKS), in_manoeuvre),
        )
        if found != NONE or self.doubts:
            self.doubts = tuple(filter(None, found))

    def restart(self) -> None:
        """The source's clock stepped: its times are no longer those of earlier samples."""
        self._recent.forget_times()
        self._contradictions.restart()


class TrimCheck:
    """Where the trim changed, and whether it is a large part of a limit: little shown may be much.

    limits: of the monitor; None if unknown.   changes: the newest.   far: channels, by key, whose
    trim is a notable share of their limit.
    """

    def __init__(self, dictionary: Dictionary, limits: Envelope | None) -> None:
        self._channels, self._limits = dictionary.channels, limits
        self._trim, self._at, self._share = b"", -1, 0.0
        self._noted = np.full(len(dictionary), np.nan)
        self.doubts: tuple[Doubt, ...] = ()
        self.changes = deque[TrimChange](maxlen=CHANGES_KEPT)
        self.far: Mapping[str, int] = {}

    def note(self, t: float, trim: Array, *, by_hand: bool = False) -> None:
        """The trim from the sample of t [s] on, (n_channels,), NaN where unknown."""
        if self._limits is None or self._trim == (known := trim.tobytes()):
            return
        self._trim = known
        share = self._share_of(trim, self._limits)
        self.far = self._far_by(share)
        self._note_changes(t, trim, self._limits, by_hand)
        if self.doubts and abs(share.item(self._at) - self._share) < SETTLED:
            return
        self._at = at = int(share.argmax())
        self._share = share.item(at)
        self.doubts = ()
        if self._share >= NOTABLE:
            level = Level.CAUTION if self._share >= FAR else Level.ADVISORY
            channel = self._channels[at]
            reason = (
                f"{channel.symbol} counts from its trim of {channel.read(trim.item(at))}, "
                f"{100 * self._share:.0f} % of the limit: check its zero, or fly back to trim"
            )
            self.doubts = (Doubt("trim", level, t, reason, (channel.key,)),)

    def note_all(self, t: Array, trims: Array) -> None:
        """The trims (n, n_channels) of a whole flight, each from t (n,) [s] on."""
        at = 0
        while self._limits is not None and at < len(t):
            changed = self._changed(trims[at : at + LOOKED_AHEAD], self._limits).any(axis=1)
            if not changed.any():
                at += LOOKED_AHEAD
                continue
            at += int(changed.argmax())
            self.note(t.item(at), trims[at])
            at += 1

    def far_at(self, trim: Array) -> Mapping[str, int]:
        """Channels, by key, whose trim (n_channels,) is a notable share of their limit."""
        return {} if self._limits is None else self._far_by(self._share_of(trim, self._limits))

    def _far_by(self, share: Array) -> Mapping[str, int]:
        return {self._channels[c].key: c for c in np.flatnonzero(share >= NOTABLE).tolist()}

    @staticmethod
    def _share_of(trim: Array, limits: Envelope) -> Array:
        return np.nan_to_num(limits.shares(limits.rest + trim))

    def _changed(self, trim: Array, limits: Envelope) -> Flags:
        """(..., n_channels) whether it has changed notably since it was noted."""
        moved = limits.shares(limits.rest + trim - self._noted) >= SETTLED
        return (moved | (np.isnan(trim) != np.isnan(self._noted))) & limits.limited

    def _note_changes(self, t: float, trim: Array, limits: Envelope, by_hand: bool) -> None:
        for c in np.flatnonzero(self._changed(trim, limits)).tolist():
            channel, value = self._channels[c], trim.item(c)
            self._noted[c] = value
            if channel.reference == "trim":
                known = None if isnan(value) else value
                is_far = channel.key in self.far
                self.changes.append(TrimChange(t, channel.key, known, by_hand, is_far))


class _Recent:
    """The newest samples, and what noise and resolution make of a channel."""

    def __init__(self, n_channels: int) -> None:
        self.state = NewestSamples(
            np.empty(2 * KEPT),
            np.empty((2 * KEPT, n_channels)),
            np.full(4, -np.inf),
            np.zeros(3, np.int64),
            np.zeros(n_channels, np.int64),
            np.zeros((n_channels, kernel.N_RUN)),
            np.empty(REMEMBERED),
            np.empty(REMEMBERED, np.int64),
            np.empty((REMEMBERED, n_channels)),
        )
        self._measured = -np.inf
        self.uncertainty = np.zeros(n_channels)
        """(n_channels,) extent of a channel that is noise and resolution alone"""
        self.is_measured = False
        self._roughness = np.empty(n_channels), np.empty(n_channels)
        self._arrive = entry(kernel.arrive, self.state, 0.0, np.empty(n_channels), 0)
        about = self.state.t, self.state.y, self.n
        self._fill_roughness = entry(kernel.roughness, *about, *self._roughness)

    @property
    def n(self) -> int:
        """Samples that are looked at."""
        return self.state.counts.item(kernel.N_RECENT)

    def push(self, t: float, y: Array, source: int) -> tuple[int, int]:
        """Add a sample. Returns its flags, and the slot of the sample of the same time, or -1."""
        flags, repeated = self._arrive(self.state, t, np.ascontiguousarray(y), source)
        if flags & LOOKS and t - self._measured >= MEASURE_S:
            self._measured = t
            self.measure()
        return flags, repeated

    def forget_times(self) -> None:
        self.state.counts[kernel.N_KNOWN], self.state.times[kernel.LATEST] = 0, -np.inf

    def window(self, seconds: float) -> Array:
        """(n, n_channels) samples of the last seconds."""
        t, newest = self.state.t[: self.n], self.state.times.item(kernel.NEWEST)
        first = int(t.searchsorted(newest - seconds - 1e-9))
        return self.state.y[max(first, self.n - KEPT) : self.n]

    def measure(self) -> None:
        n = self._fill_roughness(self.state.t, self.state.y, self.n, *self._roughness)
        if n < FIRST_LOOK:
            return
        bends, steps = self._roughness
        noise = (1.0 + FEW / (n - 2)) * bends / (0.6745 * np.sqrt(6.0))
        self.uncertainty[:] = np.fmax(NOISES * noise, RESOLUTIONS * steps)
        self.is_measured = True


class _Frozen:
    """Identical samples: a caution if the seconds before had noise, else an advisory.

    A single channel whose value lasts for longer than ever: a caution. A control may be held: an
    advisory, unless it had noise before and the aircraft moves meanwhile; at its stop it is held.
    """

    def __init__(self, recent: _Recent, dictionary: Dictionary) -> None:
        self._recent, self._dictionary = recent, dictionary
        self.measured = -np.inf
        self._n_measured = self._n_turning = 0
        self._varies = True
        n = len(dictionary)
        roles = dictionary.of_role("output"), dictionary.of_role("control")
        self._outputs, self._controls = (np.array(role, np.int64) for role in roles)
        self._looked = -np.inf
        self._seconds = np.zeros((2, n), np.int64)
        """(2, n_channels) seconds in which a channel changed, and in which that was noise"""
        self._sure = np.full(n, np.nan)
        """(n_channels,) since when a control is surely frozen [s]"""

    def push(self, t: float, y: Array, *, is_same: bool, holds: bool) -> Doubt | None:
        """is_same: whether a sample is identical to the last one.   holds: a channel is frozen."""
        if not is_same:
            if t - self.measured >= REACTS_S:
                self._measure(t)
            return self._of_channels(t) if holds else None
        state = self._recent.state
        since, n = state.times.item(kernel.SINCE), state.counts.item(kernel.N_SAME)
        if t - since <= FROZEN_S or n <= FEWEST or np.isnan(y).all():
            return None
        level = Level.CAUTION if self._has_noise else Level.ADVISORY
        return Doubt(
            "frozen",
            level,
            since,
            f"all channels frozen since {since:.2f} s",
            self._dictionary.keys,
        )

    def _of_channels(self, t: float) -> Doubt | None:
        runs = self._recent.state.runs
        since, frozen = runs[:, kernel.SINCE_T], runs[:, kernel.IS_FROZEN] > 0.0
        frozen[self._controls] &= runs[self._controls, kernel.IS_AT_STOP] == 0.0
        if not frozen.any():
            return None
        if not 0.0 <= t - self._looked < LOOK_S:
            self._looked = t
            self._note_sure(since, frozen)
        is_sure = frozen & (since == self._sure)
        is_sure[self._outputs] = frozen[self._outputs]
        level = Level.CAUTION if is_sure.any() else Level.ADVISORY
        (at,) = np.nonzero(is_sure if is_sure.any() else frozen)
        channels = [self._dictionary.channels[c] for c in at.tolist()]
        names, begin = ", ".join(channel.symbol for channel in channels), since[at].min().item()
        reason = f"{names} frozen since {begin:.2f} s: check the sensor"
        return Doubt("frozen", level, begin, reason, tuple(channel.key for channel in channels))

    def _note_sure(self, since: Array, frozen: Flags) -> None:
        held = self._controls[(frozen & (since != self._sure))[self._controls]]
        changed, noisy = self._seconds[:, held]
        held = held[(noisy > 0) & (noisy >= NOISY * changed)]
        if len(held) and self._moves():
            self._sure[held] = since[held]

    def _moves(self) -> bool:
        """Whether a response moves further than its noise, and than at rest."""
        y = self._recent.window(REACTS_S)[:, self._outputs]
        moved = np.fmax.reduce(y, axis=0) - np.fmin.reduce(y, axis=0)
        if not (moved > RESTS).any():
            return False
        self._recent.measure()
        moves = moved > np.fmax(self._recent.uncertainty[self._outputs], RESTS)
        return self._recent.is_measured and bool(moves.any())

    @property
    def _has_noise(self) -> bool:
        return self._varies and 0 < self._n_measured <= 2 * self._n_turning

    def _measure(self, t: float) -> None:
        """Measure the second before this change."""
        is_first, self.measured = self.measured == -np.inf, t
        changes = np.diff(self._recent.window(REACTS_S), axis=0)
        if is_first or len(changes) < FEWEST:
            return
        self._n_measured += 1
        varies = changes != 0.0
        self._varies &= bool(varies.any(axis=1).mean() >= VARIES)
        products = changes[1:] * changes[:-1]
        n_turns, n = np.count_nonzero(products < 0.0, axis=0), np.count_nonzero(products, axis=0)
        turns = n_turns > REVERSES * np.maximum(n, FEWEST)
        self._n_turning += bool(turns.any())
        n_varies = np.count_nonzero(varies, axis=0)
        self._seconds += n_varies > 0, turns & (n_varies >= VARIES * len(varies))


class FrozenPart(NamedTuple):
    """When channels of a source were frozen [s], by their keys, and why in words."""

    start: float
    end: float
    channels: tuple[str, ...]
    reason: str


def frozen_parts(dictionary: Dictionary, t: Array, y: Array) -> tuple[FrozenPart, ...]:
    """The cautions of frozen channels in a whole flight.

    t: (n,) flight times [s].   y: (n, n_channels). Both in order of arrival.
    """
    recent, parts = _Recent(len(dictionary)), dict[tuple[float, tuple[str, ...]], FrozenPart]()
    frozen, t, y, n = (
        _Frozen(recent, dictionary),
        np.ascontiguousarray(t),
        np.ascontiguousarray(y),
        0,
    )
    while n < len(t):
        n, flags = kernel.arrive_together(recent.state, t, y, n, frozen.measured)
        at, about = t.item(n - 1), {"is_same": bool(flags & SAME), "holds": bool(flags & HOLDS)}
        doubt = frozen.push(at, y[n - 1], **about)
        if doubt is not None and doubt.level is Level.CAUTION:
            key = doubt.t, doubt.channels
            parts[key] = FrozenPart(doubt.t, at, doubt.channels, doubt.reason)
    return tuple(parts.values())


class _Contradictions:
    """Samples of one time that differ. agrees: (n_channels,) differences that are none.

    A repeated time counts once the source goes on: a source that is set back repeats times as well.
    """

    def __init__(self, recent: _Recent, agrees: Array, channels: Sequence[Channel]) -> None:
        self._recent, self._agrees, self._channels = recent, agrees, channels
        self._seen = -np.inf
        self._waiting: Doubt | None = None
        self._doubt: Doubt | None = None

    def restart(self) -> None:
        self._waiting = None

    def push(self, arrived: float, *, goes_on: bool) -> Doubt | None:
        """goes_on: whether a sample is the latest one."""
        if goes_on and self._waiting is not None:
            self._doubt, self._waiting = self._doubt or self._waiting, None
        if self._doubt is not None and arrived - self._seen > CONTRADICTS_S:
            self._doubt = None
        return self._doubt

    def compare(
        self, arrived: float, t: float, y: Array, slot: int, source: int, sources: Sequence[str]
    ) -> None:
        """Compare a sample with the known one of its time, in a slot of `NewestSamples`."""
        first = self._recent.state.known[slot]
        excess = np.abs(y - first) - np.fmax(self._agrees, self._recent.uncertainty)
        if not self._recent.is_measured or not (excess > 0.0).any():
            return
        c, self._seen = int(np.nanargmax(excess)), arrived
        if self._doubt is None and self._waiting is None:
            channel = self._channels[c]
            values = f"{channel.symbol} {channel.read(first[c])}", channel.read(y[c])
            reason = f"samples of {t:.2f} s contradict: {values[0]} and {values[1]}"
            first_source = self._recent.state.sources.item(slot)
            if source != first_source:
                reason = (
                    f"two sources contradict at {t:.2f} s: {values[0]} from "
                    f"{sources[first_source]}, {values[1]} from {sources[source]}: end one of them"
                )
            self._waiting = Doubt("contradiction", Level.CAUTION, t, reason, (channel.key,))


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
        about = self._rule, self._state, recent.state.t, recent.state.y, recent.n
        return *about, recent.uncertainty, self._since

    def push(self, t: float, looks: bool, in_manoeuvre: bool) -> Doubt | None:
        if in_manoeuvre:
            self._state.moved[0], self._since = t, np.nan
        elif looks and self._applies:
            self._since = self._look(*self._arguments)
        if isnan(self._since):
            return None
        return Doubt("surfaces", Level.CAUTION, self._since, self._reason)
