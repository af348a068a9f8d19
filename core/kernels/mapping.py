"""The compiled predictor: the affine map from an observation to the searched point."""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import in_chunks, inlined, jit
from core.kernels.lanes import WIDTH, add, address, fma, load, pick, read, splat, write
from core.types import Array, Indices

SAMPLES_A_TASK = 8_192


class Affine(NamedTuple):
    """A fitted predictor: z = o @ matrix + offset.

    matrix: (n_channels * (n_delay + 1), d).   offset: (d,).
    """

    matrix: Array
    offset: Array

    def in_units(self, scale: Array) -> "Affine":
        """The same map for observations not yet divided by `scale`."""
        return Affine(np.ascontiguousarray(self.matrix / scale[:, None]), self.offset)

    def in_lanes(self) -> "Affine":
        """The same map padded with zero columns to whole SIMD lanes."""
        missing = -len(self.offset) % WIDTH
        return Affine(
            np.pad(self.matrix, ((0, 0), (0, missing))), np.pad(self.offset, (0, missing))
        )


@inlined
def map_observation(fitted, y, i, n_delay, z):
    """Map observation o_i of y (n, n_channels) into z (d,); row 0 stands for earlier ones."""
    map_rows(
        address(fitted.matrix),
        address(fitted.offset),
        address(y),
        address(z),
        z.shape[0],
        np.int64(i),  # a literal compiles `map_rows` again
        n_delay,
        np.int64(1),
        y.shape[1],
    )


@jit
def map_rows(matrix, offset, y, z, d, i, n_delay, spacing, n_channels):
    """Map n_delay + 1 rows of y, `spacing` apart, newest last. Arrays by address."""
    for block in range(0, d, WIDTH):
        width = (d + WIDTH - 1) // WIDTH * WIDTH
        even, odd = load(offset, block), splat(0.0)  # two sums halve the latency
        for row in range(n_delay + 1):
            at = row * n_channels * width + block
            sample = max(i - (n_delay - row) * spacing, 0) * n_channels
            for c in range(0, n_channels - 1, 2):
                left, right = splat(read(y, sample + c)), splat(read(y, sample + c + 1))
                even = fma(load(matrix, at + c * width), left, even)
                odd = fma(load(matrix, at + (c + 1) * width), right, odd)
            if n_channels % 2:
                left = splat(read(y, sample + n_channels - 1))
                even = fma(load(matrix, at + (n_channels - 1) * width), left, even)
        point = add(even, odd)
        for j in range(min(WIDTH, d - block)):
            write(z, block + j, pick(point, j))


@jit
def _map_some(affine, y, where, n_delay, start, stop, z):
    for i in range(start, stop):
        map_observation(affine, y[where[i, 0]], where[i, 1], n_delay, z[i])


def map_samples(affine: Affine, y: Array, where: Indices, n_delay: int) -> Array:
    """Mapped points of chosen samples, bit for bit like a flight through them.

    y: (n, n_samples, n_channels).   where: (m, 2) trajectory and sample.   Returns (m, d).
    """
    z = np.empty((len(where), len(affine.offset)))
    lanes = affine.in_lanes()
    in_chunks(
        len(where),
        SAMPLES_A_TASK,
        lambda a, b: _map_some(lanes, y, where, n_delay, a, b, z),
    )
    return z
