"""The forecast whose innovations validity is judged by, fitted on rollouts of training."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from core.channels import N_CHANNELS
from core.dataset import Dataset
from core.kernels.innovation import N_RESPONSES, NO_INNOVATION, Innovation
from core.monitor.observation import channel_scale
from core.monitor.predictor import PREDICTORS
from core.types import Array

N_PAST = 4
"""Past outputs of a forecast: with SPACING_S they reach back 0.4 s. Over all pairs of aircraft that
leaves a worst pair of .005 of the failing flights valid and missed; 0.2 s leave .12 in some draws,
and with 0.6 s aircraft that fail as early are not compared: .2."""
SPACING_S = 0.1
"""Between past outputs [s]."""
WINDOW_S = 0.5
"""Over which innovations are summed [s]."""
FINEST = 1e-3
"""Least deviation of an innovation, as a share of the channel's; of a channel that never moves, in
its SI unit (N_y in g): 1 mrad, 1 mrad/s, 1 mg, about what a sensor resolves."""
NOW = slice(N_CHANNELS * N_PAST, N_CHANNELS * N_PAST + N_RESPONSES)
"""The responses to be forecast, in a sample with its past outputs."""
MOST_SAMPLES = 200_000
"""Of safe rollouts that are fitted, and of unsafe ones: enough for any digit that matters."""


def fit_innovation(dataset: Dataset) -> Innovation:
    """Fit the responses of a sample to the outputs before it and to its own surfaces.

    By least squares on safe and unsafe rollouts; of least norm where channels depend on each other,
    so that a channel which never moves has no weight. Innovations are whitened by their covariance.
    None is tested where rollouts are too short for one.
    """
    spacing = max(1, round(SPACING_S / dataset.dt))
    most = max(1, MOST_SAMPLES // dataset.safe.shape[1])
    flights = dataset.safe[:most], dataset.unsafe[:most]
    o = np.concatenate([_observations(y, spacing) for y in flights])
    if not len(o):
        return NO_INNOVATION
    known, responses = np.delete(o, NOW, axis=1), o[:, NOW]
    units, scale = channel_scale(known), channel_scale(responses)
    forecast = PREDICTORS["linear"].fit(known / units, responses).in_units(units)
    innovations = responses - (known @ forecast.matrix + forecast.offset)
    covariance = innovations.T @ innovations / len(innovations) + np.diag((FINEST * scale) ** 2)
    own = np.insert(-forecast.matrix, NOW.start, np.eye(N_RESPONSES), axis=0)
    white = np.linalg.inv(np.linalg.cholesky(covariance)).T
    return Innovation(
        matrix=np.hstack([own @ white, own]),
        offset=np.hstack([-forecast.offset @ white, -forecast.offset]),
        sigma=np.sqrt(np.diag(covariance)),
        n_past=N_PAST,
        spacing=spacing,
        window=max(1, round(WINDOW_S / dataset.dt)),
    )


def _observations(y: Array, spacing: int) -> Array:
    """(m, 6 * (N_PAST + 1)) each sample that has enough before it, with its past outputs.

    y: (n, n_samples, 6), NaN after a failure.   The oldest outputs come first.
    """
    history = N_PAST * spacing
    if y.shape[1] <= history:
        return np.empty((0, N_CHANNELS * (N_PAST + 1)))
    windows = sliding_window_view(y, history + 1, axis=1)[..., ::spacing].swapaxes(2, 3)
    there = np.isfinite(windows[:, :, -1]).all(axis=2)
    return windows[there].reshape(-1, N_CHANNELS * (N_PAST + 1))
