"""Quality of the times and channels of a recording: numbers, faults and sentences."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.telemetry.recording import GAP_RATIO
from app.telemetry.targets import BOUNDS, KNOWN
from core.counted import counted
from core.types import Array, Flags, Indices

MOST_FAULTS = 500
"""If there are more faults of a kind, close ones are joined."""


@dataclass(frozen=True)
class Fault:
    """An interval with faulty times or values [s].

    kind: gap, clock, repeated, reordered, implausible:<channel>, missing:<channel> or
    frozen:<channel>.
    """

    start: float
    end: float
    kind: str


@dataclass(frozen=True)
class ClockQuality:
    """Quality of times that some channels share.

    n_rows: as recorded.   start, end, step, jitter: [s] after repair; step is the mean without
    gaps, jitter the root mean square deviation of steps from the median.   rate: [Hz].
    n_gaps, gap_time, longest_gap, longest_gap_at: neighbours over 1.5 median steps apart [s].
    bad_times: rows without a time.   repeated: removed rows with a repeated time, `conflicting` of
    them with other values.   reordered: rows out of order.   backward: recorded newest first.
    wraps: names of the counters that wrapped.   sets: times before and after the clock was set [s].
    lost: rows removed for that.   rounded_to: resolution of the times in the file, if they were
    restored to an even clock [s].
    """

    channels: tuple[str, ...]
    n_rows: int
    start: float
    end: float
    step: float
    rate: float
    jitter: float
    n_gaps: int = 0
    gap_time: float = 0.0
    longest_gap: float = 0.0
    longest_gap_at: float = 0.0
    bad_times: int = 0
    repeated: int = 0
    conflicting: int = 0
    reordered: int = 0
    backward: bool = False
    wraps: tuple[str, ...] = ()
    sets: tuple[tuple[float, float], ...] = ()
    lost: int = 0
    rounded_to: float = 0.0

    def repairs(self) -> list[str]:
        repairs = [*self._order_repairs(), *self._row_repairs()]
        return [f"Time of {', '.join(self.channels)}: {'; '.join(repairs)}."] if repairs else []

    def _order_repairs(self) -> Iterator[str]:
        if self.bad_times:
            yield f"{counted(self.bad_times, 'row')} without a time removed"
        if self.backward:
            yield "rows reversed, because they were recorded newest first"
        for name in dict.fromkeys(self.wraps):
            times = self.wraps.count(name)
            yield f"continued beyond {name}" + (f", {times} times" if times > 1 else "")
        if self.sets:
            jumps = ", ".join(f"from {a:.10g} s to {b:.10g} s" for a, b in self.sets[:3])
            more = f" and {len(self.sets) - 3} more times" if len(self.sets) > 3 else ""
            yield (
                f"clock jumps {jumps}{more}; {counted(self.lost, 'row')} with an ambiguous time "
                "removed"
            )
        elif self.lost:
            yield f"{counted(self.lost, 'row')} removed, because another clock repeats their times"

    def _row_repairs(self) -> Iterator[str]:
        if self.reordered:
            yield f"{counted(self.reordered, 'row')} recorded out of order, sorted by time"
        if self.repeated:
            conflicts = f" ({self.conflicting} with other values)" if self.conflicting else ""
            yield f"{counted(self.repeated, 'row')} with a repeated time removed{conflicts}"
        if self.rounded_to:
            yield (
                f"times rounded to {self.rounded_to:.3g} s in the file, restored to an even rate "
                f"of {self.rate:.6g} Hz"
            )

    def describe(self) -> list[str]:
        rows = f"{', '.join(self.channels)}: {counted(self.n_rows, 'row')}"
        jitter = f", jitter {self.jitter:.2g} s rms" if self.jitter > 1e-4 * self.step else ""
        lines = [
            f"{rows} at {self.rate:.6g} Hz{jitter}, from {self.start:.10g} to {self.end:.10g} s.",
            *self.repairs(),
        ]
        if self.n_gaps:
            lines.append(
                f"{', '.join(self.channels)}: {counted(self.n_gaps, 'gap')}, {self.gap_time:.4g} s "
                f"in total, the longest {self.longest_gap:.4g} s at {self.longest_gap_at:.10g} s."
            )
        return lines


@dataclass(frozen=True)
class ChannelQuality:
    """Quality of the values of a channel.

    missing: share of rows without a value.   longest_missing: [s], besides gaps of its clock.
    rate: [Hz] of its values.   held: rows per value, 1 if values do not repeat.
    constant: whether it never changes.   frozen: longest time without a change after moving [s].
    implausible: rows with a value that no aircraft can reach, treated as missing.
    largest, largest_at: the largest of these values and its time [s].
    """

    key: str
    missing: float
    longest_missing: float
    rate: float
    held: int = 1
    constant: bool = False
    frozen: float = 0.0
    frozen_at: float = 0.0
    implausible: int = 0
    largest: float = 0.0
    largest_at: float = 0.0

    def repairs(self) -> list[str]:
        if not self.implausible:
            return []
        read = KNOWN[self.key].read
        return [
            f"{self.key} exceeds the plausible {read(BOUNDS[self.key])} in "
            f"{counted(self.implausible, 'row')} (up to {read(self.largest)}, at "
            f"{self.largest_at:.10g} s), treated as missing: check its unit."
        ]

    def describe(self) -> list[str]:
        lines = self.repairs()
        if self.missing == 1.0:
            return [*lines, f"{self.key} has no values."]
        if self.missing:
            longest = self.longest_missing
            most = f" (for up to {longest:.4g} s)" if longest else ""
            lines.append(
                f"{self.key} is missing in {self.missing:.2%} of its rows{most}; its rate is "
                f"{self.rate:.4g} Hz."
            )
        if self.constant:
            lines.append(f"{self.key} never changes: check that its sensor is connected.")
        if self.held > 1:
            lines.append(
                f"{self.key} repeats each value {self.held} times: it was measured at "
                f"{self.rate / self.held:.4g} Hz."
            )
        if self.frozen:
            lines.append(
                f"{self.key} is frozen for {self.frozen:.4g} s from {self.frozen_at:.10g} s: "
                "check its sensor."
            )
        return lines


@dataclass(frozen=True)
class Quality:
    """Quality of the times and values of a recording, as plain data.

    faults: marks for a strip chart, ordered by kind and time.
    """

    clocks: tuple[ClockQuality, ...]
    channels: tuple[ChannelQuality, ...]
    faults: tuple[Fault, ...] = ()

    def sentences(self) -> list[str]:
        return [line for part in (*self.clocks, *self.channels) for line in part.describe()]


def faults(kind: str, starts: Array, ends: Array, duration: float) -> tuple[Fault, ...]:
    """Faults of a kind in the order of time, joined if they touch or are too many to draw.

    starts, ends: (n,) [s].   duration: of the recording [s].
    """
    if not len(starts):
        return ()
    order = np.argsort(starts, kind="stable")
    starts, ends = starts[order], np.maximum.accumulate(ends[order])
    near = duration / MOST_FAULTS if len(starts) > MOST_FAULTS else 0.0
    apart = np.flatnonzero(starts[1:] > ends[:-1] + near)
    first, last = starts[[0, *(apart + 1)]], ends[[*apart, -1]]
    return tuple(Fault(a, b, kind) for a, b in zip(first.tolist(), last.tolist(), strict=True))


FROZEN = 2.0
"""A value is frozen if it is held at least this long [s]."""
FROZEN_RUNS = 20.0
"""And this many times longer than usual for the channel."""
FEWEST_RUNS = 20
"""Fewest changes of value that show how long values are held."""
ALIKE = 0.8
"""Share of values held for equally many rows that shows a slow sensor sampled fast."""


def channel_quality(
    key: str, t: Array, x: Array, step: float
) -> tuple[ChannelQuality, tuple[Fault, ...]]:
    """Quality and faults. t: (n >= 2,) increasing, usually by `step`.   x: (n,), NaN if missing."""
    finite = np.isfinite(x)
    n_finite = int(np.count_nonzero(finite))
    share = (len(x) - n_finite) / len(x)
    duration = float(t[-1] - t[0])
    if n_finite < 2:
        quality = ChannelQuality(key, share, duration, 0.0)
        return quality, (Fault(float(t[0]), float(t[-1]), f"missing:{key}"),)
    begin, end = t[:0], t[:0]
    if n_finite < len(x):
        step = float(np.median(np.diff(t[finite])))
        begin, end = _holes(t, finite, GAP_RATIO * step)
        t, x = t[finite], x[finite]
    runs, frozen = _runs(t, x)
    quality = ChannelQuality(
        key=key,
        missing=share,
        longest_missing=float((end - begin).max(initial=0.0)),
        rate=1.0 / step,
        held=_held(runs),
        constant=len(runs) == 1,
        frozen=float((frozen[1] - frozen[0]).max(initial=0.0)),
        frozen_at=float(frozen[0][(frozen[1] - frozen[0]).argmax()]) if len(frozen[0]) else 0.0,
    )
    missing = faults(f"missing:{key}", begin, end, duration)
    return quality, (*missing, *faults(f"frozen:{key}", *frozen, duration))


def _holes(t: Array, finite: Flags, limit: float) -> tuple[Array, Array]:
    """Begin and end of intervals without a value that are longer than `limit`."""
    known = np.flatnonzero(finite)
    before = np.concatenate([[0], known])
    after = np.concatenate([known, [len(t) - 1]])
    hole = (t[after] - t[before] > limit) & (after - before > 1)
    hole[0], hole[-1] = known[0] > 0, known[-1] < len(t) - 1
    return t[before[hole]], t[after[hole]]


def _runs(t: Array, x: Array) -> tuple[Indices, tuple[Array, Array]]:
    """Number of rows that each value is held; begin and end of frozen runs."""
    begin = np.concatenate([[0], np.flatnonzero(x[1:] != x[:-1]) + 1])
    rows = np.diff(begin, append=len(x))
    long = 1 + np.flatnonzero(rows[1:] >= FROZEN_RUNS)
    usual = (len(x) - rows[long]) / max(1, len(rows) - 1)
    first, last = t[begin[long]], t[begin[long] + rows[long] - 1]
    frozen = (last - first >= FROZEN) & (rows[long] >= FROZEN_RUNS * usual)
    return rows, (first[frozen], last[frozen])


def _held(runs: Indices) -> int:
    """Usual number of rows per value; 1 if it differs from value to value."""
    inner = runs[1:-1]
    if len(inner) < FEWEST_RUNS or inner.mean() < 2.0 * ALIKE:
        return 1
    usual = round(float(np.median(inner)))
    is_usual = np.abs(inner - usual) <= (1 if usual > 2 else 0)
    return usual if is_usual.mean() >= ALIKE else 1
