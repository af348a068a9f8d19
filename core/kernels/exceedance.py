"""Where trajectories first exceed a limit."""

import numpy as np

from core.kernels.compiled import jit


@jit
def first_exceedance(y, limits):
    """First sample of each trajectory at which a channel's magnitude is not below its limit.

    y: (n, n_samples, n_channels).   limits: (n_channels,), inf where there is none.
    Returns (n,) sample indices; n_samples where the limits hold throughout.
    """
    n, n_samples, n_channels = y.shape
    first = np.full(n, n_samples, np.int64)
    for c in range(n_channels):
        if limits[c] == np.inf:
            continue
        for i in range(n):
            for k in range(first[i]):
                if not abs(y[i, k, c]) < limits[c]:
                    first[i] = k
                    break
    return first
