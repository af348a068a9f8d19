"""Recorded times put in order: what is certain is repaired, what is not is removed or refused.

Rows that come a little late are sorted in. A counter that wraps is continued, where that joins
the rows on either side. A few stray times are removed. Where the clock was set back, an interval of
times occurs twice, and no time in it tells which of the two it means: those rows are removed, and
a gap remains. Nothing of this merges two passes of a clock into one.
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
"""Where clocks start again, and after how long [s]."""
LATE = 5.0
"""Rows that come later than this, and than three steps, are not late packets [s]."""
FEW_SETS = 10
"""A signal that steps back more often is not a clock."""
MANY_BACK = 0.05
"""Share of steps back that is too large for a clock that is set now and then."""
MOST_LOST = 0.1
"""Share of the rows without a certain time above which a file is refused."""


@dataclass(frozen=True, eq=False)
class OrderedClock:
    """Rows in the order of time. t: (n,) not falling.   rows: (n,) which ones of those given.

    late: times of the rows that came after a later one.   backward: recorded newest first.
    wraps: name and last time before, of every wrap.
    """

    t: Array
    rows: Indices
    late: Array
    backward: bool = False
    wraps: tuple[tuple[str, float], ...] = ()
    sets: tuple[ClockSet, ...] = ()


def in_order(t: Array, same: Same, what: str) -> OrderedClock:
    """Bring rows into the order of time. t: (n,) finite, as recorded.   what: they are times of.

    Raises TelemetryError where more than MOST_LOST of the rows have no certain time.
    """
    rows = np.arange(len(t))
    steps = np.diff(t)
    if not (steps < 0.0).any() and not (steps > LONGEST_PAUSE).any():
        return OrderedClock(t, rows, t[:0])
    if not (steps > 0.0).any():
        return OrderedClock(np.ascontiguousarray(t[::-1]), rows[::-1], t[:0], backward=True)
    usual = float(np.median(steps[steps > 0.0]))
    if np.mean(steps < 0.0) > MANY_BACK:  # the steps as recorded are those of the shuffle
        usual = min(usual, float(np.ptp(t)) / len(steps))
    late = max(LATE, 3.0 * usual)
    t, wraps = _unwrapped(t, usual)
    accepted, sets = agreeing(t, pieces(t, same, late, usual, what), late)
    lost = sum(clock_set.lost for clock_set in sets)
    if lost > MOST_LOST * len(t):
        worst = max(sets, key=lambda clock_set: clock_set.lost)
        few = len(sets) <= FEW_SETS
        raise TelemetryError(
            f"the clock of {what} goes from {worst.before:.10g} s to {worst.after:.10g} s before "
            f"its row {worst.row + 1}, which leaves {lost} of {len(t)} rows with an "
            "ambiguous time: "
            + ("split the file where its clock was set" if few else "choose the signal of the time")
        )
    rows = np.concatenate([piece.rows for piece in accepted])
    behind = t[rows] < np.maximum.accumulate(t[rows])
    late_times = np.sort(t[rows[behind]])
    rows = rows[np.argsort(t[rows], kind="stable")]
    return OrderedClock(t[rows], rows, late_times, wraps=wraps, sets=sets)


def _unwrapped(t: Array, usual: float) -> tuple[Array, tuple[tuple[str, float], ...]]:
    """Counters counted on where the next row then follows within a few steps."""
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
