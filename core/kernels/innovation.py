"""Innovations: how far the responses of a sample are from their forecast.

The forecast knows the measured surfaces, so the innovations contain only noise and the difference
between the aircraft and the simulated ones.
"""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import jit
from core.kernels.lanes import WIDTH, read
from core.kernels.mapping import map_rows
from core.types import Array

N_RESPONSES = 4
"""Channels before the surfaces: the response of the aircraft."""
N_BYTES = 8
"""Size of a number."""


class Innovation(NamedTuple):
    """The affine map from a sample and past outputs to its innovations.

    matrix: (6 * (n_past + 1), 8) of outputs, oldest first.   offset: (8,).   The first four results
    are the innovations whitened to unit covariance in training, the others those of each response
    in its unit.   sigma: (4,) their deviation in training.
    n_past: past outputs, `spacing` samples apart.   window: samples to sum over; 0 without a
    forecast.
    """

    matrix: Array
    offset: Array
    sigma: Array
    n_past: int
    spacing: int
    window: int

    @property
    def history(self) -> int:
        """Samples of history that a forecast needs."""
        return self.n_past * self.spacing


NO_INNOVATION = Innovation(
    np.zeros((0, WIDTH)), np.zeros(WIDTH), np.ones(N_RESPONSES), n_past=0, spacing=0, window=0
)


@jit
def innovate(matrix, offset, y, row, n_past, spacing, last, slot):
    """Write the innovations of sample `row` of y (m, 6) to last[slot]. Arrays by address."""
    out, width = (
        last + slot * WIDTH * N_BYTES,
        np.int64(WIDTH),
    )  # a literal compiles `map_rows` again
    map_rows(matrix, offset, y, out, width, row, n_past, spacing)


@jit
def root_mean_square(last, n, window, first, stop):
    """Root mean square of innovations first..stop over a window; infinite for NaN.

    last: address of (window, 8).   n: samples in it so far; missing ones count as zeros.
    """
    total = 0.0
    for k in range(n):
        for o in range(first, stop):
            value = read(last, k * WIDTH + o)
            total += value * value
    size = np.sqrt(total / ((stop - first) * window))
    return size if size == size else np.inf
