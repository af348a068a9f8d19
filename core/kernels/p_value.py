"""Conformal p-values of single scores, compiled: the simple one and the exact one."""

from typing import NamedTuple

import numpy as np

from core.kernels.compiled import inlined, jit
from core.types import Array, Indices


class Transduction(NamedTuple):
    """What the exact p-value needs to calibrate anew with the test point among the unsafe ones.

    points: (n, d) mapped samples of the failures' histories; failure i owns start[i]:start[i+1].
    unsafe, safe: (n,) their weighted squared distances, own failure left out.
    alphas: (n_failures,) in the order of `start`.
    always: failures too early to be warned of.   running: score a flight by its lowest so far.
    Empty arrays mean the simple p-value (SIMPLE).
    """

    points: Array
    unsafe: Array
    safe: Array
    start: Indices
    alphas: Array
    always: int
    running: bool


SIMPLE = Transduction(
    np.empty((0, 1)), np.empty(0), np.empty(0), np.empty(0, np.int64), np.empty(0), 0, False
)


@inlined
def _simple_p(alphas, s):
    n = alphas.shape[0]
    if np.isnan(s):
        return np.nan
    return (n - np.searchsorted(alphas, s) + 1) / (n + 1)


@jit
def simple_p(alphas, s):
    """Simple p-value of a score; NaN for none."""
    return _simple_p(alphas, s)


@jit
def _exact_p(fitted, exact, z, s):
    """p-value with z joined to the unsafe points; never above the simple one at the same s."""
    count = exact.always
    for i in range(exact.alphas.shape[0]):
        if exact.alphas[i] < s:
            continue
        stays = 1
        for j in range(exact.start[i], exact.start[i + 1]):
            total = 0.0
            for k in range(z.shape[0]):
                e = z[k] - exact.points[j, k]
                total += e * e
            if min(exact.unsafe[j], fitted.unsafe_weight * total) - exact.safe[j] < s:
                stays = 0
                break
        count += stays
    return (count + 1) / (fitted.alphas.shape[0] + 1)


@inlined
def p_value_of(fitted, exact, z, s, lowest):
    """p-value of point z with score s; NaN for none.

    fitted: what holds `alphas` and `unsafe_weight`.
    lowest: the flight's lowest score so far, this one included.
    """
    if exact.start.shape[0] == 0:
        return _simple_p(fitted.alphas, s)
    return _exact_p(fitted, exact, z, lowest if exact.running else s)
