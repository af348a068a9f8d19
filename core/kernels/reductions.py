"""Reductions of many samples: the first exceedance of a limit, the spread of channels."""

import numpy as np

from core.kernels.compiled import brief, jit


@jit
def first_exceedance(y, trim, low, high):
    """First sample of each trajectory at which a channel, from trim, is not between its limits.

    y: (n, n_samples, n_channels).   trim: (1 or n, n_channels).
    low, high: (n_channels,), infinite for none.
    Returns (n,) sample indices; n_samples without an exceedance.
    """
    n, n_samples, n_channels = y.shape
    first = np.full(n, n_samples, np.int64)
    for c in range(n_channels):
        if low[c] == -np.inf and high[c] == np.inf:
            continue
        for i in range(n):
            zero = trim[min(i, len(trim) - 1), c]
            for k in range(first[i]):
                if not low[c] < y[i, k, c] - zero < high[c]:
                    first[i] = k
                    break
    return first


@brief
def exceeds_any(low, high, y):
    """Whether a channel is not between its limits; missing values do not exceed.

    low, high, y: (n_channels,).
    """
    exceeds = False
    for c in range(y.shape[0]):
        exceeds |= np.isfinite(y[c]) and not low[c] < y[c] < high[c]
    return exceeds


@jit
def spread(y):
    """Standard deviation and largest magnitude of each column of y (n, m), n >= 1.

    Summed in row order like numpy, but in two passes instead of six.
    """
    n, m = y.shape
    mean, square, peak = np.zeros(m), np.zeros(m), np.zeros(m)
    for i in range(n):
        for k in range(m):
            mean[k] += y[i, k]
            peak[k] = max(peak[k], abs(y[i, k]))
    mean /= n
    for i in range(n):
        for k in range(m):
            away = y[i, k] - mean[k]
            square[k] += away * away
    return np.sqrt(square / n), peak
