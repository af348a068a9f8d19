"""What a recorder makes of true outputs: gain, lag, noise, quantisation, trim and bias."""

from typing import NamedTuple

import numpy as np

from core.kernels import N_CHANNELS
from core.kernels.compiled import jit
from core.kernels.normals import fill_normals, stream_of, uniform
from core.types import Array

ERRORS, LAGS, NOISE = 0, 1, 2
"""Streams of a rollout."""


class Instruments(NamedTuple):
    """Errors of the six channels, (6,) each.

    gain, bias, noise: 1 sigma; bias and noise in the channel's unit.   lag: largest [steps].
    step: of the recorded value, in the channel's unit; 0: not quantised.
    """

    gain: Array
    bias: Array
    noise: Array
    lag: Array
    step: Array


@jit
def subtract_trim(y, start, every, rest, first, last):
    """Subtract from each channel of rollouts first..last-1 its mean over the samples at rest.

    y: (n, n_steps, 6); a sample each `every` steps from `start` on.   rest: (n,) samples.
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
    """Record rollouts first..last-1 of true outputs `y` into `out`, each with errors of its own.

    y, start, every, rest: as of `subtract_trim`.   out: (n, n_samples, 6), from trim.
    """
    n_samples = out.shape[1]
    noise = np.empty(N_CHANNELS * n_samples)
    errors = np.empty(2 * N_CHANNELS)
    for i in range(first, last):
        stream = stream_of(seed, i)
        fill_normals(stream_of(stream, ERRORS), errors)
        fill_normals(stream_of(stream, NOISE), noise)
        lags = stream_of(stream, LAGS)
        for c in range(N_CHANNELS):
            gain = 1.0 + instruments.gain[c] * errors[c]
            lag = instruments.lag[c] * uniform(lags, c)
            whole = int(lag)
            before = lag - whole
            sigma = instruments.noise[c]
            for k in range(n_samples):
                at = start + k * every - whole
                now, earlier = y[i, max(at, 0), c], y[i, max(at - 1, 0), c]
                value = gain * (now + before * (earlier - now))
                out[i, k, c] = value + sigma * noise[N_CHANNELS * k + c]
            step = instruments.step[c]
            if step > 0.0:
                between = uniform(lags, N_CHANNELS + c)
                for k in range(n_samples):
                    out[i, k, c] = step * (np.floor(out[i, k, c] / step + between) - between + 0.5)
            trim = 0.0
            for k in range(rest[i]):
                trim += out[i, k, c]
            trim = trim / rest[i] - instruments.bias[c] * errors[N_CHANNELS + c]
            for k in range(n_samples):
                out[i, k, c] -= trim
