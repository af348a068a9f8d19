"""Bring recorded times into order: repair certain faults; remove or refuse uncertain times.

Slightly late rows are sorted. A counter that wraps is continued if that joins the rows on both
sides. A few stray times are removed. If a clock was set back, some times occur twice and are
ambiguous: their rows are removed, which leaves a gap. Two passes of a clock are never merged.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from app.telemetry.recording import GAP_RATIO, TelemetryError
from core.types import Array, Flags, Indices

Same = Callable[[Indices, Indices], Flags]
"""Whether pairs of rows have equal values in every channel."""

LONGEST_PAUSE = 86_400.0
"""A longer step forward means that the clock was set [s]."""
CLOSE = 0.6
"""Shortest step of an even clock, as a share of the usual step."""
MOST_CLOSE = 0.01
"""Largest share of shorter steps on an even clock."""
MOST_STEPS = 2.0
"""Longest block that one stray time can put out of order, in steps."""
MOST_CUTS = 10_000
"""Most large steps of a clock."""
MOST_SETS = 1_000
"""Most small corrections of a clock, or one per as many rows."""


@dataclass(frozen=True)
class ClockSet:
    """A correction of the clock, or a few stray times. row: number of the first row after it.

    before, after: times on both sides [s].   lost: rows removed.   ambiguous: whether times from
    `after` to `before` occur twice, which makes them ambiguous on all clocks of the file.
    """

    row: int
    before: float
    after: float
    lost: int
    ambiguous: bool = False


@dataclass(frozen=True, eq=False)
class ClockPiece:
    """Rows in recorded order, with their lowest and highest time."""

    rows: Indices
    low: float
    high: float

    def __len__(self) -> int:
        return len(self.rows)


def pieces(t: Array, same: Same, late: float, usual: float, channels: str) -> list[ClockPiece]:
    """Split rows where the clock makes a large step, or goes back into earlier times.

    t: (n,) as recorded.   late: longest delay of a late row [s].   usual: step [s].
    """
    far = np.flatnonzero(np.abs(np.diff(t)) > late) + 1
    if len(far) > MOST_CUTS:
        raise TelemetryError(
            f"the times of {channels} jump by more than {late:.4g} s at {len(far)} places: choose "
            "another signal as the time, or sort the rows"
        )
    waiting = np.split(np.arange(len(t)), far)[::-1]
    result = []
    most_sets = max(MOST_SETS, len(t) // MOST_SETS)
    while waiting:
        if len(waiting) + len(result) > len(far) + most_sets:
            raise TelemetryError(
                f"the times of {channels} step back at more than {most_sets} places: choose "
                "another signal as the time, or sort the rows"
            )
        rows = waiting.pop()
        cuts = _set_back(t[rows], rows, same, late, usual, channels)
        if len(cuts):
            waiting += np.split(rows, cuts)[::-1]
        else:
            result.append(_piece(rows, t))
    return result


def agreeing(
    t: Array, recorded: list[ClockPiece], late: float
) -> tuple[list[ClockPiece], tuple[ClockSet, ...]]:
    """Pieces, or parts of them, whose times follow one another; the corrections between them.

    If two pieces overlap, the smaller one or the common times are removed, whichever are fewer
    rows. A small piece between two that continue without it is stray.
    """
    accepted: list[ClockPiece] = []
    sets: list[ClockSet] = []
    for piece in recorded:
        row = int(piece.rows[0])
        step = ClockSet(row, float(t[row - 1]), float(t[row]), 0)
        new: ClockPiece | None = piece
        while accepted and new and not _follows(new, accepted[-1]):
            last = accepted.pop()
            stray = len(last) < len(new) and accepted and 0.0 < new.low - accepted[-1].high <= late
            before, after = t[last.rows] < new.low, t[new.rows] > last.high
            shared = int((~before).sum() + (~after).sum())
            if stray or (new.low > last.high and len(last) < len(new)):
                sets.append(replace(step, lost=len(last)))
            elif new.low <= last.high and shared <= min(len(last), len(new)):
                sets.append(ClockSet(row, last.high, new.low, shared, ambiguous=True))
                new = _part(new, after, t)
                accepted += [rest] if (rest := _part(last, before, t)) else []
            elif len(last) < len(new):
                sets.append(replace(step, lost=len(last)))
            else:
                sets.append(replace(step, lost=len(new)))
                new = None
                accepted.append(last)
        accepted += [new] if new else []
    return accepted, tuple(sets)


def _follows(piece: ClockPiece, last: ClockPiece) -> bool:
    return last.high < piece.low <= last.high + LONGEST_PAUSE


def _set_back(
    t: Array, rows: Indices, same: Same, late: float, usual: float, channels: str
) -> Indices:
    """Rows at which the clock was set by a little; none if late rows explain the order."""
    high = np.maximum.accumulate(t)
    low = np.minimum.accumulate(t[::-1])[::-1]
    begin = np.flatnonzero(np.concatenate([[True], high[:-1] <= low[1:]]))
    if len(begin) == len(t):
        return begin[:0]
    end = np.append(begin[1:], len(t))
    blocks = _given_twice(t, rows, same, usual, begin, high[end - 1] - low[begin])
    if not len(blocks) and (high - t).max() > late:
        row = int((high - t).argmax())
        raise TelemetryError(
            f"the times of {channels} fall from {high[row]:.10g} s to {t[row]:.10g} s in small "
            f"steps until row {rows[row] + 1}: sort the rows by a time that only increases"
        )
    steps = np.diff(t)
    lowest = [begin[k] + 1 + steps[begin[k] : end[k] - 1].argmin() for k in blocks]
    edges = np.concatenate([begin[blocks], end[blocks]])
    edges = edges[(edges > 0) & (edges < len(t))]
    edges = edges[steps[edges - 1] > GAP_RATIO * usual]
    return np.unique(np.concatenate([np.array(lowest, np.intp), edges]))


def _given_twice(
    t: Array, rows: Indices, same: Same, usual: float, begin: Indices, duration: Array
) -> Indices:
    """Blocks out of order that late rows do not explain. begin, duration: of each block.

    Late rows fill gaps. A clock that passes a block of times twice makes more rows than steps, or
    gives one time to different values. On an otherwise even clock, steps that are too short or too
    long also show it, unless one stray time explains a short block.
    """
    order = np.argsort(t, kind="stable")
    after = np.diff(t[order], prepend=-np.inf)
    repeats = np.flatnonzero(after == 0.0)
    sent_again = np.zeros(len(t), bool)
    sent_again[repeats] = same(rows[order[repeats - 1]], rows[order[repeats]])
    forward = np.diff(t)
    forward = forward[forward > 0.0]
    odd = after == 0.0
    if np.count_nonzero(forward < CLOSE * usual) <= MOST_CLOSE * len(forward):
        odd = (after < CLOSE * usual) | (after > GAP_RATIO * usual)
        short = np.repeat(duration < MOST_STEPS * usual, np.diff(begin, append=len(t)))
        odd &= ~short | (after == 0.0)
    odd &= ~sent_again
    odd[begin] = False  # the step to a block does not belong to it
    n_odd, n_rows = (np.add.reduceat(x.astype(np.intp), begin) for x in (odd, ~sent_again))
    crowded = n_rows > 1.5 * (duration / usual + 1.0) + 2.0
    return np.flatnonzero(((n_odd > 0) | crowded) & (duration > 0.0))


def _piece(rows: Indices, t: Array) -> ClockPiece:
    return ClockPiece(rows, float(t[rows].min()), float(t[rows].max()))


def _part(piece: ClockPiece, keep: Flags, t: Array) -> ClockPiece | None:
    return _piece(piece.rows[keep], t) if keep.any() else None


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
