"""Standard deviation and peak of the channels over many samples."""

import numpy as np

from core.kernels.compiled import jit


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
