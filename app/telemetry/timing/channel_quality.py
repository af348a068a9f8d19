"""Detect missing, held and frozen values in one channel."""

import numpy as np

from app.telemetry.recording import GAP_RATIO
from app.telemetry.timing.quality import ChannelQuality, Fault, faults
from core.types import Array, Flags, Indices

FROZEN = 2.0
"""A value is frozen if it is held at least this long [s]."""
FROZEN_RUNS = 20.0
"""And this many times longer than usual for the channel."""
FEWEST_RUNS = 20
"""Fewest changes of value that show how long values are held."""
ALIKE = 0.8
"""Share of values held for equally many rows that shows a slow sensor sampled fast."""


def channel_quality(
    key: str, t: Array, x: Array, step: float
) -> tuple[ChannelQuality, tuple[Fault, ...]]:
    """Quality and faults. t: (n >= 2,) increasing, usually by `step`.   x: (n,), NaN if missing."""
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
    """Begin and end of intervals without a value that are longer than `limit`."""
    known = np.flatnonzero(finite)
    before = np.concatenate([[0], known])
    after = np.concatenate([known, [len(t) - 1]])
    hole = (t[after] - t[before] > limit) & (after - before > 1)
    hole[0], hole[-1] = known[0] > 0, known[-1] < len(t) - 1
    return t[before[hole]], t[after[hole]]


def _runs(t: Array, x: Array) -> tuple[Indices, tuple[Array, Array]]:
    """Number of rows that each value is held; begin and end of frozen runs."""
    begin = np.concatenate([[0], np.flatnonzero(x[1:] != x[:-1]) + 1])
    rows = np.diff(begin, append=len(x))
    long = 1 + np.flatnonzero(rows[1:] >= FROZEN_RUNS)
    usual = (len(x) - rows[long]) / max(1, len(rows) - 1)
    first, last = t[begin[long]], t[begin[long] + rows[long] - 1]
    frozen = (last - first >= FROZEN) & (rows[long] >= FROZEN_RUNS * usual)
    return rows, (first[frozen], last[frozen])


def _held(runs: Indices) -> int:
    """Usual number of rows per value; 1 if it differs from value to value."""
    inner = runs[1:-1]
    if len(inner) < FEWEST_RUNS or inner.mean() < 2.0 * ALIKE:
        return 1
    usual = round(float(np.median(inner)))
    is_usual = np.abs(inner - usual) <= (1 if usual > 2 else 0)
    return usual if is_usual.mean() >= ALIKE else 1
