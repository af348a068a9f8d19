"""Imperfections of real flights in kernels: gusts, inexact pilots, instruments.

Random numbers come from one stream per rollout, by position. A stream is an integer. Its words are
those of splitmix64 (Steele, Lea and Flood, OOPSLA 2014). Each half word becomes a normal number by
the inverse distribution: linear between tabulated quantiles, and in the tails Wichura's rational
function (AS 241, Appl. Stat. 37, 1988). Numbers are independent, so the processor computes several
at a time.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from core.kernels.compiled import jit
from core.types import Array, Flags

ERRORS, MOVES, SOFTNESS = np.int64(0), np.int64(1), np.int64(2)
LAGS, NOISE = np.int64(1), np.int64(2)
"""Streams of a pilot, and of instruments. Not literals, because `stream_of` would be compiled again
for each."""
CELLS = 2048
"""Cells of equal probability for a normal number; the outermost TAIL cells on each side are the
tails, which use the rational function."""
TAIL = 8
_QUANTILES = np.load(Path(__file__).with_name("quantiles.npy"))
"""(CELLS + 1,) scipy.special.ndtri(arange(CELLS + 1) / CELLS), stored to avoid a 0.2 s import."""
_BEYOND = float(_QUANTILES[-1 - TAIL])
_QUANTILES[[0, -1]] = _QUANTILES[[1, -2]] + np.array(
    [-1.0, 1.0]
)  # finite placeholders in the tails
_NUMERATOR = np.array(
    [7.74545014278341407640e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1,
     1.27045825245236838258, 3.64784832476320460504, 5.76949722146069140550,
     4.63033784615654529590, 1.42343711074968357734]
)  # fmt: skip
_DENOMINATOR = np.array(
    [1.05075007164441684324e-9, 5.47593808499534494600e-4, 1.51986665636164571966e-2,
     1.48103976427480074590e-1, 6.89767334985100004550e-1, 1.67638483018380384940,
     2.05319162663775882187, 1.0]
)  # fmt: skip

_STEP = np.uint64(0x9E3779B97F4A7C15)
_MIX_1, _MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31, _S32 = (np.uint64(shift) for shift in (11, 27, 30, 31, 32))
_ONE, _LOW = np.uint64(1), np.uint64(2**32 - 1)
_BITS, _SHARE = np.uint64(21), np.uint64(2**21 - 1)
"""The last bits of a half word give the position within the cell."""


@jit
def _mixed(word):
    """64 bits, each dependent on all 64 bits of `word`."""
    word = (word ^ (word >> _S30)) * _MIX_1
    word = (word ^ (word >> _S27)) * _MIX_2
    return word ^ (word >> _S31)


@jit
def _word(stream, position):
    return _mixed(np.uint64(stream) + np.uint64(position + 1) * _STEP)


@jit
def stream_of(stream, number):
    """Stream `number` derived from a stream or a seed (uint64)."""
    return _mixed(np.uint64(stream) ^ _word(stream, number))


@jit
def uniform(stream, position):
    """Uniform number in [0, 1) at a position of a stream."""
    return float(np.int64(_word(stream, position) >> _S11)) * 2.0**-53


@jit
def _half(stream, k):
    """Half word number k of a stream, 0 to 2^32 - 1."""
    word = _word(stream, k >> 1)
    return word & _LOW if k & 1 else word >> _S32


@jit
def _in_cell(half):
    cell = half >> _BITS  # unsigned, so numba need not handle negative indices
    low = _QUANTILES[cell]
    share = (float(np.int64(half & _SHARE)) + 0.5) * 2.0**-21
    return low + share * (_QUANTILES[cell + _ONE] - low)


@jit
def _in_tail(half):
    p = (float(np.int64(half)) + 0.5) * 2.0**-32
    r = math.sqrt(-math.log(min(p, 1.0 - p))) - 1.6
    above, below = 0.0, 0.0
    for i in range(len(_NUMERATOR)):
        above = above * r + _NUMERATOR[i]
        below = below * r + _DENOMINATOR[i]
    return math.copysign(above / below, p - 0.5)


@jit
def fill_normals(stream, out):
    """Fill `out` (n,), n even, with the first standard normal numbers of a stream."""
    position = np.uint64(stream)
    for k in range(len(out) // 2):
        position = position + _STEP
        word = _mixed(position)
        out[2 * k] = _in_cell(word >> _S32)
        out[2 * k + 1] = _in_cell(word & _LOW)
    for k in range(len(out)):
        if abs(out[k]) >= _BEYOND:
            out[k] = _in_tail(_half(stream, k))


@jit
def fill_gusts(seed, fade, share, begin, noise, out, first, last):
    """Fill rows first..last-1 of `out` (n, n_samples) with gusts, each from its own stream.

    White noise passes the filter sqrt(3) / (1 + T s) + (1 - sqrt(3)) / (1 + T s)^2 with the states
    a = 1 / (1 + T s) and b = a / (1 + T s). In a step they become fade (a, b + share a) plus noise
    (3,) times two normal numbers. begin (3,): the same for the first, stationary sample. Both are
    lower triangles (11, 21, 22).
    """
    direct, twice = np.sqrt(3.0), 1.0 - np.sqrt(3.0)
    normals = np.empty(2 * out.shape[1])
    for i in range(first, last):
        fill_normals(stream_of(seed, i), normals)
        a = begin[0] * normals[0]
        b = begin[1] * normals[0] + begin[2] * normals[1]
        out[i, 0] = direct * a + twice * b
        for k in range(1, out.shape[1]):
            z0, z1 = normals[2 * k], normals[2 * k + 1]
            b = fade * (b + share * a) + noise[1] * z0 + noise[2] * z1
            a = fade * a + noise[0] * z0
            out[i, k] = direct * a + twice * b


class InexactInputs(NamedTuple):
    """Errors of a pilot, 1 sigma. asymmetry: share of a command.   trim, unsteadiness: [rad].

    fade: remaining share of a small movement after one sample.
    softness: largest lag of the planned inputs [samples]; that of a rollout is uniform from 0.
    """

    asymmetry: float
    trim: float
    unsteadiness: float
    fade: float
    softness: float


@jit
def fill_commands(seed, planned, before, most, inexact, out, rest, first, last):
    """Fill rows first..last-1 of `out` (n, before + n_samples, n_surfaces) with commands [rad] as
    flown.

    planned: (1 or n, n_samples, n_surfaces), 2 or 3; trim before it.   rest: (n,) output, samples
    before the first planned input, from 1 to `most`.
    Small movements are stationary first-order processes, one per surface.
    """
    n_flown, n_surfaces = out.shape[1:]
    errors, moves = np.empty(4), np.zeros(2 * ((n_surfaces * n_flown + 1) // 2))
    gain = np.sqrt(1.0 - inexact.fade * inexact.fade)
    for i in range(first, last):
        row = i if len(planned) > 1 else 0
        stream = stream_of(seed, i)
        fill_normals(stream_of(stream, ERRORS), errors)
        if inexact.unsteadiness > 0.0:
            fill_normals(stream_of(stream, MOVES), moves)
        right = 1.0 + inexact.asymmetry * errors[n_surfaces]
        lag = inexact.softness * uniform(stream_of(stream, SOFTNESS), np.int64(0))
        behind = np.exp(-1.0 / lag) if lag > 0.0 else 0.0
        onset = most
        for s in range(n_surfaces):
            trim, move = inexact.trim * errors[s], moves[s]
            held = 0.0
            for k in range(n_flown):
                if k > 0:
                    move = inexact.fade * move + gain * moves[n_surfaces * k + s]
                command = trim + inexact.unsteadiness * move
                if k >= before:
                    due = planned[row, k - before, s]
                    if due != 0.0:
                        onset = min(onset, k - before)
                    held = behind * held + (1.0 - behind) * due
                    if held != 0.0:
                        command += held * (right if held > 0.0 else 2.0 - right)
                out[i, k, s] = command
        rest[i] = max(onset, 1)


class Instruments(NamedTuple):
    """Errors of the channels, (n_channels,) each.

    from_trim: whether a channel counts from trim; else it is absolute, and its gain error is of the
    change since the first sample.
    gain, bias, noise: 1 sigma; bias and noise in the channel's unit.   lag: largest [steps].
    step: of the recorded value, in the channel's unit; 0: no quantisation.
    """

    gain: Array
    bias: Array
    noise: Array
    lag: Array
    step: Array
    from_trim: Flags


@jit
def subtract_trim(y, start, every, rest, from_trim, first, last):
    """Subtract from channels of rollouts first..last-1 their mean over the samples at rest.

    from_trim: (n_channels,) which.
    y: (n, n_steps, n_channels); one sample every `every` steps from `start`.   rest: (n,) samples.
    """
    for i in range(first, last):
        for c in np.flatnonzero(from_trim):
            trim = 0.0
            for k in range(rest[i]):
                trim += y[i, start + k * every, c]
            trim /= rest[i]
            for k in range(y.shape[1]):
                y[i, k, c] -= trim


@jit
def record(seed, y, start, every, rest, instruments, out, first, last):
    """Record rollouts first..last-1 of true outputs `y` into `out`, each with its own errors.

    y, start, every, rest: as in `subtract_trim`.   out: (n, n_samples, n_channels), from trim or
    absolute.
    """
    n_samples, n_channels = out.shape[1:]
    noise = np.empty(2 * ((n_channels * n_samples + 1) // 2))
    errors, whole = np.empty(2 * n_channels), np.empty(n_channels, np.int64)
    before, gain = np.empty(n_channels), np.empty(n_channels)
    for i in range(first, last):
        stream = stream_of(seed, i)
        lags = stream_of(stream, LAGS)
        fill_normals(stream_of(stream, ERRORS), errors)
        fill_normals(stream_of(stream, NOISE), noise)
        for c in range(n_channels):
            lag = instruments.lag[c] * uniform(lags, c)
            whole[c], before[c] = int(lag), lag - int(lag)
            gain[c] = 1.0 + instruments.gain[c] * errors[c]
        for k in range(n_samples):
            for c in range(n_channels):
                at = start + k * every - whole[c]
                now, earlier = y[i, max(at, 0), c], y[i, max(at - 1, 0), c]
                value = now + before[c] * (earlier - now)
                if instruments.from_trim[c]:
                    value *= gain[c]
                else:
                    value = y[i, start, c] + gain[c] * (value - y[i, start, c])
                out[i, k, c] = value + instruments.noise[c] * noise[n_channels * k + c]
        for c in range(n_channels):
            if instruments.step[c] > 0.0:
                _quantise(out[i, :, c], instruments.step[c], uniform(lags, n_channels + c))
            trim = 0.0
            if instruments.from_trim[c]:
                for k in range(rest[i]):
                    trim += out[i, k, c]
            trim = trim / rest[i] - instruments.bias[c] * errors[n_channels + c]
            for k in range(n_samples):
                out[i, k, c] -= trim


@jit
def _quantise(values, step, between):
    """Round (n,) to whole steps. between: position of 0 between two steps, 0 to 1."""
    for k in range(len(values)):
        values[k] = step * (np.floor(values[k] / step + between) - between + 0.5)
