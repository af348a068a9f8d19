"""How instruments record true outputs: gain, lag, noise, quantisation, trim and bias."""

from typing import NamedTuple

import numpy as np

from core.kernels import N_CHANNELS
from core.kernels.compiled import jit
from core.kernels.normals import fill_normals, stream_of, uniform
from core.types import Array

ERRORS, LAGS, NOISE = np.int64(0), np.int64(1), np.int64(2)
"""Streams of a rollout. Not literals, because `stream_of` would be compiled again for each."""


class Instruments(NamedTuple):
    """Errors of the six channels, (6,) each.

    gain, bias, noise: 1 sigma; bias and noise in the channel's unit.   lag: largest [steps].
    step: of the recorded value, in the channel's unit; 0: no quantisation.
    """

    gain: Array
    bias: Array
    noise: Array
    lag: Array
    step: Array


@jit
def subtract_trim(y, start, every, rest, first, last):
    """Subtract from each channel of rollouts first..last-1 its mean over the samples at rest.

    y: (n, n_steps, 6); one sample every `every` steps from `start`.   rest: (n,) samples.
    """
    for i in range(first, last):
        for c in range(N_CHANNELS):
            trim = 0.0
            for k in range(rest[i]):
                trim += y[i, start + k * every, c]
            trim /= rest[i]
            for k in range(y.shape[1]):
                y[i, k, c] -= trim


@jit
def record(seed, y, start, every, rest, instruments, out, first, last):
    """Record rollouts first..last-1 of true outputs `y` into `out`, each with its own errors.

    y, start, every, rest: as in `subtract_trim`.   out: (n, n_samples, 6), from trim.
    """
    n_samples = out.shape[1]
    noise, errors = np.empty(N_CHANNELS * n_samples), np.empty(2 * N_CHANNELS)
    whole, before, gain = np.empty(N_CHANNELS, np.int64), np.empty(N_CHANNELS), np.empty(N_CHANNELS)
    for i in range(first, last):
        stream = stream_of(seed, i)
        lags = stream_of(stream, LAGS)
        fill_normals(stream_of(stream, ERRORS), errors)
        fill_normals(stream_of(stream, NOISE), noise)
        for c in range(N_CHANNELS):
            lag = instruments.lag[c] * uniform(lags, c)
            whole[c], before[c] = int(lag), lag - int(lag)
            gain[c] = 1.0 + instruments.gain[c] * errors[c]
        for k in range(n_samples):
            for c in range(N_CHANNELS):
                at = start + k * every - whole[c]
                now, earlier = y[i, max(at, 0), c], y[i, max(at - 1, 0), c]
                value = gain[c] * (now + before[c] * (earlier - now))
                out[i, k, c] = value + instruments.noise[c] * noise[N_CHANNELS * k + c]
        for c in range(N_CHANNELS):
            if instruments.step[c] > 0.0:
                _quantise(out[i, :, c], instruments.step[c], uniform(lags, N_CHANNELS + c))
            trim = 0.0
            for k in range(rest[i]):
                trim += out[i, k, c]
            trim = trim / rest[i] - instruments.bias[c] * errors[N_CHANNELS + c]
            for k in range(n_samples):
                out[i, k, c] -= trim


@jit
def _quantise(values, step, between):
    """Round (n,) to whole steps. between: position of 0 between two steps, 0 to 1."""
    for k in range(len(values)):
        values[k] = step * (np.floor(values[k] / step + between) - between + 0.5)
