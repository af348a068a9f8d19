"""Batches of Kalman filters: gains of a model, and white residuals of records.

Anderson and Moore, Optimal Filtering (1979), chapter 3. Records have a constant interval, so the
gains settle and then stay constant.
"""

from typing import NamedTuple

import numpy as np

from core.clearance.joint_model import JointModel
from core.kernels.reductions import whiten
from core.types import Array

SETTLED = 1e-7
"""Gains count as settled below this relative change of the expected innovation variance."""


class Gains(NamedTuple):
    """Gains of n filters, sample by sample; the last ones apply to all later samples.

    gain: (n, n_settled, k, m).   root: (n, n_settled, m, m), lower triangular; they whiten a
    residual to variance 1.
    """

    gain: Array
    root: Array


def gains(model: JointModel, noise: Array, n_samples: int) -> Gains:
    """Propagate the covariances of n filters, using the outputs with finite noise.

    noise: (n or 1, 6) 1 sigma, positive; infinite where not measured, equal in all n.
    """
    measured = np.isfinite(noise[0])
    h, r = model.h[:, measured], np.square(noise[:, measured])
    turned = np.swapaxes(h, -1, -2)
    diagonal = np.arange(h.shape[1])
    covariance, gain, root = model.start, [], []
    before = np.full((len(h), h.shape[1]), np.inf)
    for _ in range(n_samples):
        seen = h @ covariance
        innovation = seen @ turned
        innovation[:, diagonal, diagonal] += r
        expected = innovation[:, diagonal, diagonal]
        if np.abs(expected / before - 1.0).max() < SETTLED:
            break
        before = expected
        inverse = np.linalg.inv(np.linalg.cholesky(innovation))
        white = inverse @ seen
        gain.append(np.swapaxes(white, -1, -2) @ inverse)
        root.append(inverse)
        updated = covariance - np.swapaxes(white, -1, -2) @ white
        following = model.f @ updated @ np.swapaxes(model.f, -1, -2) + model.q
        covariance = 0.5 * (following + np.swapaxes(following, -1, -2))
    return Gains(np.stack(gain, axis=1), np.stack(root, axis=1))


def white_residuals(
    f: Array, h: Array, filter_gains: Gains, y: Array, start: Array, measured: Array
) -> Array:
    """(n, c, n_samples, m) white residuals of c variants of each of n filters.

    f: (n, c, k, k).   h: (n, c, 6, k).   y: (n or 1, c or 1, n_samples, 6).   start: (n, c, k)
    state at the first sample.   measured: (6,) channels that count.
    """
    channels = np.flatnonzero(measured)
    h, y = (np.ascontiguousarray(x) for x in (h[:, :, channels], y[..., channels]))
    f, start = np.ascontiguousarray(f), np.ascontiguousarray(start)
    white = np.empty((*start.shape[:2], y.shape[2], h.shape[2]))
    whiten(f, h, *filter_gains, y, start, white)
    return white
