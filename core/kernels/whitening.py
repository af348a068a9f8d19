"""White residuals of Kalman filters with known gains, one record after the other."""

import numpy as np

from core.kernels.compiled import jit


@jit
def whiten(f, h, gain, root, y, start, white):
    """Filter the records of c variants of each of n models.

    f: (n, c, k, k).   h: (n, c, m, k).   gain: (n, n_settled, k, m), root: (n, n_settled, m, m)
    lower triangular; the last ones apply to all later samples.   y: (n or 1, c or 1, n_samples, m).
    start: (n, c, k) state at the first sample.   white: (n, c, n_samples, m) output.
    """
    n, c, k = start.shape
    m, n_samples, last = h.shape[2], y.shape[2], gain.shape[1] - 1
    gains = np.empty((last + 1, m, k))
    across, seen = np.empty((k, k)), np.empty((k, m))  # columns as rows: products add whole vectors
    residual, state, following = np.empty(m), np.empty(k), np.empty(k)
    for i in range(n):
        for s in range(last + 1):
            gains[s] = gain[i, s].T
        for j in range(c):
            across[:], seen[:] = f[i, j].T, h[i, j].T
            record = y[min(i, y.shape[0] - 1), min(j, y.shape[1] - 1)]
            for a in range(k):
                state[a] = start[i, j, a]
            for sample in range(n_samples):
                s = min(sample, last)
                for a in range(m):
                    residual[a] = record[sample, a]
                for b in range(k):
                    for a in range(m):
                        residual[a] -= seen[b, a] * state[b]
                for a in range(m):
                    rest = 0.0
                    for b in range(a + 1):
                        rest += root[i, s, a, b] * residual[b]
                    white[i, j, sample, a] = rest
                for b in range(m):
                    for a in range(k):
                        state[a] += gains[s, b, a] * residual[b]
                for a in range(k):
                    following[a] = 0.0
                for b in range(k):
                    for a in range(k):
                        following[a] += across[b, a] * state[b]
                for a in range(k):
                    state[a] = following[a]
