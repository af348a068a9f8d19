"""The judge of limits: what exceeds them, when it began, its worst value and when it ended.

A value equal to its limit exceeds it; a missing value does not. Limits may change in time. The
worst value of a channel is one from trim if any of these exceeds a limit, else one as recorded. A
value as recorded that is further beyond is named beside it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite, isnan
from operator import attrgetter
from typing import Literal, NamedTuple

import numpy as np

from core.limits.limits import Envelope
from core.types import Array, Indices

SAME_TIME = 1e-6
"""[s] Times that differ by less are equal: a clock may count from 1970."""

Judged = Literal["from_trim", "recorded", "both"]
NOT_PLAUSIBLE = "beyond any plausible value: check the sensor"
"""Doubt of an exceedance by a value that no aircraft can reach."""
TRIM_UNKNOWN = "trim unknown"
"""Doubt of an exceedance as recorded, of which it is unknown whether it is one from trim."""
DOUBTS = NOT_PLAUSIBLE, TRIM_UNKNOWN


@dataclass(frozen=True, slots=True)
class MeasuredExceedance:
    """A measured exceedance of a limit; SI units, N_y in g."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    channel: str
    """key of the channel furthest beyond its limit"""
    value: float
    limit: float
    judged: Judged
    """value that exceeds it: `from_trim`, which the monitor and every verdict use,
    as `recorded`, or both"""
    doubt: str = ""
    """of one as recorded: beyond any plausible value, or trim unknown; else empty"""


class Exceeded(NamedTuple):
    """A measured exceedance and the time of the sample that the sensor gave [s].

    arrived: time at which it arrived [s], on another clock; None where that is not known.
    """

    t: float
    measured: MeasuredExceedance
    arrived: float | None = None


@dataclass(slots=True)
class ChannelExceedances:
    """The measured exceedances of a flight in one channel; SI units, N_y in g."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    channel: str
    """key"""
    n: int
    """number of exceedances"""
    first_t: float
    """start of the first one [s]"""
    last_t: float
    """start of the newest one [s]"""
    worst: float
    """value furthest beyond the limit in force then: from trim, or as recorded if none is"""
    worst_t: float
    """[s]"""
    limit: float
    """limit that the worst one exceeds"""
    recorded: float | None = None
    """worst value as recorded if it is further beyond than one from trim; else null"""
    recorded_t: float | None = None
    """[s]"""


@dataclass(slots=True)
class LatchedExceedance:
    """An exceedance that its strip shows until it is acknowledged and has ended."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    channel: str
    """key"""
    t: float
    """first sample beyond the limit [s]"""
    value: float
    """largest value from trim since, as recorded if none is; in the channel's `unit`"""
    over: bool
    """whether the newest sample exceeds the limit"""
    acknowledged: bool
    recorded: float | None = None
    """largest value as recorded in this exceedance if it is further beyond; else null"""
    skipped: bool = False
    """whether a seek passed its samples, so its largest value is not known"""
    as_recorded: bool = False
    """whether `value` is as recorded"""


def beyond(value: Array, low: Array | float, high: Array | float) -> Indices:
    """Samples of one channel that exceed a limit.   value: (n,).   low, high: (n,) or one."""
    return np.flatnonzero(np.isfinite(value) & ~((value > low) & (value < high)))


def exceedance(
    keys: Sequence[str], limits: Envelope | None, y: Array, recorded: Array
) -> MeasuredExceedance | None:
    """The limit that a sample exceeds from trim, as recorded, or both; None if it exceeds none.

    keys: of the channels.   limits: None if unknown.   y: (n_channels,) from trim.
    recorded: (n_channels,) including trim.
    With several channels beyond their limits, the result names the furthest one.
    """
    if limits is None:
        return None
    if limits.exceeds(y):
        judged = "both" if limits.exceeds(recorded) else "from_trim"
        return _furthest(keys, limits, y, judged)
    if recorded is y or not limits.exceeds(recorded):
        return None
    return _furthest(keys, limits, recorded, "recorded")


def exceeded_at(
    t: float, keys: Sequence[str], limits: Envelope | None, y: Array, recorded: Array
) -> Exceeded | None:
    """The limit that a plausible sample at t [s] exceeds, see `exceedance`."""
    measured = exceedance(keys, limits, y, recorded)
    if measured is None:
        return None
    is_known = measured.judged != "recorded" or isfinite(y[keys.index(measured.channel)])
    return Exceeded(t, measured if is_known else replace(measured, doubt=TRIM_UNKNOWN))


def _furthest(
    keys: Sequence[str], limits: Envelope, y: Array, judged: Judged
) -> MeasuredExceedance:
    with np.errstate(over="ignore"):  # a sensor may send the largest of numbers
        worst = int(np.nan_to_num(limits.shares(y)).argmax())
    value = float(y[worst])
    return MeasuredExceedance(keys[worst], value, limits.exceeded(worst, value), judged)


class _Beyond(NamedTuple):
    """A value beyond a limit at t [s]; from trim, or as recorded."""

    t: float
    value: float
    limit: float
    from_trim: bool


