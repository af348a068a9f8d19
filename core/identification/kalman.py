"""Kalman filters of batches: gains that a model asks for, and the white residuals that are left.

Anderson and Moore, Optimal Filtering (1979), chapter 3. Records have a constant interval, so the
gains settle and are then kept.
"""

from typing import NamedTuple

import numpy as np

from core.identification.joint_model import JointModel
from core.types import Array

SETTLED = 1e-7
"""Relative change of what a measurement is expected to scatter by, below which gains are kept."""


class Gains(NamedTuple):
    """Of n filters, sample by sample; the last ones hold for all samples that follow.

    gain: n_settled arrays (n, k, m).   root: as many (n, m, m); what turns a residual into a white
    one of variance 1.   log_root: (n,) sum of their logarithms' traces over all samples.
    """

    gain: list[Array]
    root: list[Array]
    log_root: Array


def gains(model: JointModel, noise: Array, n_samples: int) -> Gains:
    """Run the covariances of n filters; only those outputs count whose noise is finite.

    noise: (n or 1, 6) 1 sigma, positive; infinite where not measured, in all n alike.
    """
    measured = np.isfinite(noise[0])
    h, r = model.h[:, measured], np.square(noise[:, measured])
    turned = np.swapaxes(h, -1, -2)
    diagonal = np.arange(h.shape[1])
    covariance, gain, root, log_roots = model.start, [], [], []
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
        log_roots.append(np.log(inverse[:, diagonal, diagonal]).sum(axis=1))
        updated = covariance - np.swapaxes(white, -1, -2) @ white
        following = model.f @ updated @ np.swapaxes(model.f, -1, -2) + model.q
        covariance = 0.5 * (following + np.swapaxes(following, -1, -2))
    log_root = np.sum(log_roots, axis=0) + (n_samples - len(root)) * log_roots[-1]
    return Gains(gain, root, log_root)


def white_residuals(
    f: Array, h: Array, of: Gains, y: Array, start: Array, measured: Array
) -> Array:
    """(n, c, n_samples, m) white residuals of c variants of each of n filters.

    f: (n, c, k, k).   h: (n, c, 6, k).   y: (n, c or 1, n_samples, 6).   start: (n, c, k) state at
    the first sample.   measured: (6,) channels that count.
    """
    channels = np.flatnonzero(measured)
    h, y = h[:, :, channels], y[..., channels]
    n, c, m, _ = h.shape
    out = np.empty((n, c, y.shape[2], m))
    state = start[..., np.newaxis]
    for k in range(y.shape[2]):
        settled = min(k, len(of.gain) - 1)
        residual = y[:, :, k, :, np.newaxis] - h @ state
        out[:, :, k] = (of.root[settled][:, np.newaxis] @ residual)[..., 0]
        state = f @ (state + of.gain[settled][:, np.newaxis] @ residual)
    return out
