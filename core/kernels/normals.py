"""Random numbers in kernels: one stream per rollout, numbers by position.

A stream is an integer. Its words are those of splitmix64 (Steele, Lea and Flood, OOPSLA 2014). Each
half word becomes a normal number by the inverse distribution: linear between tabulated quantiles,
and in the tails Wichura's rational function (AS 241, Appl. Stat. 37, 1988). Numbers are
independent, so the processor computes several at a time.
"""

import math
from pathlib import Path

import numpy as np

from core.kernels.compiled import jit

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
