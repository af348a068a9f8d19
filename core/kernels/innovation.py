"""Innovations: how far the responses of a sample are off what the samples before it forecast.

The forecast knows the surfaces as they were measured, so what is left is noise, and how another
aircraft than the simulated ones answers to its surfaces.
"""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import jit
from core.kernels.lanes import WIDTH, read
from core.kernels.mapping import map_rows
from core.types import Array

N_RESPONSES = 4
"""Channels before the surfaces: what an aircraft does about what is done to it."""
N_BYTES = 8
"""Of a number."""


class Innovation(NamedTuple):
    """The affine map of a sample and outputs before it to its innovations.

    matrix: (6 * (n_past + 1), 8) of outputs, the oldest first.   offset: (8,).   The first four
    results are the innovations whitened across the channels, to unit covariance in training; the
    others those of each response, in its unit.   sigma: (4,) deviation of these in training.
    n_past: past outputs, `spacing` samples apart.   window: samples that are taken together; 0
    where there is no such forecast.
    """

    matrix: Array
    offset: Array
    sigma: Array
    n_past: int
    spacing: int
    window: int

    @property
    def history(self) -> int:
        """Samples before one that its forecast needs."""
        return self.n_past * self.spacing


NO_INNOVATION = Innovation(
    np.zeros((0, WIDTH)), np.zeros(WIDTH), np.ones(N_RESPONSES), n_past=0, spacing=0, window=0
)


@jit
def innovate(matrix, offset, y, row, n_past, spacing, last, slot):
    """Write the innovations of sample `row` of y (m, 6) to last[slot]; addresses of the arrays."""
    out, width = last + slot * WIDTH * N_BYTES, np.int64(WIDTH)  # a literal compiles once more
    map_rows(matrix, offset, y, out, width, row, n_past, spacing)


@jit
def root_mean_square(last, n, window, first, stop):
    """Root mean square of innovations first..stop over a window; infinite where not numbers.

    last: address of (window, 8).   n: samples in it so far; those that are missing count as zeros.
    """
    total = 0.0
    for k in range(n):
        for o in range(first, stop):
            value = read(last, k * WIDTH + o)
            total += value * value
    size = np.sqrt(total / ((stop - first) * window))
    return size if size == size else np.inf
