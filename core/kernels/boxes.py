"""Boxes of nominal vectors, and the distance of a vector to the nearest one."""

import numpy as np

from core.kernels.compiled import jit


@jit
def _nearest(x, low, high, n, start):
    """Squared distance to the nearest of n boxes, 0 inside one, and its number; start: to try."""
    best, nearest = np.inf, -1
    for k in range(-1 if n else 0, n):
        box = start if k < 0 else k
        away = 0.0
        for c in range(x.shape[0]):
            beyond = max(low[box, c] - x[c], x[c] - high[box, c], 0.0)
            away += beyond * beyond
            if away >= best:
                break
        if away < best:
            best, nearest = away, box
            if away == 0.0:
                break
    return best, nearest


@jit
def grow_boxes(x, tolerance, reach):
    """Cover vectors x (n, d) with boxes, in their order; a box is never split or dropped.

    A vector at most `tolerance` from a box widens the nearest one to hold it; another one begins a
    box that reaches `reach` to each side of it.   Returns low and high, (n_boxes, d) each.
    """
    low, high = np.empty_like(x), np.empty_like(x)
    n = nearest = 0
    for i in range(x.shape[0]):
        away, nearest = _nearest(x[i], low, high, n, max(nearest, 0))
        if away <= tolerance * tolerance:
            for c in range(x.shape[1]):
                low[nearest, c] = min(low[nearest, c], x[i, c])
                high[nearest, c] = max(high[nearest, c], x[i, c])
        else:
            low[n], high[n] = x[i] - reach, x[i] + reach
            nearest = n
            n += 1
    return low[:n].copy(), high[:n].copy()


@jit
def box_distances(x, low, high):
    """Euclidean distance of vectors x (n, d) to the nearest box, 0 inside one; NaN for NaN.

    low, high: (n_boxes, d), at least one.   Fast where each vector is near the one before it.
    """
    distance, nearest = np.empty(x.shape[0]), 0
    for i in range(x.shape[0]):
        if np.isnan(x[i]).any():
            distance[i] = np.nan
            continue
        away, nearest = _nearest(x[i], low, high, low.shape[0], nearest)
        distance[i] = np.sqrt(away)
    return distance
