"""Bring recorded times into order: repair certain faults; remove or refuse uncertain times.

Slightly late rows are sorted. A counter that wraps is continued if that joins the rows on both
sides. A few stray times are removed. If a clock was set back, some times occur twice and are
ambiguous: their rows are removed, which leaves a gap. Two passes of a clock are never merged.
"""

from dataclasses import dataclass

import numpy as np

from app.telemetry.recording import TelemetryError
from app.telemetry.timing.clock_pieces import LONGEST_PAUSE, ClockSet, Same, agreeing, pieces
from core.types import Array, Indices

WRAPS = {
    "the end of a 16-bit counter of milliseconds": 2**16 * 1e-3,
    "the full hour": 3600.0,
    "the end of a 32-bit counter of microseconds": 2**32 * 1e-6,
    "midnight": 86_400.0,
    "the end of the week": 604_800.0,
    "the end of a 32-bit counter of milliseconds": 2**32 * 1e-3,
}
"""Events at which clocks restart, and their periods [s]."""
LATE = 5.0
"""Rows later than this, and later than three steps, are not late packets [s]."""
FEW_SETS = 10
"""A signal that steps back more often is not a time."""
MANY_BACK = 0.05
"""Share of backward steps that is too large for a clock that is set occasionally."""
MOST_LOST = 0.1
"""Largest share of rows without a certain time; files with more are refused."""


@dataclass(frozen=True, eq=False)
class OrderedClock:
    """Rows in the order of time. t: (n,) not falling.   rows: (n,) indices of recorded rows.

    late: times of rows that follow a later time.   backward: recorded newest first.
    wraps: name of every wrap and the last time before it.
    """

    t: Array
    rows: Indices
    late: Array
    backward: bool = False
    wraps: tuple[tuple[str, float], ...] = ()
    sets: tuple[ClockSet, ...] = ()


def in_order(t: Array, same: Same, channels: str) -> OrderedClock:
    """Sort rows by time. t: (n,) finite, as recorded.   channels: names for messages.

    Raises TelemetryError if more than MOST_LOST of the rows have no certain time.
    """
    rows = np.arange(len(t))
    steps = np.diff(t)
    if not (steps < 0.0).any() and not (steps > LONGEST_PAUSE).any():
        return OrderedClock(t, rows, t[:0])
    if not (steps > 0.0).any():
        return OrderedClock(np.ascontiguousarray(t[::-1]), rows[::-1], t[:0], backward=True)
    usual = float(np.median(steps[steps > 0.0]))
    if np.mean(steps < 0.0) > MANY_BACK:  # rows are shuffled, so steps are too
        usual = min(usual, float(np.ptp(t)) / len(steps))
    late = max(LATE, 3.0 * usual)
    t, wraps = _unwrapped(t, usual)
    accepted, sets = agreeing(t, pieces(t, same, late, usual, channels), late)
    lost = sum(clock_set.lost for clock_set in sets)
    if lost > MOST_LOST * len(t):
        worst = max(sets, key=lambda clock_set: clock_set.lost)
        few = len(sets) <= FEW_SETS
        raise TelemetryError(
            f"the time of {channels} jumps from {worst.before:.10g} s to {worst.after:.10g} s at "
            f"row {worst.row + 1}, which leaves {lost} of {len(t)} rows with an ambiguous time: "
            + ("split the file at that row" if few else "choose another signal as the time")
        )
    rows = np.concatenate([piece.rows for piece in accepted])
    behind = t[rows] < np.maximum.accumulate(t[rows])
    late_times = np.sort(t[rows[behind]])
    rows = rows[np.argsort(t[rows], kind="stable")]
    return OrderedClock(t[rows], rows, late_times, wraps=wraps, sets=sets)


def _unwrapped(t: Array, usual: float) -> tuple[Array, tuple[tuple[str, float], ...]]:
    """Continue counters that wrap, if the next row then follows within a few steps."""
    steps = np.diff(t)
    back = np.flatnonzero(steps < 0.0)
    lift, wraps = np.zeros(len(t)), {}
    for name, period in WRAPS.items():
        joined = steps[back] + period
        near = max(1.5 * usual, min(10.0 * usual, 1e-3 * period))
        for i in back[(joined > 0.0) & (joined <= near)]:
            lift[i + 1] = period
            wraps[int(i)] = name
    t = t + np.cumsum(lift)
    return t, tuple((wraps[i], float(t[i])) for i in sorted(wraps))
