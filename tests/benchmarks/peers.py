"""Plain glue that an engineer would write instead: the peers that benchmarks compare with."""

from collections import deque

import numpy as np
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from core.monitor import Monitor


class CKDTreeMonitor:
    """The monitor's live path from numpy and scipy's cKDTree."""

    def __init__(self, monitor: Monitor) -> None:
        self.matrix, self.offset = monitor.affine
        self.unsafe = cKDTree(np.unique(monitor.unsafe_points, axis=0))
        self.safe = cKDTree(np.unique(monitor.safe_points, axis=0))
        self.alphas, self.n_delay = monitor.alphas, monitor.recipe.n_delay
        self.history: deque[np.ndarray] = deque(maxlen=self.n_delay + 1)

    def update(self, y: np.ndarray) -> float:
        """p-value of the next sample."""
        if not self.history:
            self.history.extend([y] * self.n_delay)
        self.history.append(y)
        z = np.concatenate(self.history) @ self.matrix + self.offset
        s = self.unsafe.query(z)[0] ** 2 - self.safe.query(z)[0] ** 2
        n = len(self.alphas)
        return (n - np.searchsorted(self.alphas, s) + 1) / (n + 1)

    def p_values(self, y: np.ndarray, workers: int = 1) -> np.ndarray:
        """p-value of every sample of a trajectory."""
        padded = np.vstack([np.repeat(y[:1], self.n_delay, axis=0), y])
        windows = np.lib.stride_tricks.sliding_window_view(padded, self.n_delay + 1, axis=0)
        o = windows.transpose(0, 2, 1).reshape(len(y), -1)
        z = o @ self.matrix + self.offset
        unsafe = self.unsafe.query(z, workers=workers)[0]
        s = unsafe**2 - self.safe.query(z, workers=workers)[0] ** 2
        n = len(self.alphas)
        return (n - np.searchsorted(self.alphas, s) + 1) / (n + 1)
