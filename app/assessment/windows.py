"""Moving-window filters; the first and last samples extend beyond the ends.

Same results as scipy.ndimage, which takes half a second to import.
"""

import numpy as np

from core.types import Array


def medians_of_three(x: Array) -> Array:
    """Median of each sample and its neighbours.   x: (n,)."""
    before, after = np.append(x[:1], x[:-1]), np.append(x[1:], x[-1:])
    return np.maximum(np.minimum(before, after), np.minimum(np.maximum(before, after), x))


def running_mean(x: Array, size: int) -> Array:
    """Mean of the window around each sample, by a running sum.

    x: (n, k).   size: odd.
    """
    wide = _extended(x, size)
    first = np.add.accumulate(wide[:size], axis=0)[-1:]
    changes = wide[size:] - wide[: len(x) - 1]
    return np.add.accumulate(np.concatenate([first, changes]), axis=0) / size


def extent(x: Array, size: int) -> Array:
    """Largest minus smallest value in the window around each sample.

    x: (n, k).   size: odd.
    """
    wide = _extended(x, size)
    return _extreme(np.maximum, wide, size) - _extreme(np.minimum, wide, size)


def _extended(x: Array, size: int) -> Array:
    return np.pad(x, ((size // 2, size // 2), (0, 0)), mode="edge")


def _extreme(of_two: np.ufunc, wide: Array, size: int) -> Array:
    """Extreme of each `size` samples, by doubling the window."""
    window = 1
    while 2 * window <= size:
        wide, window = of_two(wide[:-window], wide[window:]), 2 * window
    return of_two(wide[: len(wide) - (size - window)], wide[size - window :])