@dataclass(slots=True)
class _Interval:
    """From the first to the last sample of an exceedance [s].

    from_trim: first time [s] and largest value of its samples from trim.
    recorded: largest value of its samples as recorded.
    """

    start: float
    end: float
    acknowledged: bool = False
    from_trim: tuple[float, float] | None = None
    recorded: float | None = None

    @property
    def is_as_recorded(self) -> bool:
        """Whether its first sample is beyond the limit as recorded only."""
        return self.from_trim is None or self.from_trim[0] > self.start

    def has(self, t: float, near: float) -> bool:
        return self.start - near <= t <= self.end + near


class Exceedances:
    """The measured exceedances of a flight per channel, and those that the strips latch.

    rest: value of each channel in trimmed flight, by key in the order of a sample.
    near: [s] received samples beyond a limit that are no further apart are one exceedance, in
    whatever order they are added. They give its times and values; a sample of the grid near them
    adds none. 0 where no sample is received but those of the grid.
    """

    def __init__(self, rest: Mapping[str, float], near: float = 0.0) -> None:
        self._rest, self._near = rest, near
        self._index = {key: c for c, key in enumerate(rest)}
        self._of: dict[str, ChannelExceedances] = {}
        self._worst: dict[tuple[str, bool], _Beyond] = {}
        self._intervals: dict[str, list[_Interval]] = {}
        self._current: dict[str, _Interval] = {}
        self._over: set[str] = set()
        self._latched: dict[str, LatchedExceedance] = {}
        self._is_over_any = False

    @property
    def of_channels(self) -> list[ChannelExceedances]:
        return sorted(self._of.values(), key=attrgetter("first_t"))

    @property
    def first_t(self) -> float | None:
        """Start of the first exceedance [s]; None for none."""
        return min((each.first_t for each in self._of.values()), default=None)

    @property
    def is_first_as_recorded(self) -> bool:
        """Whether the first exceedance is one as recorded, not from trim."""
        t = self.first_t
        channels = (key for key, of_channel in self._of.items() if of_channel.first_t == t)
        first = (each for key in channels for each in self._intervals[key] if each.start == t)
        return t is not None and all(each.is_as_recorded for each in first)

    @property
    def latched(self) -> list[LatchedExceedance]:
        return [replace(latched) for latched in self._latched.values()]

    @property
    def over(self) -> list[str]:
        """Channels that the newest sample exceeds."""
        return sorted(self._over)

    def restart(self) -> None:
        self._over.clear()
        self._latched = {key: each for key, each in self._latched.items() if each.skipped}
        self._is_over_any = False

    def update(
        self,
        t: float,
        y: Array,
        limits: Envelope | None,
        named: MeasuredExceedance | None,
        recorded: Array | None = None,
    ) -> None:
        """Add a sample of the grid.

        t: of its exceedance if it has one [s].   y: (n_channels,) from trim, NaN where unknown.
        named: its exceedance, or one since the last sample.   recorded: y including trim.
        """
        if named is None and not self._is_over_any:
            return
        from_trim = self._beyond(y, limits)
        values = self._values(t, named, from_trim, recorded, limits)
        for key, beyond in values.items():
            interval = self._interval(key, t) if self._near else None
            if interval is None:
                self._note(key, beyond)
            else:
                interval.end = max(interval.end, t)
        self._over = set(values)
        self._latch(t, values, y if recorded is None else recorded)
        self._is_over_any = bool(self._over) or any(
            latched.over for latched in self._latched.values()
        )

    def add(
        self,
        exceeded: Exceeded,
        y: Array,
        limits: Envelope | None = None,
        recorded: Array | None = None,
    ) -> None:
        """Add a received sample beyond a limit, which may not reach the grid. See `update`."""
        t, named, _ = exceeded
        values = self._values(t, named, self._beyond(y, limits), recorded, limits)
        for key, beyond in values.items():
            self._note(key, beyond)

    def _values(
        self,
        t: float,
        named: MeasuredExceedance | None,
        from_trim: dict[str, tuple[float, float]],
        recorded: Array | None,
        limits: Envelope | None,
    ) -> dict[str, list[_Beyond]]:
        """The values of each channel that a sample exceeds, one from trim first."""
        is_trimmed = named is None or named.judged != "recorded"
        first = {} if named is None else {named.channel: (named.value, named.limit)}
        values = {
            key: [_Beyond(t, value, limit, is_trimmed)]
            for key, (value, limit) in (first | from_trim).items()
        }
        if is_trimmed and recorded is not None:
            for key, (value, limit) in self._beyond(recorded, limits).items():
                if key in values:
                    values[key].append(_Beyond(t, value, limit, from_trim=False))
        return values

    def _beyond(self, y: Array, limits: Envelope | None) -> dict[str, tuple[float, float]]:
        """Value and limit of each channel beyond one."""
        if limits is None:
            return {}
        samples = zip(self._rest, y.tolist(), limits.low, limits.high, strict=True)
        return {
            key: (value, limits.exceeded(c, value))
            for c, (key, value, low, high) in enumerate(samples)
            if value <= low or value >= high
        }

    def pass_by(self, exceeded: Exceeded, goes_on: bool = False) -> None:
        """Add an exceedance that a seek passes; its strip shows that its values were skipped.

        goes_on: it lasts to the sample sought, which then starts no new one.
        """
        t, named, _ = exceeded
        self._note(
            named.channel, [_Beyond(t, named.value, named.limit, named.judged != "recorded")]
        )
        if not self._interval_at(named.channel, t).acknowledged:
            skipped = LatchedExceedance(named.channel, t, named.value, False, False, skipped=True)
            skipped.as_recorded = named.judged == "recorded"
            self._latched.setdefault(named.channel, skipped)
        if goes_on:
            self._over.add(named.channel)
            self._is_over_any = True
        else:
            self._over.discard(named.channel)

    def start_of(self, key: str, t: float) -> float:
        """Start of the exceedance of a channel at t [s]."""
        return self._interval_at(key, t).start

    def _interval_at(self, key: str, t: float) -> _Interval:
        known = (i for i in self._intervals.get(key, ()) if i.has(t, self._near))
        return next(known, _Interval(t, t))

    def acknowledge(self) -> None:
        """Acknowledge all; those that have ended are no longer latched."""
        for key, latched in list(self._latched.items()):
            self._interval_at(key, latched.t).acknowledged = True
            if latched.over:
                latched.acknowledged = True
            else:
                del self._latched[key]

    def _note(self, key: str, values: Sequence[_Beyond]) -> None:
        """values: of one sample."""
        t, value, limit, is_trimmed = values[0]
        begins = self._begins(key, t)
        known = self._of.setdefault(key, ChannelExceedances(key, 0, t, t, value, t, limit))
        known.n += begins
        known.first_t = min(known.first_t, t)
        known.last_t = max(known.last_t, t) if begins else known.last_t
        interval = self._current[key]
        if is_trimmed:
            since, largest = interval.from_trim or (t, value)
            interval.from_trim = min(since, t), self._further(key, largest, value)
        for each in values:
            if not each.from_trim:
                known_so_far = each.value if interval.recorded is None else interval.recorded
                interval.recorded = self._further(key, known_so_far, each.value)
            of = key, each.from_trim
            self._worst[of] = max(self._worst.get(of, each), each, key=partial(self._share, key))
        raw = self._worst.get((key, False))
        worst = self._worst.get((key, True), raw) or values[0]
        known.worst_t, known.worst, known.limit, _ = worst
        if raw is not None and self._share(key, raw) > self._share(key, worst):
            known.recorded_t, known.recorded = raw.t, raw.value
        else:
            known.recorded_t = known.recorded = None

    def _begins(self, key: str, t: float) -> bool:
        """Whether a sample begins an exceedance; else the one that it belongs to is extended."""
        interval = self._interval(key, t)
        if is_new := interval is None:
            self._intervals.setdefault(key, []).append(interval := _Interval(t, t))
        interval.start, interval.end = min(interval.start, t), max(interval.end, t)
        self._current[key] = interval
        return is_new

    def _interval(self, key: str, t: float) -> _Interval | None:
        """The exceedance of a channel that a sample at t [s] belongs to; None for a new one."""
        if key in self._over and (current := self._current.get(key)) is not None:
            return current
        known = reversed(self._intervals.get(key, []))
        return next((each for each in known if each.has(t, self._near)), None)

    def _share(self, key: str, beyond: _Beyond) -> float:
        """How much of the way from rest to the limit."""
        rest = self._rest.get(key, 0.0)
        return abs((beyond.value - rest) / (beyond.limit - rest))

    def _further(self, key: str, *values: float) -> float:
        return max(values, key=lambda value: abs(value - self._rest[key]))

    def _latch(self, t: float, over: Mapping[str, Sequence[_Beyond]], recorded: Array) -> None:
        for key, (first, *_) in over.items():
            at = self._interval_at(key, t)
            latched = self._latched.get(key)
            if latched is None:
                latched = LatchedExceedance(key, at.start, first.value, True, at.acknowledged)
                latched.as_recorded = not first.from_trim
                self._latched[key] = latched
            latched.over, latched.skipped, latched.t = True, False, min(latched.t, at.start)
        for key in [key for key in self._latched if key not in over]:
            if isnan(recorded.item(self._index[key])):
                continue
            if self._latched[key].acknowledged:
                del self._latched[key]
            else:
                self._latched[key].over = False
        for latched in self._latched.values():
            self._take_peaks(latched, self._current[latched.channel])

    def _take_peaks(self, latched: LatchedExceedance, newest: _Interval) -> None:
        """The largest values since it was latched; those of its newest interval may have grown."""
        key, peaks = latched.channel, [newest.recorded, latched.recorded]
        if newest.from_trim is not None and latched.as_recorded:
            peaks.append(latched.value)
            latched.value, latched.as_recorded = newest.from_trim[1], False
        elif newest.from_trim is not None:
            latched.value = self._further(key, latched.value, newest.from_trim[1])
        raw = self._further(key, latched.value, *(peak for peak in peaks if peak is not None))
        if latched.as_recorded:
            latched.value, latched.recorded = raw, None
        else:
            latched.recorded = raw if raw != latched.value else None
