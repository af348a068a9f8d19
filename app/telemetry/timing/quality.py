"""Quality of the times and channels of a recording: numbers, faults and sentences."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.telemetry.targets import BOUNDS, TARGETS
from core.types import Array

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
            yield f"{_rows(self.bad_times)} without a time removed"
        if self.backward:
            yield "rows reversed, because they were recorded newest first"
        for name in dict.fromkeys(self.wraps):
            times = self.wraps.count(name)
            yield f"continued beyond {name}" + (f", {times} times" if times > 1 else "")
        if self.sets:
            jumps = ", ".join(f"from {a:.10g} s to {b:.10g} s" for a, b in self.sets[:3])
            more = f" and {len(self.sets) - 3} more times" if len(self.sets) > 3 else ""
            yield (f"clock jumps {jumps}{more}; {_rows(self.lost)} with an ambiguous time removed")
        elif self.lost:
            yield f"{_rows(self.lost)} removed, because another clock repeats their times"

    def _row_repairs(self) -> Iterator[str]:
        if self.reordered:
            yield f"{_rows(self.reordered)} recorded out of order, sorted by time"
        if self.repeated:
            conflicts = f" ({self.conflicting} with other values)" if self.conflicting else ""
            yield f"{_rows(self.repeated)} with a repeated time removed{conflicts}"
        if self.rounded_to:
            yield (
                f"times rounded to {self.rounded_to:.3g} s in the file, restored to an even rate "
                f"of {self.rate:.6g} Hz"
            )

    def describe(self) -> list[str]:
        rows = f"{', '.join(self.channels)}: {_rows(self.n_rows)}"
        jitter = f", jitter {self.jitter:.2g} s rms" if self.jitter > 1e-4 * self.step else ""
        lines = [
            f"{rows} at {self.rate:.6g} Hz{jitter}, from {self.start:.10g} to {self.end:.10g} s.",
            *self.repairs(),
        ]
        if self.n_gaps:
            lines.append(
                f"{', '.join(self.channels)}: {_count(self.n_gaps, 'gap')}, {self.gap_time:.4g} s "
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
        read = TARGETS[self.key].read
        return [
            f"{self.key} exceeds the plausible {read(BOUNDS[self.key])} in "
            f"{_rows(self.implausible)} (up to {read(self.largest)}, at "
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
        """Sentences for a report."""
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


def _rows(n: int) -> str:
    return _count(n, "row")


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
