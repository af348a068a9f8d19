"""How good the times and the channels of a recording are, in numbers, spans and sentences."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from app.telemetry.plausibility import BOUNDS
from app.telemetry.targets import TARGETS

Array = npt.NDArray[np.float64]

MOST_SPANS = 500
"""More spans of a kind than this are joined where they are close."""


@dataclass(frozen=True)
class Span:
    """A stretch of time to mark [s]. kind: gap, clock, repeated, reordered, implausible:<channel>,
    missing:<channel> or frozen:<channel>.
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
    bad_times: rows without a time.   repeated: rows written twice, of which `conflicting` with
    other values; the first stays.   reordered: rows that came late.   backward: newest first.
    wraps: names of the clocks that started again.   sets: times before and after the clock was set
    [s].   lost: rows left out for that.   rounded_to: unit of times put back on an even clock [s].
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
        of = f"Time of {', '.join(self.channels)}: "
        done = []
        if self.bad_times:
            done.append(f"{_rows(self.bad_times)} without a time left out")
        if self.backward:
            done.append("rows turned round, they ran from the newest to the oldest")
        for name in dict.fromkeys(self.wraps):
            times = self.wraps.count(name)
            done.append(f"counted on over {name}" + (f", {times} times" if times > 1 else ""))
        if self.sets:
            where = ", ".join(f"from {a:.10g} s to {b:.10g} s" for a, b in self.sets[:3])
            more = f" and {len(self.sets) - 3} more" if len(self.sets) > 3 else ""
            done.append(
                f"the clock jumps {where}{more}; {_rows(self.lost)} without a certain time left out"
            )
        elif self.lost:
            done.append(f"{_rows(self.lost)} left out, at times that another clock gave twice")
        if self.reordered:
            done.append(f"{_rows(self.reordered)} that came late sorted in")
        if self.repeated:
            but = f" ({self.conflicting} with other values)" if self.conflicting else ""
            done.append(
                f"{_rows(self.repeated)} with a repeated time left out{but}, the first kept"
            )
        if self.rounded_to:
            done.append(
                f"rounded to {self.rounded_to:.3g} s in the file, put back on an even clock of "
                f"{self.rate:.6g} Hz"
            )
        return [f"{of}{'; '.join(done)}."] if done else []

    def describe(self) -> list[str]:
        """Its rate, what was repaired, its gaps."""
        about = f"{', '.join(self.channels)}: {_rows(self.n_rows)}"
        jitter = f", scattering by {self.jitter:.2g} s" if self.jitter > 1e-4 * self.step else ""
        lines = [
            f"{about} at {self.rate:.6g} Hz{jitter}, from {self.start:.10g} to {self.end:.10g} s.",
            *self.repairs(),
        ]
        if self.n_gaps:
            lines.append(
                f"{', '.join(self.channels)}: {_count(self.n_gaps, 'gap')}, {self.gap_time:.4g} s "
                f"in all, the longest {self.longest_gap:.4g} s at {self.longest_gap_at:.10g} s."
            )
        return lines


@dataclass(frozen=True)
class ChannelQuality:
    """The values of a channel.

    missing: share of its rows without a value.   longest_missing: [s], besides gaps of its clock.
    rate: [Hz] of its values.   held: rows that each value is repeated for, 1 where it is not.
    constant: it never changes.   frozen: longest time that it stands still having moved [s].
    implausible: rows with a value that no aircraft shows, which is taken as missing; the largest
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
        unit = TARGETS[self.key].unit
        taken = "it is" if self.implausible == 1 else "they are"
        return [
            f"{self.key} goes beyond {BOUNDS[self.key]:.4g} {unit}, which no aircraft shows, in "
            f"{_rows(self.implausible)} (to {self.largest:.4g} {unit}, at "
            f"{self.largest_at:.10g} s): {taken} taken as missing. Is its unit right?"
        ]

    def describe(self) -> list[str]:
        """What a person should know before trusting it."""
        lines = self.repairs()
        if self.missing == 1.0:
            return [*lines, f"{self.key} has no value."]
        if self.missing:
            most = f", {self.longest_missing:.4g} s at most" if self.longest_missing else ""
            lines.append(
                f"{self.key} is missing in {self.missing:.2%} of its rows{most}; it has values at "
                f"{self.rate:.4g} Hz."
            )
        if self.constant:
            lines.append(f"{self.key} never changes: is it connected?")
        if self.held > 1:
            lines.append(
                f"{self.key} repeats each value {self.held} times, so it was measured at "
                f"{self.rate / self.held:.4g} Hz."
            )
        if self.frozen:
            lines.append(
                f"{self.key} does not change by a bit for {self.frozen:.4g} s from "
                f"{self.frozen_at:.10g} s on, having moved before: did its sensor freeze?"
            )
        return lines


@dataclass(frozen=True)
class Quality:
    """Everything about the times and values of a recording, as plain data.

    spans: what to mark on a strip, in the order of kind and time.
    """

    clocks: tuple[ClockQuality, ...]
    channels: tuple[ChannelQuality, ...]
    spans: tuple[Span, ...] = ()

    def sentences(self) -> list[str]:
        """All of it for a report."""
        return [line for part in (*self.clocks, *self.channels) for line in part.describe()]


def spans(kind: str, starts: Array, ends: Array, duration: float) -> tuple[Span, ...]:
    """Spans of a kind in the order of time, joined where they touch or are too many to draw.

    starts, ends: (n,) [s].   duration: of the recording [s].
    """
    if not len(starts):
        return ()
    order = np.argsort(starts, kind="stable")
    starts, ends = starts[order], np.maximum.accumulate(ends[order])
    near = duration / MOST_SPANS if len(starts) > MOST_SPANS else 0.0
    apart = np.flatnonzero(starts[1:] > ends[:-1] + near)
    first, last = starts[[0, *(apart + 1)]], ends[[*apart, -1]]
    return tuple(Span(a, b, kind) for a, b in zip(first.tolist(), last.tolist(), strict=True))


def _rows(n: int) -> str:
    return _count(n, "row")


def _count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
