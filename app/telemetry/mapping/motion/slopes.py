"""Derivatives and values between samples of recorded traces, without amplifying their noise."""

import numpy as np

from app.telemetry.traces import GAP_RATIO
from core.types import Array, Indices

HALF_WINDOW_S = 0.1
"""A slope looks this far to either side, at the least one sample [s]."""
MOST_TERMS = 10
"""Samples to either side that a slope goes by; of more, as many that are evenly spread."""


def slopes(t: Array, x: Array) -> Array:
    """dx/dt (n,): of the least-squares line through the samples within HALF_WINDOW_S of each.

    A sine of f [Hz] keeps 1 - (2 pi f HALF_WINDOW_S)^2 / 10 of its slope and none of it is delayed.
    White noise of sigma at n samples a second becomes sigma sqrt(12 / (n T^3)), T being the whole
    window; the difference of neighbours would make it sigma n sqrt(2).
    t: (n,) in any order; of equal times the first counts.   x: (n,) NaN where missing; there, and
    where a sample has no neighbour on its own side of a gap, the slope is NaN.
    """
    slope = np.full(len(t), np.nan)
    order = _usable(t, x)
    if len(order) < 2:
        return slope
    slope[order] = _line_slopes(t[order], x[order])
    return slope


def _line_slopes(t: Array, x: Array) -> Array:
    """Of the line through the window of each sample, NaN where it is alone. t: increasing."""
    steps = np.diff(t)
    step = float(np.median(steps))
    segment = np.concatenate([[0], np.cumsum(steps > GAP_RATIO * step)])
    reach = max(1, int(HALF_WINDOW_S / step + 1e-6))
    offsets = np.unique(np.linspace(1, reach, min(reach, MOST_TERMS)).round().astype(int))
    # sums over the window, of times and values from its own middle
    n, st, sx = np.ones(len(t)), np.zeros(len(t)), np.zeros(len(t))
    stt, stx = np.zeros(len(t)), np.zeros(len(t))
    for offset in (*-offsets[::-1], *offsets):
        here = slice(max(0, -offset), len(t) - max(0, offset))
        there = slice(max(0, offset), len(t) - max(0, -offset))
        if here.start >= len(t) or there.start >= len(t):
            continue
        within = segment[here] == segment[there]
        dt = np.where(within, t[there] - t[here], 0.0)
        dx = np.where(within, x[there] - x[here], 0.0)
        for total, term in ((n, within), (st, dt), (sx, dx), (stt, dt * dt), (stx, dt * dx)):
            total[here] += term
    spread = stt - st * st / n
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(spread > 0.0, (stx - st * sx / n) / spread, np.nan)


def values_at(at: Array, t: Array, x: Array) -> Array:
    """Straight lines between neighbouring samples (t, x), at times in any order: (n,).

    NaN before the first and behind the last sample, in gaps, and beside a missing value.
    """
    order = _usable(t, x, missing=True)
    if len(order) < 2:
        return np.full(len(at), np.nan)
    t, x = t[order], x[order]
    steps = np.diff(t)
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    values = np.interp(at, t, x, left=np.nan, right=np.nan)
    open_ = steps[after - 1] > GAP_RATIO * float(np.median(steps))
    on_sample = (at == t[after]) | (at == t[after - 1])
    values[open_ & ~on_sample] = np.nan
    values[~np.isfinite(at)] = np.nan
    return values


def unwrapped(t: Array, angle: Array) -> Array:
    """An angle [rad] without its jumps of a turn, in the order of its times."""
    order = _usable(t, angle)
    free = angle.copy()
    free[order] = np.unwrap(angle[order])
    return free


def _usable(t: Array, x: Array, *, missing: bool = False) -> Indices:
    """Samples in the order of their times, of equal times the first; with finite values."""
    usable = np.isfinite(t) if missing else np.isfinite(t) & np.isfinite(x)
    if usable.all() and bool((np.diff(t) > 0.0).all()):
        return np.arange(len(t))
    order = np.flatnonzero(usable)
    order = order[np.argsort(t[order], kind="stable")]
    first = np.ones(len(order), np.bool_)
    first[1:] = np.diff(t[order]) > 0.0
    return order[first]
