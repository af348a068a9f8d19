"""Prediction of the next point by simulated flights alone, for any aircraft that can be flown.

The filter-error method needs a linear aircraft. For others, simulated aircraft of D_theta fly the
steps and the next point, and a ridge regression predicts the logarithm of the peak from what each
channel did at the steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from core.limits.limits import Envelope
from core.monitor.peak_ridge import Regressors
from core.types import Array

LEAST_PART = 1e-3
"""Smallest part of a limit whose logarithm is taken."""
LEAST_SPREAD = 1e-3
"""Smallest deviation of a principal feature, as a share of the largest one."""


@dataclass(frozen=True, eq=False)
class PeakRegression:
    """Regression of the next peak on the steps before it, from flights of n simulated aircraft.

    weights, constant: of the features.   residuals: (n,) sorted, each left out.   centers, roots:
    of the features of the steps up to each one, which `roots` whitens.
    """

    limits: Envelope
    weights: Array
    constant: float
    residuals: Array
    centers: tuple[Array, ...]
    roots: tuple[Array, ...]

    @classmethod
    def fit(cls, records: Sequence[Array], peaks: Array, limits: Envelope) -> Self:
        """records: (n, n_samples, n_channels) of each step.   peaks: (n,) logarithms."""
        steps = [features(y, limits) for y in records]
        weights, constant, residuals = Regressors(np.hstack(steps), np.ones(len(peaks))).ridge(
            peaks
        )
        centers, roots = [], []
        for k in range(1, len(steps) + 1):
            x = np.hstack(steps[:k])
            deviation = x.std(axis=0)
            moves = deviation > 1e-9 * np.abs(x).max(axis=0)
            scale = np.where(moves, 1.0 / np.where(moves, deviation, 1.0), 0.0)
            z = (x - x.mean(axis=0)) * scale
            _, size, along = np.linalg.svd(z / len(z) ** 0.5, full_matrices=False)
            is_large = size > LEAST_SPREAD * size[0]
            centers.append(x.mean(axis=0))
            roots.append(scale[:, np.newaxis] * along[is_large].T / size[is_large])
        return cls(limits, weights, constant, np.sort(residuals), tuple(centers), tuple(roots))

    def predict(self, records: Sequence[Array]) -> tuple[Array, Array]:
        """Mean logarithm of the peak (n,), and (n, n_steps) mean square by which the steps up to
        each one differ from those of simulated aircraft, about 1 if they do not."""
        steps = [features(y, self.limits) for y in records]
        unlike = [
            np.square((np.hstack(steps[: k + 1]) - center) @ root).mean(axis=1)
            for k, (center, root) in enumerate(zip(self.centers, self.roots, strict=True))
        ]
        return np.hstack(steps) @ self.weights + self.constant, np.stack(unlike, axis=1)


def features(y: Array, limits: Envelope) -> Array:
    """(n, m) what each channel of (n, n_samples, n_channels) did, whenever it did it."""
    parts = limits.shares(y)[..., limits.limited].max(axis=1)
    moved = (y.max(axis=1), y.min(axis=1), y.mean(axis=1), y.std(axis=1))
    return np.hstack([np.log(np.maximum(parts, LEAST_PART)), *moved])
