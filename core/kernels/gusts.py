"""Lateral gusts with Dryden's spectrum, sampled exactly."""

import numpy as np

from core.kernels.compiled import jit
from core.kernels.normals import fill_normals, stream_of


@jit
def fill_gusts(seed, fade, share, begin, noise, out, first, last):
    """Fill rows first..last-1 of `out` (n, n_samples) with gusts, each from its own stream.

    White noise passes the filter sqrt(3) / (1 + T s) + (1 - sqrt(3)) / (1 + T s)^2 with the states
    a = 1 / (1 + T s) and b = a / (1 + T s). In a step they become fade (a, b + share a) plus noise
    (3,) times two normal numbers. begin (3,): the same for the first, stationary sample. Both are
    lower triangles (11, 21, 22).
    """
    direct, twice = np.sqrt(3.0), 1.0 - np.sqrt(3.0)
    normals = np.empty(2 * out.shape[1])
    for i in range(first, last):
        fill_normals(stream_of(seed, i), normals)
        a = begin[0] * normals[0]
        b = begin[1] * normals[0] + begin[2] * normals[1]
        out[i, 0] = direct * a + twice * b
        for k in range(1, out.shape[1]):
            z0, z1 = normals[2 * k], normals[2 * k + 1]
            b = fade * (b + share * a) + noise[1] * z0 + noise[2] * z1
            a = fade * a + noise[0] * z0
            out[i, k] = direct * a + twice * b
