"""Observations: the last few outputs stacked into one vector, and the times they stand for."""

import math

import numpy as np

from core.types import Array, Indices


def lead_steps(t_early: float, dt: float) -> int:
    """Whole samples h that cover the required lead: h = ceil(t_early / dt), guarded against floats.

    t_early, dt [s]. The lead in effect is h * dt.
    """
    return math.ceil(t_early / dt - 1e-9)


def observations_at(y: Array, times: Indices, n_delay: int) -> Array:
    """Observations o_t = (y_{t-n_delay}, ..., y_t), oldest first, of chosen samples.

    y: (n, n_samples, 6).   times: (n, k) sample indices.
    Before the first sample the history is padded by repeating it.
    Returns (n * k, 6 * (n_delay + 1)).
    """
    lags = np.maximum(times[..., None] - np.arange(n_delay, -1, -1), 0)
    history = _samples(y, lags)
    return history.reshape(times.size, (n_delay + 1) * y.shape[2])


def outputs_ahead(y: Array, times: Indices, h: int) -> Array:
    """Outputs y_{t+h} of chosen samples; rows of NaN where the rollout ends before.

    y: (n, n_samples, 6).   times: (n, k).   Returns (n * k, 6).
    """
    later = times + h
    ends = later >= y.shape[1]
    ahead = _samples(y, np.where(ends, 0, later))
    ahead[ends] = np.nan
    return ahead.reshape(times.size, y.shape[2])


def _samples(y: Array, times: Indices) -> Array:
    """Samples of each rollout; rows are taken one number each, which is twice as fast as by two.

    y: (n, n_samples, 6).   times: (n, ...).   Returns (n, ..., 6).
    """
    first = np.arange(len(y)).reshape(-1, *(1,) * (times.ndim - 1)) * y.shape[1]
    return y.reshape(-1, y.shape[2]).take(first + times, axis=0)


def channel_scale(y: Array) -> Array:
    """Standard deviation of each channel over safe samples; 1 for a channel that never moves.

    y: (n, 6).   Returns (6,) in the channels' units.
    """
    deviation = y.std(axis=0)
    still = deviation <= 1e-9 * np.abs(y).max(axis=0, initial=0.0)
    return np.where(still, 1.0, deviation)
