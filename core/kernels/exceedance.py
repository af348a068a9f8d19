"""First exceedance of a limit."""

import numpy as np

from core.kernels.compiled import brief, jit


@jit
def first_exceedance(y, limits):
    """First sample of each trajectory at which a channel's magnitude is not below its limit.

    y: (n, n_samples, n_channels).   limits: (n_channels,), inf for none.
    Returns (n,) sample indices; n_samples without an exceedance.
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


@brief
def exceeds_any(limits, y):
    """Whether a channel exceeds its limit; missing values do not.

    limits, y: (n_channels,).
    """
    exceeds = False
    for c in range(limits.shape[0]):
        exceeds |= np.isfinite(y[c]) and abs(y[c]) >= limits[c]
    return exceeds
