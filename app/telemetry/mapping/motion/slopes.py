"""Derivatives and interpolation of recorded traces, without amplifying noise."""

import numpy as np

from app.telemetry.traces import GAP_RATIO
from core.types import Array, Indices

HALF_WINDOW_S = 0.1
"""A slope uses samples this far to either side, at least one [s]."""
MOST_TERMS = 10
"""Most samples to either side for a slope, evenly spread."""


def slopes(t: Array, x: Array) -> Array:
    """dx/dt (n,): slope of the least-squares line through the samples within HALF_WINDOW_S.

    A sine of f [Hz] keeps 1 - (2 pi f HALF_WINDOW_S)^2 / 10 of its slope, without delay. White
    noise of sigma at n samples per second becomes sigma sqrt(12 / (n T^3)), T being the whole
    window; the difference of neighbours would give sigma n sqrt(2).
    t: (n,) in any order; the first of equal times counts.   x: (n,) NaN if missing. The slope is
    NaN there, and for a sample without a neighbour on its side of a gap.
    """
    slope = np.full(len(t), np.nan)
    order = _usable(t, x)
    if len(order) < 2:
        return slope
    slope[order] = _line_slopes(t[order], x[order])
    return slope


def _line_slopes(t: Array, x: Array) -> Array:
    """Slope of the line through the window of each sample, NaN if alone. t: increasing."""
    steps = np.diff(t)
    step = float(np.median(steps))
    segment = np.concatenate([[0], np.cumsum(steps > GAP_RATIO * step)])
    reach = max(1, int(HALF_WINDOW_S / step + 1e-6))
    offsets = np.unique(np.linspace(1, reach, min(reach, MOST_TERMS)).round().astype(int))
    # sums over the window, relative to its middle sample
    n, st, sx = np.ones(len(t)), np.zeros(len(t)), np.zeros(len(t))
    stt, stx = np.zeros(len(t)), np.zeros(len(t))
    for offset in (*-offsets[::-1], *offsets):
        base = slice(max(0, -offset), len(t) - max(0, offset))
        neighbour = slice(max(0, offset), len(t) - max(0, -offset))
        if base.start >= len(t) or neighbour.start >= len(t):
            continue
        within = segment[base] == segment[neighbour]
        dt = np.where(within, t[neighbour] - t[base], 0.0)
        dx = np.where(within, x[neighbour] - x[base], 0.0)
        for total, term in ((n, within), (st, dt), (sx, dx), (stt, dt * dt), (stx, dt * dx)):
            total[base] += term
    spread = stt - st * st / n
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(spread > 0.0, (stx - st * sx / n) / spread, np.nan)


def values_at(at: Array, t: Array, x: Array) -> Array:
    """Linear interpolation of (t, x) at times in any order: (n,).

    NaN before the first and after the last sample, in gaps and next to a missing value.
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
    """An angle [rad] without jumps of a full turn, in the order of its times."""
    order = _usable(t, angle)
    free = angle.copy()
    free[order] = np.unwrap(angle[order])
    return free


def _usable(t: Array, x: Array, *, missing: bool = False) -> Indices:
    """Samples with finite values in the order of time, the first of equal times."""
    usable = np.isfinite(t) if missing else np.isfinite(t) & np.isfinite(x)
    if usable.all() and bool((np.diff(t) > 0.0).all()):
        return np.arange(len(t))
    order = np.flatnonzero(usable)
    order = order[np.argsort(t[order], kind="stable")]
    first = np.ones(len(order), np.bool_)
    first[1:] = np.diff(t[order]) > 0.0
    return order[first]
