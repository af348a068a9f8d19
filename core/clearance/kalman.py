"""Batches of Kalman filters: gains of a model, and white residuals of records.

Anderson and Moore, Optimal Filtering (1979), chapter 3. Records have a constant interval, so the
gains settle and then stay constant.
"""

from typing import NamedTuple

import numpy as np

from core.clearance.joint_model import JointModel
from core.types import Array

SETTLED = 1e-7
"""Gains count as settled below this relative change of the expected innovation variance."""


class Gains(NamedTuple):
    """Gains of n filters, sample by sample; the last ones apply to all later samples.

    gain: n_settled arrays (n, k, m).   root: as many (n, m, m); they whiten a residual to variance
    1.
    """

    gain: list[Array]
    root: list[Array]


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
    return Gains(gain, root)


def white_residuals(
    f: Array, h: Array, filter_gains: Gains, y: Array, start: Array, measured: Array
) -> Array:
    """(n, c, n_samples, m) white residuals of c variants of each of n filters.

    f: (n, c, k, k).   h: (n, c, 6, k).   y: (n, c or 1, n_samples, 6).   start: (n, c, k) state at
    the first sample.   measured: (6,) channels that count.
    """
    channels = np.flatnonzero(measured)
    h, y = h[:, :, channels], y[..., channels]
    n, c, m, n_states = h.shape
    n_samples, n_settled = y.shape[2], min(len(filter_gains.gain) - 1, y.shape[2])
    residuals = np.empty((n, c, n_samples, m))
    state = start[..., np.newaxis]
    for k in range(n_settled):
        residual = y[:, :, k, :, np.newaxis] - h @ state
        residuals[:, :, k] = residual[..., 0]
        state = f @ (state + filter_gains.gain[k][:, np.newaxis] @ residual)
    # From here on the gains are the same, and the filter is one linear system.
    gain, late = f @ filter_gains.gain[-1][:, np.newaxis], y[:, :, n_settled:]
    closed, driven = f - gain @ h, late @ np.swapaxes(gain, -1, -2)
    states = np.empty((n, c, n_samples - n_settled, n_states))
    for k in range(n_samples - n_settled):
        states[:, :, k] = state[..., 0]
        state = closed @ state + driven[:, :, k, :, np.newaxis]
    residuals[:, :, n_settled:] = late - states @ np.swapaxes(h, -1, -2)
    roots = np.stack([*filter_gains.root[:n_settled], filter_gains.root[-1]], axis=1)[:, np.newaxis]
    out = np.empty_like(residuals)
    early, turned = residuals[:, :, :n_settled, :, np.newaxis], np.swapaxes(roots[:, :, -1], -1, -2)
    out[:, :, :n_settled] = (roots[:, :, :-1] @ early)[..., 0]
    out[:, :, n_settled:] = residuals[:, :, n_settled:] @ turned
    return out
