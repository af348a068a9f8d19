"""Conformal p-values of single scores, compiled: the simple one and the exact one."""

from typing import NamedTuple

import numpy as np

from core.kernels.calibration_tree import (
    NOTHING,
    CalibrationTree,
    build_calibration_tree,
    n_staying,
)
from core.kernels.compiled import inlined, jit
from core.types import Array, Indices


class Transduction(NamedTuple):
    """Arrays of the exact p-value, which recalibrates with the test point among the unsafe points.

    points: (n, d) mapped samples of the failures' histories; failure i has start[i]:start[i+1].
    unsafe, safe: (n,) their weighted squared distances, without own failure.
    alphas: (n_failures,) in the order of `start`.
    always: failures too early for a warning.   running: score a flight by its lowest so far.
    tree: search tree of the samples, see `indexed`.
    Empty arrays select the simple p-value (SIMPLE).
    """

    points: Array
    unsafe: Array
    safe: Array
    start: Indices
    alphas: Array
    always: int
    running: bool
    tree: CalibrationTree = NOTHING

    def indexed(self) -> "Transduction":
        """Copy with the search tree, which p-values need."""
        tree = build_calibration_tree(self.points, self.unsafe, self.safe, self.start, self.alphas)
        return self._replace(tree=tree)


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


@inlined
def _exact_p(fitted, exact, z, s):
    """p-value with z added to the unsafe points; never above the simple one at the same s."""
    staying = n_staying(exact.tree, fitted.unsafe_weight, z, s)
    return (exact.always + staying + 1) / (fitted.alphas.shape[0] + 1)


@inlined
def p_value_of(fitted, exact, z, s, lowest):
    """p-value of point z with score s; NaN for none.

    fitted: has `alphas` and `unsafe_weight`.
    lowest: the flight's lowest score so far, this one included.
    """
    if exact.start.shape[0] == 0:
        return _simple_p(fitted.alphas, s)
    return _exact_p(fitted, exact, z, lowest if exact.running else s)
