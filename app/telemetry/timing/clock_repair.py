"""One clock's rows, from recorded to repaired, and what is to be said of them."""

from dataclasses import replace

import numpy as np

from app.telemetry.recording import TelemetryError
from app.telemetry.timing.clock_faults import WRAPS, Ordered, in_order
from app.telemetry.timing.clock_pieces import Array, Flags, Indices
from app.telemetry.timing.quality import ClockQuality, Span, spans
from app.telemetry.timing.rounded_clock import evened
from app.telemetry.traces import GAP_RATIO

NO_TIME = 1e12
"""Numbers from here on are not times; 30,000 years [s]."""
FASTEST = 1e-8
"""Shorter steps are of no recorder [s]."""


def ordered(t: Array, values: dict[str, Array]) -> Ordered:
    """Put the rows that have a time in its order; `rows` count those recorded."""
    finite = np.abs(t) < NO_TIME
    if finite.all():
        return in_order(t, lambda a, b: _same(values, a, b), ", ".join(values))
    known = np.flatnonzero(finite)
    found = in_order(t[known], lambda a, b: _same(values, known[a], known[b]), ", ".join(values))
    return replace(found, rows=known[found.rows])


def on_one_clock(clocks: list[Ordered]) -> list[Ordered]:
    """Clocks of one file taken as one: what is in doubt on one is so on all; wraps are shared.

    A clock that began after a wrap does not show it; it is moved by whole periods to where the
    longest clock that wrapped was recording.
    """
    doubts = [(s.after, s.before) for clock in clocks for s in clock.sets if s.doubt]
    wrapped = max((clock for clock in clocks if clock.wraps), key=lambda c: len(c.t), default=None)
    result = []
    for clock in clocks:
        if wrapped and len(clock.t) and not clock.wraps:
            clock = _moved(clock, wrapped)
        for begin, end in doubts:
            sure = (clock.t < begin) | (clock.t > end)
            if not sure.all():
                clock = replace(clock, t=clock.t[sure], rows=clock.rows[sure])
        result.append(clock)
    return result


def _moved(clock: Ordered, wrapped: Ordered) -> Ordered:
    begin, end, lift = wrapped.t[0], wrapped.t[-1], 0.0
    for name, _ in (("", 0.0), *wrapped.wraps):
        lift += WRAPS.get(name, 0.0)
        if clock.t[0] + lift <= end and clock.t[-1] + lift >= begin:
            break
    else:
        return clock
    return replace(clock, t=clock.t + lift, wraps=wrapped.wraps) if lift else clock


def finished(
    recorded: Array, values: dict[str, Array], clock: Ordered
) -> tuple[Array, dict[str, Array], ClockQuality, list[Span]]:
    """Times that increase, the channels' values at them, and how good both are.

    recorded: (n,) [s].   values: (n,) by channel.   clock: their order.
    """
    t, rows = clock.t, clock.rows
    t, rows, repeated, conflicting, again, rounded_to = _single(t, rows, values)
    if len(t) < 2:
        raise TelemetryError(
            f"{len(t)} of {len(recorded)} rows of {', '.join(values)} have a time of their own: "
            "choose the signal that is their time and its unit, or leave them out"
        )
    if t[-1] - t[0] < FASTEST * (len(t) - 1):
        raise TelemetryError(
            f"{len(t)} rows of {', '.join(values)} lie within {t[-1] - t[0]:.3g} s: choose the "
            "unit of their time"
        )
    untouched = len(rows) == len(recorded) and bool((np.diff(rows) == 1).all())
    chosen = {key: _finite(x if untouched else x[rows]) for key, x in values.items()}
    quality, gaps = _quality(t, tuple(values), len(recorded))
    quality = replace(
        quality,
        bad_times=len(recorded) - int((np.abs(recorded) < NO_TIME).sum()),
        repeated=repeated,
        conflicting=conflicting,
        reordered=len(clock.late),
        backward=clock.backward,
        wraps=tuple(name for name, _ in clock.wraps),
        sets=tuple((each.before, each.after) for each in clock.sets),
        rounded_to=rounded_to,
    )
    quality = replace(quality, lost=len(recorded) - len(t) - quality.bad_times - repeated)
    doubts = [s for s in clock.sets if s.doubt]
    begin, end = np.array([s.after for s in doubts]), np.array([s.before for s in doubts])
    duration = float(t[-1] - t[0])
    marks = [
        *spans("gap", *gaps, duration),
        *spans("clock", begin, end, duration),
        *spans("repeated", again, again, duration),
        *spans("reordered", clock.late, clock.late, duration),
    ]
    return t, chosen, quality, marks


def _single(
    t: Array, rows: Indices, values: dict[str, Array]
) -> tuple[Array, Indices, int, int, Array, float]:
    """One row a time: (t, rows, n repeated, n of them with other values, where, rounded to).

    Rows that differ at one time may be what coarse rounding made of an even clock; rows written
    twice are not.
    """
    twice = np.flatnonzero(np.diff(t) == 0.0)
    same = _same(values, rows[twice], rows[twice + 1])
    if 2 * same.sum() <= len(twice) and (even := evened(t)):
        return even[0], rows, 0, 0, t[:0], even[1]
    again = t[twice]
    if len(twice):
        first = np.concatenate([[True], np.diff(t) > 0.0])
        t, rows = t[first], rows[first]
        if even := evened(t):
            return even[0], rows, len(twice), int((~same).sum()), again, even[1]
    return t, rows, len(twice), int((~same).sum()), again, 0.0


def _same(values: dict[str, Array], a: Indices, b: Indices) -> Flags:
    """Whether rows hold the same values in every channel, pair by pair."""
    same = np.ones(len(a), bool)
    for x in values.values():
        same &= (x[a] == x[b]) | (np.isnan(x[a]) & np.isnan(x[b]))
    return same


def _finite(x: Array) -> Array:
    """Infinite values are no measurements."""
    return np.where(np.isinf(x), np.nan, x) if np.isinf(x).any() else x


def _quality(
    t: Array, channels: tuple[str, ...], n_rows: int
) -> tuple[ClockQuality, tuple[Array, Array]]:
    """Rate, scatter and gaps of times that increase; begin and end of the gaps."""
    steps = np.diff(t)
    usual = float(np.median(steps))
    gap = steps > GAP_RATIO * usual
    step = float(steps[~gap].mean())
    lengths, begin = steps[gap], t[:-1][gap]
    quality = ClockQuality(
        channels=channels,
        n_rows=n_rows,
        start=float(t[0]),
        end=float(t[-1]),
        step=step,
        rate=1.0 / step,
        jitter=float(np.sqrt(np.mean((steps[~gap] - usual) ** 2))),
        n_gaps=len(lengths),
        gap_time=float(lengths.sum()),
        longest_gap=float(lengths.max(initial=0.0)),
        longest_gap_at=float(begin[lengths.argmax()]) if len(lengths) else 0.0,
    )
    return quality, (begin, t[1:][gap])
