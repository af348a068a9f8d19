"""The forecast whose innovations determine validity, fitted on training rollouts."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from core.dataset import Dataset
from core.kernels.deviation import NO_INNOVATION, Innovation
from core.kernels.lanes import WIDTH
from core.monitor.observation import channel_scale
from core.monitor.predictor import PREDICTORS
from core.types import Array, Indices

N_PAST = 4
"""Past outputs of a forecast. With SPACING_S they reach back 0.4 s. In the worst pair of aircraft,
0.005 of the failing flights are then valid and missed; with 0.2 s it is 0.12 in some draws, and
with 0.6 s, where aircraft that fail early are not compared, 0.2."""
SPACING_S = 0.1
"""Interval between past outputs [s]."""
WINDOW_S = 0.5
"""Window over which innovations are summed [s]."""
FINEST = 1e-3
"""Smallest deviation of an innovation, as a share of the channel's. For a channel that never moves,
in its SI unit (N_y in g): 1 mrad, 1 mrad/s, 1 mg, about the resolution of a sensor."""
PILOT = "pilot"
"""In the recipe of a dataset: who is in the loop."""
STEADY = 10.0
"""Largest kurtosis of the innovations of a surface that a pilot moves smoothly: 3 to 6 for tracked
surfaces, 25 to 50 for those that a doublet or a capture steps."""
MOST_SAMPLES = 200_000
"""Samples to fit, of safe and of unsafe rollouts each: enough for all significant digits."""


def fit_innovation(dataset: Dataset) -> Innovation:
    """Fit the responses of a sample to the past outputs and to its surfaces.

    Least squares on safe and unsafe rollouts, of least norm if channels are dependent, so that a
    channel that never moves has no weight. Innovations are whitened by their covariance. Rollouts
    too short for a forecast give NO_INNOVATION.

    With a pilot in the loop, surfaces are responses too, to the past alone, because other pilots
    move them otherwise. They weigh as much as all outputs together; those that the manoeuvre itself
    steps cannot be forecast, and weigh nothing.
    """
    dictionary, spacing = dataset.dictionary, max(1, round(SPACING_S / dataset.dt))
    most = max(1, MOST_SAMPLES // dataset.safe.shape[1])
    flights = dataset.safe[:most], dataset.unsafe[:most]
    o = np.concatenate([_observations(y, spacing) for y in flights])
    outputs, surfaces = dictionary.of_role("output"), dictionary.of_role("control")
    if not len(o) or not outputs:
        return NO_INNOVATION
    sample = o.shape[1] - len(dictionary)
    now = sample + np.array(outputs)
    residuals = _residuals(o, now, now)
    if surfaces and PILOT in dataset.recipe:
        of_surfaces = _residuals(o, sample + np.array(surfaces), np.arange(sample, o.shape[1]))
        pairs = zip(residuals, of_surfaces, strict=True)
        residuals = tuple(np.concatenate(pair, axis=-1) for pair in pairs)
    maps, offsets, innovations, scales = residuals
    n = len(scales)
    covariance = innovations.T @ innovations / len(innovations) + np.diag((FINEST * scales) ** 2)
    weights = np.ones(n)
    if n > len(outputs):
        tails = np.mean(innovations**4, axis=0) / np.maximum(np.diag(covariance) ** 2, 1e-300)
        steady = tails[len(outputs) :] < STEADY
        weights[len(outputs) :] = steady * len(outputs) / max(np.count_nonzero(steady), 1)
        covariance *= np.outer(weights > 0, weights > 0) | np.eye(n, dtype=bool)
    white = np.linalg.inv(np.linalg.cholesky(covariance)).T * np.sqrt(weights)
    rest, judged = -2 * n % WIDTH, weights > 0
    return Innovation(
        matrix=np.hstack([maps @ white, maps * judged, np.zeros((len(maps), rest))]),
        offset=np.hstack([offsets @ white, offsets * judged, np.zeros(rest)]),
        sigma=np.sqrt(np.diag(covariance)),
        n_past=N_PAST,
        spacing=spacing,
        window=max(1, round(WINDOW_S / dataset.dt)),
    )


def _residuals(o: Array, now: Indices, unknown: Indices) -> tuple[Array, ...]:
    """Map (n_observed, k) and offset (k,) from observations o (m, n_observed) to the errors of a
    forecast of their columns `now`, from all but those `unknown`; the errors (m, k), and the scale
    (k,) of these columns."""
    known, responses = np.delete(o, unknown, axis=1), o[:, now]
    units, scale = channel_scale(known), channel_scale(responses)
    forecast = PREDICTORS["linear"].fit(known / units, responses).in_units(units)
    innovations = responses - (known @ forecast.matrix + forecast.offset)
    residual_map = np.zeros((o.shape[1], len(now)))
    residual_map[np.delete(np.arange(len(residual_map)), unknown)] = -forecast.matrix
    residual_map[now] = np.eye(len(now))
    return residual_map, -forecast.offset, innovations, scale


def _observations(y: Array, spacing: int) -> Array:
    """(m, n_channels * (N_PAST + 1)) each sample with enough history, with its past outputs.

    y: (n, n_samples, n_channels), NaN after a failure.   The oldest outputs come first.
    """
    history, width = N_PAST * spacing, y.shape[2] * (N_PAST + 1)
    if y.shape[1] <= history:
        return np.empty((0, width))
    windows = sliding_window_view(y, history + 1, axis=1)[..., ::spacing].swapaxes(2, 3)
    known = np.isfinite(windows[:, :, -1]).all(axis=2)
    return windows[known].reshape(-1, width)
