"""Pieces of a recording between the places where its clock was set, and which of them agree."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from app.telemetry.recording import TelemetryError
from app.telemetry.traces import GAP_RATIO
from core.types import Array, Flags, Indices

Same = Callable[[Indices, Indices], Flags]
"""Whether rows hold the same values in every channel, pair by pair."""

LONGEST_PAUSE = 86_400.0
"""A longer step forward is a clock that was set [s]."""
CLOSE = 0.6
"""Of the usual step: times of an even clock are not closer."""
MOST_CLOSE = 0.01
"""Share of closer times above which a clock is not even."""
MOST_STEPS = 2.0
"""Length of a block out of order that one odd time explains."""
MOST_CUTS = 10_000
"""Far steps that a clock may make."""
MOST_SETS = 1_000
"""Times that it may be set by little, or once in as many rows."""


@dataclass(frozen=True)
class ClockSet:
    """A clock that was set, or a few rows with stray times. row: number of the first row after.

    before, after: the times on either side [s].   lost: rows removed.   ambiguous: whether
    the times from `after` to `before` occur twice, so that those of no other clock can be trusted.
    """

    row: int
    before: float
    after: float
    lost: int
    ambiguous: bool = False


@dataclass(frozen=True, eq=False)
class ClockPiece:
    """Rows in recorded order, the least and the greatest of their times."""

    rows: Indices
    low: float
    high: float

    def __len__(self) -> int:
        return len(self.rows)


def pieces(t: Array, same: Same, late: float, usual: float, what: str) -> list[ClockPiece]:
    """Rows cut where the clock steps far to either side, or back into times it has given.

    t: (n,) as recorded.   late: the longest that a row may come late [s].   usual: step [s].
    """
    far = np.flatnonzero(np.abs(np.diff(t)) > late) + 1
    if len(far) > MOST_CUTS:
        raise TelemetryError(
            f"the times of {what} jump by more than {late:.4g} s at {len(far)} places: choose the "
            "signal that is the time, or sort the rows"
        )
    waiting = np.split(np.arange(len(t)), far)[::-1]
    result = []
    most_sets = max(MOST_SETS, len(t) // MOST_SETS)
    while waiting:
        if len(waiting) + len(result) > len(far) + most_sets:
            raise TelemetryError(
                f"the times of {what} step back at more than {most_sets} places: choose the "
                "signal that is the time, or sort the rows"
            )
        rows = waiting.pop()
        cuts = _set_back(t[rows], rows, same, late, usual, what)
        if len(cuts):
            waiting += np.split(rows, cuts)[::-1]
        else:
            result.append(_piece(rows, t))
    return result


def agreeing(
    t: Array, recorded: list[ClockPiece], late: float
) -> tuple[list[ClockPiece], tuple[ClockSet, ...]]:
    """Pieces, or what is left of them, whose times follow one another; what was lost for it.

    Of two that do not follow one another the smaller is removed, or the times that both have,
    whichever are fewer rows; a small piece between two that go on without it is stray.
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


def _set_back(t: Array, rows: Indices, same: Same, late: float, usual: float, what: str) -> Indices:
    """Rows before which the clock was set by little; none where late rows explain the order."""
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
            f"the times of {what} fall from {high[row]:.10g} s to {t[row]:.10g} s in small steps "
            f"until row {rows[row] + 1}: sort the rows by a time that only runs forward"
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
    """Those of the blocks out of order that late rows do not explain.

    begin, duration: of each block.

    Late rows fill the places where rows are missing. A clock that runs twice through a block of
    times gives it twice as many rows as it has steps, or gives one time to different values. One
    that is otherwise even makes steps that are too short or too long, which is also held against
    it unless the block is so short that one odd time explains it.
    """
    order = np.argsort(t, kind="stable")
    after = np.diff(t[order], prepend=-np.inf)
    again = np.flatnonzero(after == 0.0)
    sent_again = np.zeros(len(t), bool)
    sent_again[again] = same(rows[order[again - 1]], rows[order[again]])
    forward = np.diff(t)
    forward = forward[forward > 0.0]
    odd = after == 0.0
    if np.count_nonzero(forward < CLOSE * usual) <= MOST_CLOSE * len(forward):
        odd = (after < CLOSE * usual) | (after > GAP_RATIO * usual)
        short = np.repeat(duration < MOST_STEPS * usual, np.diff(begin, append=len(t)))
        odd &= ~short | (after == 0.0)
    odd &= ~sent_again
    odd[begin] = False  # the step that leads to a block is none of its own
    n_odd, n_rows = (np.add.reduceat(x.astype(np.intp), begin) for x in (odd, ~sent_again))
    crowded = n_rows > 1.5 * (duration / usual + 1.0) + 2.0
    return np.flatnonzero(((n_odd > 0) | crowded) & (duration > 0.0))


def _piece(rows: Indices, t: Array) -> ClockPiece:
    return ClockPiece(rows, float(t[rows].min()), float(t[rows].max()))


def _part(piece: ClockPiece, keep: Flags, t: Array) -> ClockPiece | None:
    return _piece(piece.rows[keep], t) if keep.any() else None
