"""One low-pass filter for every change of rate: against aliases going down, images otherwise.

A windowed sinc (Kaiser) with its middle at half of the slower of the two rates, 1/T. It keeps a
sine up to PASS/T within 0.1 %, leaves less than a thousandth of one from STOP/T on, and so lets
nothing fold back below PASS/T. It is symmetric, so that no frequency is delayed. The price is a
look ahead of HALF_WIDTH T, of which little weighs: an ideal step is felt one T before it by 9 % of
its height, two T before it by 4 %.

At its ends a segment is continued by its reflection in its own end sample, which keeps value and
slope. So each row is a weighted sum of samples of its own segment, none further than HALF_WIDTH T;
towards an end the filter does less, and the end sample itself passes as it is.
"""

from functools import lru_cache

import numpy as np

from core.kernels.decimation import decimated
from core.types import Array

PASS, STOP = 0.4, 0.6
"""Edges of the pass band and of the stop band, as shares of the slower rate."""
HALF_WIDTH = 10
"""Steps of the slower rate that the kernel reaches to either side."""
BETA = 0.1102 * (7.95 + 14.36 * (STOP - PASS) * 2 * HALF_WIDTH - 8.7)
"""Kaiser's parameter for that width and those edges: 65 dB."""
PHASES = 512
"""Places between two samples at which the kernel is tabulated; straight lines between them."""
SAME_PLACE = 1e-4
"""Rows that come to lie differently between samples by less than this share of a step share a
kernel; the largest sine of the pass band is in error by 2.5 times that."""
BLOCK = 1 << 20
"""Weights in memory at once."""


def low_passed(x: Array, first: float, stride: float, n: int) -> Array:
    """Rows at the places first, first + stride, ... of an evenly sampled segment: (n,).

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
    """n more samples on either side: the segment reflected in its end samples."""
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
    """Weights of the samples -reach ... reach + 1 for rows `place` behind sample 0: (n, 2 reach+2).

    A window's worth of constant and line is taken off, so that the weights sum to one and balance
    about the row to rounding: constants and straight lines stay what they are.
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
    """Rows that each lie elsewhere between samples, with kernels out of a table."""
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
