"""Observations: the last few outputs stacked into one vector."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from core.kernels.reductions import spread
from core.types import Array, Indices


def lead_steps(t_early: float, dt: float) -> int:
    """Whole samples h that cover the required lead: h = ceil(t_early / dt), safe against rounding.

    t_early, dt [s]. The effective lead is h * dt.
    """
    return math.ceil(t_early / dt - 1e-9)


class RowSource(Protocol):
    """Rows read in slices: an array, or an object that computes them on demand."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, rows: slice, /) -> Array: ...


@dataclass(frozen=True)
class Observations:
    """Observations o_t = (y_{t-n_delay}, ..., y_t), oldest first, of chosen samples.

    y: (n, n_samples, 6).   times: (n, k) sample indices.   scale: (6,) divisors of the outputs.
    History before the first sample repeats the first sample.
    """

    y: Array
    times: Indices
    n_delay: int
    scale: Array

    @property
    def shape(self) -> tuple[int, int]:
        """(n * k, 6 * (n_delay + 1))."""
        return self.times.size, (self.n_delay + 1) * self.y.shape[2]

    def __getitem__(self, rows: slice, /) -> Array:
        rollouts, times = _chosen(self.times, rows)
        lags = np.maximum(times[:, None] - np.arange(self.n_delay, -1, -1), 0)
        history = _samples(self.y, rollouts[:, None], lags)
        history /= self.scale
        return history.reshape(len(times), -1)


@dataclass(frozen=True)
class OutputsAhead:
    """Outputs y_{t+h} of chosen samples; rows of NaN if the rollout ends earlier.

    y: (n, n_samples, 6).   times: (n, k).   scale: (6,) divisors of the outputs.
    """

    y: Array
    times: Indices
    h: int
    scale: Array

    @property
    def shape(self) -> tuple[int, int]:
        """(n * k, 6)."""
        return self.times.size, self.y.shape[2]

    def __getitem__(self, rows: slice, /) -> Array:
        rollouts, times = _chosen(self.times, rows)
        later = times + self.h
        ends = later >= self.y.shape[1]
        ahead = _samples(self.y, rollouts, np.where(ends, 0, later))
        ahead /= self.scale
        ahead[ends] = np.nan
        return ahead


def _chosen(times: Indices, rows: slice) -> tuple[Indices, Indices]:
    """Rollout and sample index of the given rows, which run rollout by rollout."""
    start, stop, step = rows.indices(times.size)
    return np.arange(start, stop, step) // times.shape[1], times.ravel()[rows]


def _samples(y: Array, rollouts: Indices, times: Indices) -> Array:
    """y[rollouts, times]; one flat index is twice as fast as two."""
    return y.reshape(-1, y.shape[2]).take(rollouts * y.shape[1] + times, axis=0)


def channel_peaks(y: Array) -> Array:
    """Largest magnitude of each channel, ignoring NaN.

    y: (n, n_samples, 6).   Returns (6,) in the channels' units.
    """
    # First over the rollouts: several times faster on contiguous numbers.
    highest, lowest = np.fmax.reduce(y, axis=0), np.fmin.reduce(y, axis=0)
    return np.fmax(np.fmax.reduce(highest), -np.fmin.reduce(lowest))


def channel_scale(y: Array) -> Array:
    """Standard deviation of each channel over safe samples; 1 for a channel that never moves.

    y: (n, 6).   Returns (6,) in the channels' units.
    """
    deviation, peak = spread(y)
    still = deviation <= 1e-9 * peak
    return np.where(still, 1.0, deviation)
