"""A low-pass filter for every change of rate, against aliases and images.

A windowed sinc (Kaiser) with its cutoff at half the slower of the two rates, 1/T. It keeps a sine
up to PASS/T within 0.1 % and reduces one above STOP/T below 1/1000, so nothing aliases below
PASS/T. It is symmetric and so delays no frequency. It looks ahead by HALF_WIDTH T, with small
weights: an ideal step appears one T early with 9 % of its height, two T early with 4 %.

At its ends a segment continues as its reflection in the end sample, which keeps value and slope. So
each row is a weighted sum of samples of its own segment, at most HALF_WIDTH T away. The filter
weakens towards an end, and the end sample passes unchanged.
"""

from functools import lru_cache

import numpy as np

from core.kernels.decimation import decimated
from core.types import Array

PASS, STOP = 0.4, 0.6
"""Edges of the pass band and of the stop band, as shares of the slower rate."""
HALF_WIDTH = 10
"""Half width of the kernel, in steps of the slower rate."""
BETA = 0.1102 * (7.95 + 14.36 * (STOP - PASS) * 2 * HALF_WIDTH - 8.7)
"""Kaiser's parameter for that width and those edges: 65 dB."""
PHASES = 512
"""Positions between two samples in the table of kernels, interpolated linearly."""
SAME_PLACE = 1e-4
"""Rows whose position between samples differs by less than this share of a step share a kernel. The
error of the largest sine in the pass band is 2.5 times that."""
BLOCK = 1 << 20
"""Most weights in memory at once."""


def low_passed(x: Array, first: float, stride: float, n: int) -> Array:
    """Rows at the positions first, first + stride, ... of an evenly sampled segment: (n,).

    x: (n_samples >= 2,) finite.   first, stride: in samples, whole or not; every row lies between
    the first and the last sample. T is one sample or one stride, the longer of the two.
    """
    slower = round(max(1.0, stride), 4)
    reach = int(np.ceil(HALF_WIDTH * slower))
    padded = _continued(x, reach + 1)
    step = round(stride)
    if step and abs(stride - step) * n < SAME_PLACE:
        begin = max(0, int(np.floor(first)))
        weights = _kernel(round(first - begin, 9), reach, slower)
        return decimated(padded[begin + 1 :], weights, step, n)
    return _swept(padded, first, stride, n, _table(reach, slower))


def _continued(x: Array, n: int) -> Array:
    """The segment with n more samples on either side, reflected in its end samples."""
    if len(x) <= n:
        return np.pad(x, n, "reflect", reflect_type="odd")
    before, after = 2.0 * x[0] - x[n:0:-1], 2.0 * x[-1] - x[-2 : -n - 2 : -1]
    return np.concatenate([before, x, after])


@lru_cache(64)
def _kernel(place: float, reach: int, slower: float) -> Array:
    return _kernels(np.array([place]), reach, slower)[0]


@lru_cache(8)
def _table(reach: int, slower: float) -> Array:
    return _kernels(np.arange(PHASES + 1) / PHASES, reach, slower)


def _kernels(place: Array, reach: int, slower: float) -> Array:
    """Weights of the samples -reach ... reach + 1 for rows `place` after sample 0: (n, 2 reach+2).

    Windowed constant and linear terms are subtracted, so that the weights sum to one and balance
    about the row: constants and straight lines pass unchanged.
    """
    distance = (np.arange(-reach, reach + 2) - place[:, None]) / slower
    inside = np.sqrt(np.clip(1.0 - (distance / HALF_WIDTH) ** 2, 0.0, None))
    window = np.where(np.abs(distance) <= HALF_WIDTH, np.i0(BETA * inside), 0.0)
    weights = np.sinc(distance) * window
    weights /= weights.sum(axis=1, keepdims=True)
    for _ in range(2):  # the second pass removes the rounding of the first
        excess, lean = weights.sum(axis=1) - 1.0, (weights * distance).sum(axis=1)
        w0, w1, w2 = ((window * distance**k).sum(axis=1) for k in range(3))
        constant = (excess * w2 - lean * w1) / (w0 * w2 - w1 * w1)
        slope = (lean * w0 - excess * w1) / (w0 * w2 - w1 * w1)
        weights -= (constant[:, None] + slope[:, None] * distance) * window
    return weights


def _swept(padded: Array, first: float, stride: float, n: int, table: Array) -> Array:
    """Rows at varying positions between samples, with kernels from a table."""
    windows = np.lib.stride_tricks.sliding_window_view(padded, table.shape[1])
    rows = np.empty(n)
    size = max(1, BLOCK // table.shape[1])
    for begin in range(0, n, size):
        place = np.maximum(first + stride * np.arange(begin, min(n, begin + size)), 0.0)
        sample = place.astype(np.intp)
        phase = (place - sample) * PHASES
        entry = phase.astype(np.intp)
        further = phase - entry
        near = windows[sample + 1]
        rows[begin : begin + size] = (1.0 - further) * np.einsum("ij,ij->i", near, table[entry])
        rows[begin : begin + size] += further * np.einsum("ij,ij->i", near, table[entry + 1])
    return rows
