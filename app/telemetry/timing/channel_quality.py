"""What the values of one channel show of its sensor: holes, held values, a sensor that froze."""

import numpy as np

from app.telemetry.timing.quality import ChannelQuality, Fault, faults
from app.telemetry.traces import GAP_RATIO
from core.types import Array, Flags, Indices

FROZEN = 2.0
"""A value has to be held this long to be called frozen [s]."""
FROZEN_RUNS = 20.0
"""And this many times longer than the channel's values are usually held."""
FEWEST_RUNS = 20
"""Changes of value that show how long values are held."""
ALIKE = 0.8
"""Share of the values that are held for as many rows, where a slow sensor is sampled fast."""


def channel_quality(
    key: str, t: Array, x: Array, step: float
) -> tuple[ChannelQuality, tuple[Fault, ...]]:
    """Look at a channel. t: (n >= 2,) increasing, usually by `step`.   x: (n,), NaN if missing."""
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
    """Begin and end of the intervals without a value that are longer than the usual step."""
    known = np.flatnonzero(finite)
    before = np.concatenate([[0], known])
    after = np.concatenate([known, [len(t) - 1]])
    hole = (t[after] - t[before] > limit) & (after - before > 1)
    hole[0], hole[-1] = known[0] > 0, known[-1] < len(t) - 1
    return t[before[hole]], t[after[hole]]


def _runs(t: Array, x: Array) -> tuple[Indices, tuple[Array, Array]]:
    """Rows that each value is held for, one after the other; begin and end of the frozen ones."""
    begin = np.concatenate([[0], np.flatnonzero(x[1:] != x[:-1]) + 1])
    rows = np.diff(begin, append=len(x))
    long = 1 + np.flatnonzero(rows[1:] >= FROZEN_RUNS)
    usual = (len(x) - rows[long]) / max(1, len(rows) - 1)
    first, last = t[begin[long]], t[begin[long] + rows[long] - 1]
    frozen = (last - first >= FROZEN) & (rows[long] >= FROZEN_RUNS * usual)
    return rows, (first[frozen], last[frozen])


def _held(runs: Indices) -> int:
    """Rows that a value is usually repeated for; 1 where that differs from value to value."""
    inner = runs[1:-1]
    if len(inner) < FEWEST_RUNS or inner.mean() < 2.0 * ALIKE:
        return 1
    usual = round(float(np.median(inner)))
    alike = np.abs(inner - usual) <= (1 if usual > 2 else 0)
    return usual if alike.mean() >= ALIKE else 1
