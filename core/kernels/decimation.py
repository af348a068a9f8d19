"""A filter that computes only every `stride`-th row of its output."""

import numpy as np

from core.kernels.compiled import jit
from core.types import Array


@jit
def decimated(x: Array, weights: Array, stride: int, n: int) -> Array:
    """(n,) rows: row k is the sum of weights[i] x[k stride + i], in the order of i.

    x: at least ((n - 1) stride + n_weights,). Four rows at a time, because each sum is serial.
    """
    rows = np.empty(n)
    n_weights = len(weights)
    for first in range(0, n - 3, 4):
        begin = first * stride
        a = b = c = d = 0.0
        for i in range(n_weights):
            weight, at = weights[i], begin + i
            a += weight * x[at]
            b += weight * x[at + stride]
            c += weight * x[at + 2 * stride]
            d += weight * x[at + 3 * stride]
        rows[first], rows[first + 1], rows[first + 2], rows[first + 3] = a, b, c, d
    for k in range(n - n % 4, n):
        total = 0.0
        for i in range(n_weights):
            total += weights[i] * x[k * stride + i]
        rows[k] = total
    return rows
