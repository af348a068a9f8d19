"""Repair the times of one clock and list its faults."""

from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from app.telemetry.contents import release
from app.telemetry.recording import GAP_RATIO, TelemetryError
from app.telemetry.timing.clock_faults import WRAPS, OrderedClock, in_order
from app.telemetry.timing.quality import ClockQuality, Fault, faults
from core.types import Array, Flags, Indices

FEWEST = 20
"""Fewest times that show a pattern."""
FEWEST_ODD = 5
"""Fewest steps of the rarer length; fewer are a slip of the clock or lost or repeated rows."""
SHARE_ODD = 0.1
"""The same as a share, for rounding so coarse that it looks like lost or repeated rows."""
PROBE = 2_000
"""Steps that are checked first: rounded steps have few different lengths."""
MOST_LENGTHS = 100


def evened(t: Array) -> tuple[Array, float] | None:
    """The even clock behind rounded times and the unit of the rounding [s]; None if there is no
    such clock or nothing to restore.

    t: (n,) in order; neighbours may be equal, as coarse rounding makes them. After lost samples
    the clock continues in whole steps if that explains the times, otherwise it starts again.
    """
    if len(t) < FEWEST:
        return None
    steps = np.diff(t)
    noise = max(8.0 * float(np.spacing(np.abs(t).max())), 1e-12)
    lengths = _lengths(steps[:PROBE], noise)
    if len(lengths) > MOST_LENGTHS:
        return None
    lengths = _lengths(steps, noise)
    if not 1 < len(lengths) <= 10 * MOST_LENGTHS:
        return None
    units = [float(np.diff(lengths).min())]
    if (t == t.astype(np.float32)).all():
        units.append(float(np.spacing(np.float32(np.abs(t).max()))))
    unit = max(units) + noise
    usual = max(float(np.median(steps)), float(steps[steps <= 1.5 * lengths[1]].mean()))
    short = int((steps <= lengths[0] + 2.0 * noise).sum())
    odd = short if lengths[0] <= noise else min(short, len(steps) - short)
    if odd < max(FEWEST_ODD, SHARE_ODD * len(steps) if unit > 0.5 * usual else 0.0):
        return None
    starts = np.flatnonzero(np.concatenate([[True], steps > 1.5 * usual + unit]))
    if 4 * len(starts) > len(t):
        return None
    clock = _clock(t, starts, unit)
    if clock is None or not (np.diff(clock) > 0.0).all():
        return None
    return clock, max(units)


def _lengths(steps: Array, noise: float) -> Array:
    """Different lengths of steps, beyond floating-point rounding."""
    units = np.unique(np.rint(steps / noise))
    return units[np.diff(units, prepend=-np.inf) > 2.0] * noise


def _clock(t: Array, starts: Indices, unit: float) -> Array | None:
    """Times on one even step, with whole steps between the parts if possible."""
    part = np.zeros(len(t), np.intp)
    part[starts[1:]] = 1
    part = np.cumsum(part)
    index = np.arange(len(t)) - starts[part]
    for step in _candidates(t, index, starts, part):
        rest = t - step * index
        middle = 0.5 * (np.maximum.reduceat(rest, starts) + np.minimum.reduceat(rest, starts))
        if np.abs(rest - middle[part]).max() > 0.5 * unit:
            continue
        place = index + np.rint((middle - middle[0]) / step)[part]
        rest = t - step * place
        origin, slack = 0.5 * (rest.max() + rest.min()), 0.5 * (unit - rest.max() + rest.min())
        if slack < 0.0:
            return middle[part] + step * index
        return (t[0] if abs(t[0] - origin) <= slack else origin) + step * place
    return None


def _candidates(t: Array, index: Indices, starts: Indices, part: Indices) -> list[float]:
    """Steps to try: round values near the least-squares step, then that step itself."""
    sizes = np.diff(np.append(starts, len(t)))
    i = index - (0.5 * (sizes - 1))[part]
    at = t - (np.add.reduceat(t - t[0], starts) / sizes)[part] - t[0]
    best = float((i * at).sum() / (i * i).sum())
    if not best > 0.0:
        return []
    rates = (np.rint(1.0 / best), np.rint(10.0 / best) / 10.0, np.rint(100.0 / best) / 100.0)
    steps = [*(1.0 / rate for rate in rates if rate > 0), float(np.round(best, 4)), best]
    return [step for step in steps if step > 0.0]


NO_TIME = 1e12
"""Larger numbers are not times; this is 30,000 years [s]."""
FASTEST = 1e-8
"""No recorder has shorter steps [s]."""


def ordered(t: Array, values: dict[str, Array]) -> OrderedClock:
    """Sort the rows that have a time; `rows` are indices of recorded rows."""
    finite = np.abs(t) < NO_TIME
    if finite.all():
        return in_order(t, lambda a, b: _same(values, a, b), ", ".join(values))
    known = np.flatnonzero(finite)
    clock = in_order(t[known], lambda a, b: _same(values, known[a], known[b]), ", ".join(values))
    return replace(clock, rows=known[clock.rows])


def on_one_clock(clocks: list[OrderedClock]) -> list[OrderedClock]:
    """Treat the clocks of a file as one: ambiguous times and wraps apply to all of them.

    A clock that starts after a wrap does not show the wrap. It is moved by whole periods into the
    range of the longest clock that wrapped.
    """
    ambiguous = [(s.after, s.before) for clock in clocks for s in clock.sets if s.ambiguous]
    wrapped = max((clock for clock in clocks if clock.wraps), key=lambda c: len(c.t), default=None)
    result = []
    for clock in clocks:
        if wrapped and len(clock.t) and not clock.wraps:
            clock = _moved(clock, wrapped)
        for begin, end in ambiguous:
            certain = (clock.t < begin) | (clock.t > end)
            if not certain.all():
                clock = replace(clock, t=clock.t[certain], rows=clock.rows[certain])
        result.append(clock)
    return result


