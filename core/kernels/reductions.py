"""Loops over many samples: the first exceedance of a limit, the spread of channels, boxes that hold
vectors, and white residuals of Kalman filters with known gains.
"""

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


@jit
def _nearest(x, low, high, n, start):
    """Squared distance to the nearest of n boxes, 0 inside one, and its number; start: to try."""
    best, nearest = np.inf, -1
    for k in range(-1 if n else 0, n):
        box = start if k < 0 else k
        away = 0.0
        for c in range(x.shape[0]):
            beyond = max(low[box, c] - x[c], x[c] - high[box, c], 0.0)
            away += beyond * beyond
            if away >= best:
                break
        if away < best:
            best, nearest = away, box
            if away == 0.0:
                break
    return best, nearest


@jit
def grow_boxes(x, tolerance, reach):
    """Cover vectors x (n, d) with boxes, in their order; a box is never split or dropped.

    A vector at most `tolerance` from a box widens the nearest one to hold it; another one begins a
    box that reaches `reach` to each side of it.   Returns low and high, (n_boxes, d) each.
    """
    low, high = np.empty_like(x), np.empty_like(x)
    n = nearest = 0
    for i in range(x.shape[0]):
        away, nearest = _nearest(x[i], low, high, n, max(nearest, 0))
        if away <= tolerance * tolerance:
            for c in range(x.shape[1]):
                low[nearest, c] = min(low[nearest, c], x[i, c])
                high[nearest, c] = max(high[nearest, c], x[i, c])
        else:
            low[n], high[n] = x[i] - reach, x[i] + reach
            nearest = n
            n += 1
    return low[:n].copy(), high[:n].copy()


@jit
def box_distances(x, low, high):
    """Euclidean distance of vectors x (n, d) to the nearest box, 0 inside one; NaN for NaN.

    low, high: (n_boxes, d), at least one.   Fast where each vector is near the one before it.
    """
    distance, nearest = np.empty(x.shape[0]), 0
    for i in range(x.shape[0]):
        if np.isnan(x[i]).any():
            distance[i] = np.nan
            continue
        away, nearest = _nearest(x[i], low, high, low.shape[0], nearest)
        distance[i] = np.sqrt(away)
    return distance


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
