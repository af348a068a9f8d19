"""Interpolate an uneven clock: cubics through the four nearest samples, where that is safe."""

import numpy as np

from core.types import Array, Indices

CLOSE = 0.3
"""Share of the usual step: closer samples would make a cubic overshoot, so a line is used."""
BLOCK = 1 << 14
"""Rows at once, so that data stay in the cache."""


def interpolated(t: Array, x: Array, at: Array, step: float) -> Array:
    """Values at times within t[0] ... t[-1]; on a sample, that sample bit for bit.

    t: (n >= 2,) increasing, without gaps.   x: (n,) finite.   step: the usual one.
    The first and last step use the cubic through the four end samples. Straight lines are used for
    fewer than four samples, and if two of the four are CLOSE.
    """
    rows = np.empty(len(at))
    close = np.diff(t) < CLOSE * step
    close = close[:-2] | close[1:-1] | close[2:]
    for begin in range(0, len(at), BLOCK):
        part = at[begin : begin + BLOCK]
        after = np.clip(np.searchsorted(t, part), 1, len(t) - 1)
        if len(t) < 4:
            rows[begin : begin + BLOCK] = _line(t, x, part, after)
            continue
        start = np.clip(after - 2, 0, len(t) - 4)
        cubic = _cubic(t, x, part, start)
        if (line := close[start]).any():
            cubic[line] = _line(t, x, part[line], after[line])
        rows[begin : begin + BLOCK] = cubic
    return rows


def _cubic(t: Array, x: Array, at: Array, start: Indices) -> Array:
    """Lagrange's polynomial through the samples start ... start + 3."""
    nodes = [t[start + k] for k in range(4)]
    away = [at - node for node in nodes]
    rows = np.zeros(len(at))
    for k, node in enumerate(nodes):
        a, b, c = (other for other in range(4) if other != k)
        below = (node - nodes[a]) * (node - nodes[b]) * (node - nodes[c])
        rows += away[a] * away[b] * away[c] / below * x[start + k]
    return rows


def _line(t: Array, x: Array, at: Array, after: Indices) -> Array:
    before = after - 1
    share = (at - t[before]) / (t[after] - t[before])
    rows = x[before] + share * (x[after] - x[before])
    return np.where(share == 1.0, x[after], rows)
