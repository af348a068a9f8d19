"""How good the times and the channels of a recording are, in numbers, marks and sentences."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.telemetry.plausibility import BOUNDS
from app.telemetry.targets import TARGETS
from core.types import Array

MOST_FAULTS = 500
"""More faults of a kind than this are joined where they are close."""


@dataclass(frozen=True)
class Fault:
    """An interval of a recording in which times or values are at fault [s].

    kind: gap, clock, repeated, reordered, implausible:<channel>, missing:<channel> or
    frozen:<channel>.
    """

    start: float
    end: float
    kind: str


@dataclass(frozen=True)
class ClockQuality:
    """The times that some channels share.

    n_rows: as recorded.   start, end, step, jitter: [s] after repair; step is the mean between
    gaps, jitter the root mean square of its deviations from the median.   rate: [Hz].
    n_gaps, gap_time, longest_gap, longest_gap_at: neighbours over 1.5 median steps apart [s].
    bad_times: rows without a time.   repeated: rows with a time that was there before, of which
    `conflicting` with other values; the first stays.   reordered: rows that came late.
    backward: recorded newest first.   wraps: names of the counters that wrapped.   sets: times
    before and after the clock was set [s].   lost: rows removed for that.   rounded_to: resolution
    of the times in the file, where they were restored to an even clock [s].
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
        """What was done to the times."""
        done = [*self._order_repairs(), *self._row_repairs()]
        return [f"Time of {', '.join(self.channels)}: {'; '.join(done)}."] if done else []

    def _order_repairs(self) -> Iterator[str]:
        if self.bad_times:
            yield f"{_rows(self.bad_times)} without a time removed"
        if self.backward:
            yield "rows reversed, as they were recorded newest first"
        for name in dict.fromkeys(self.wraps):
            times = self.wraps.count(name)
            yield f"continued beyond {name}" + (f", {times} times" if times > 1 else "")
        if self.sets:
            where = ", ".join(f"from {a:.10g} s to {b:.10g} s" for a, b in self.sets[:3])
            more = f" and {len(self.sets) - 3} times more" if len(self.sets) > 3 else ""
            yield (
                f"the clock jumps {where}{more}; {_rows(self.lost)} with an ambiguous time removed"
            )
        elif self.lost:
            yield f"{_rows(self.lost)} removed, at times that another clock of the file gives twice"

    def _row_repairs(self) -> Iterator[str]:
        if self.reordered:
            yield f"{_rows(self.reordered)} recorded late, sorted into the order of time"
        if self.repeated:
            but = f" ({self.conflicting} with other values)" if self.conflicting else ""
            yield (
                f"{_rows(self.repeated)} with a repeated time removed{but}, the first of each "
                "time retained"
            )
        if self.rounded_to:
            yield (
                f"times rounded to {self.rounded_to:.3g} s in the file, restored to an even clock "
                f"of {self.rate:.6g} Hz"
            )

    def describe(self) -> list[str]:
        """Its rate, what was repaired, its gaps."""
        about = f"{', '.join(self.channels)}: {_rows(self.n_rows)}"
        jitter = f", jitter {self.jitter:.2g} s rms" if self.jitter > 1e-4 * self.step else ""
        lines = [
            f"{about} at {self.rate:.6g} Hz{jitter}, from {self.start:.10g} to {self.end:.10g} s.",
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
    """The values of a channel.

    missing: share of its rows without a value.   longest_missing: [s], besides gaps of its clock.
    rate: [Hz] of its values.   held: rows that each value is repeated for, 1 where it is not.
    constant: it never changes.   frozen: longest time without a change after it had moved [s].
    implausible: rows with a value that no aircraft can show, which is taken as missing; the largest
    of them and its time.
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
        """What was done to the values."""
        if not self.implausible:
            return []
        read = TARGETS[self.key].read
        return [
            f"{self.key} exceeds {read(BOUNDS[self.key])}, the most that is plausible, in "
            f"{_rows(self.implausible)} (up to {read(self.largest)}, at "
            f"{self.largest_at:.10g} s), taken as missing: check its unit."
        ]

    def describe(self) -> list[str]:
        """What a person should know before trusting it."""
        lines = self.repairs()
        if self.missing == 1.0:
            return [*lines, f"{self.key} has no value."]
        if self.missing:
            longest = self.longest_missing
            most = f" (for up to {longest:.4g} s)" if longest else ""
            lines.append(
                f"{self.key} has no value in {self.missing:.2%} of its rows{most}; its values come "
                f"at {self.rate:.4g} Hz."
            )
        if self.constant:
            lines.append(f"{self.key} never changes: check that its sensor is connected.")
        if self.held > 1:
            lines.append(
                f"{self.key} repeats each value {self.held} times, so it was measured at "
                f"{self.rate / self.held:.4g} Hz."
            )
        if self.frozen:
            lines.append(
                f"{self.key} is constant to the last bit for {self.frozen:.4g} s from "
                f"{self.frozen_at:.10g} s on, after it had moved: check its sensor."
            )
        return lines


@dataclass(frozen=True)
class Quality:
    """Everything about the times and values of a recording, as plain data.

    faults: to mark on a strip, in the order of kind and time.
    """

    clocks: tuple[ClockQuality, ...]
    channels: tuple[ChannelQuality, ...]
    faults: tuple[Fault, ...] = ()

    def sentences(self) -> list[str]:
        """All of it for a report."""
        return [line for part in (*self.clocks, *self.channels) for line in part.describe()]


def faults(kind: str, starts: Array, ends: Array, duration: float) -> tuple[Fault, ...]:
    """Faults of a kind in the order of time, joined where they touch or are too many to draw.

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


def _count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