def _moved(clock: OrderedClock, wrapped: OrderedClock) -> OrderedClock:
    begin, end, lift = wrapped.t[0], wrapped.t[-1], 0.0
    for name, _ in (("", 0.0), *wrapped.wraps):
        lift += WRAPS.get(name, 0.0)
        if clock.t[0] + lift <= end and clock.t[-1] + lift >= begin:
            break
    else:
        return clock
    return replace(clock, t=clock.t + lift, wraps=wrapped.wraps) if lift else clock


@dataclass(frozen=True, eq=False)
class RepairedClock:
    """A clock after repair. t: (n,) [s] increasing.   values: (n,) by channel."""

    t: Array
    values: dict[str, Array]
    quality: ClockQuality
    faults: tuple[Fault, ...]


def repair_clock(recorded: Array, values: dict[str, Array], clock: OrderedClock) -> RepairedClock:
    """Times that increase, the values of the channels, and the quality of the times.

    recorded: (n,) [s].   values: (n,) by channel.   clock: their order.
    Raises TelemetryError if fewer than two rows have a time, or all are too close together.
    """
    times, channels = _unique_times(clock.t, clock.rows, values), tuple(values)
    t, rows = times.t, times.rows
    _check_usable(t, len(recorded), ", ".join(channels))
    untouched = len(rows) == len(recorded) and bool((np.diff(rows) == 1).all())
    chosen = {key: _finite(x if untouched else x[rows]) for key, x in values.items()}
    bad_times = len(recorded) - int((np.abs(recorded) < NO_TIME).sum())
    steps = np.diff(t)
    usual = float(np.median(steps))
    gap = steps > GAP_RATIO * usual
    step = float(steps[~gap].mean())
    lengths, begin, end = steps[gap], t[:-1][gap], t[1:][gap]
    quality = ClockQuality(
        channels=channels,
        n_rows=len(recorded),
        start=float(t[0]),
        end=float(t[-1]),
        step=step,
        rate=1.0 / step,
        jitter=float(np.sqrt(np.mean((steps[~gap] - usual) ** 2))),
        n_gaps=len(lengths),
        gap_time=float(lengths.sum()),
        longest_gap=float(lengths.max(initial=0.0)),
        longest_gap_at=float(begin[lengths.argmax()]) if len(lengths) else 0.0,
        bad_times=bad_times,
        repeated=len(times.repeated),
        conflicting=times.n_conflicting,
        reordered=len(clock.late),
        backward=clock.backward,
        wraps=tuple(name for name, _ in clock.wraps),
        sets=tuple((clock_set.before, clock_set.after) for clock_set in clock.sets),
        lost=len(recorded) - len(t) - bad_times - len(times.repeated),
        rounded_to=times.rounded_to,
    )
    ambiguous = [clock_set for clock_set in clock.sets if clock_set.ambiguous]
    set_back = np.array([s.after for s in ambiguous]), np.array([s.before for s in ambiguous])
    marks: dict[str, tuple[Array, Array]] = {
        "gap": (begin, end),
        "clock": set_back,
        "repeated": (times.repeated, times.repeated),
        "reordered": (clock.late, clock.late),
    }
    duration = float(t[-1] - t[0])
    by_kind = [faults(kind, *interval, duration) for kind, interval in marks.items()]
    return RepairedClock(t, chosen, quality, tuple(chain(*by_kind)))


def _check_usable(t: Array, n_rows: int, channels: str) -> None:
    if len(t) < 2:
        raise TelemetryError(
            f"{len(t)} of {n_rows} rows of {channels} have a distinct time: "
            "choose another time signal or unit, or leave these channels out"
        )
    if t[-1] - t[0] < FASTEST * (len(t) - 1):
        raise TelemetryError(
            f"all {len(t)} rows of {channels} lie within {t[-1] - t[0]:.3g} s: choose the "
            "correct unit of their time"
        )


class _UniqueTimes(NamedTuple):
    """One row per time. repeated: times of removed rows.   rounded_to: see ClockQuality [s]."""

    t: Array
    rows: Indices
    repeated: Array
    n_conflicting: int = 0
    rounded_to: float = 0.0


def _unique_times(t: Array, rows: Indices, values: dict[str, Array]) -> _UniqueTimes:
    """Keep the first row of each time, unless coarse rounding made the times equal.

    Different rows with one time may be an even clock, coarsely rounded; equal rows are duplicates.
    """
    twice = np.flatnonzero(np.diff(t) == 0.0)
    same = _same(values, rows[twice], rows[twice + 1])
    if 2 * same.sum() <= len(twice) and (even := evened(t)):
        return _UniqueTimes(even[0], rows, t[:0], 0, even[1])
    repeated = t[twice]
    if not len(twice):
        return _UniqueTimes(t, rows, repeated)
    n_conflicting = int((~same).sum())
    first = np.concatenate([[True], np.diff(t) > 0.0])
    t, rows = t[first], rows[first]
    even_t, rounded_to = evened(t) or (t, 0.0)
    return _UniqueTimes(even_t, rows, repeated, n_conflicting, rounded_to)


def _same(values: dict[str, Array], a: Indices, b: Indices) -> Flags:
    """Whether pairs of rows have equal values in every channel."""
    same = np.ones(len(a), bool)
    for x in values.values():
        same &= (x[a] == x[b]) | (np.isnan(x[a]) & np.isnan(x[b]))
    return same


def _finite(x: Array) -> Array:
    is_infinite = np.isinf(x)
    finite = np.where(is_infinite, np.nan, x) if is_infinite.any() else x
    release(x)
    return finite
