"""A cheap longitudinal plant for tests: pitch doublets on short periods of uncertain stiffness.

It knows nothing of `core.simulation`. About a quarter of the flights exceed the limits of N_z.
"""

import numpy as np

from core.channels import Dictionary, channel
from core.limits.limits import IntervalLimits, SafeInterval
from core.types import Array

DT, N_SAMPLES, REST = 0.05, 81, 60
DICTIONARY = Dictionary(
    "pitch",
    (
        channel("alpha", "α", "rad", "angle of attack", "output", "absolute"),
        channel("q", "q", "rad/s", "pitch rate"),
        channel("Nz", "N_z", "g", "normal acceleration", "output", "absolute"),
        channel("delta_e", "δ_e", "rad", "elevator", "control", "absolute"),
    ),
)
LIMITS = IntervalLimits(DICTIONARY, {"Nz": SafeInterval(low=-1.1, high=2.9, rest=1.0)})


def fly(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """theta (n, 2) and y (n, 81, 4): at rest for about 0.5 s, then one doublet.

    theta: share of the nominal stiffness, and of the input.
    """
    theta = rng.normal(1.0, 0.18, (n, 2))
    stiffness, size = 6.0 * theta[:, 0], 0.06 * theta[:, 1]
    begin = 0.5 + 0.1 * rng.standard_normal(n)
    alpha, q, surface = np.full(n, 0.05), np.zeros(n), np.zeros(n)
    y = np.empty((n, N_SAMPLES, 4))
    for k in range(N_SAMPLES):
        y[:, k] = np.column_stack([alpha, q, 1.0 + 20.0 * (alpha - 0.05), -0.02 + surface])
        since = k * DT - begin
        command = np.where(since < 0, 0.0, np.where(since < 0.8, -size, size * (since < 1.6)))
        for _ in range(5):
            h = DT / 5
            surface = surface + h * 20.0 * (command - surface)
            alpha = alpha + h * (q - 0.9 * (alpha - 0.05))
            q = q + h * (-stiffness * (alpha - 0.05) - 1.2 * q - 9.0 * surface)
    return theta, y + rng.standard_normal(y.shape) * np.array([1e-3, 2e-3, 0.01, 5e-4])


def with_channels(y: Array, n_channels: int, rng: np.random.Generator) -> Array:
    """The same flights with fewer channels, the last ones, or with more, which are only noise."""
    if n_channels <= y.shape[2]:
        return y[..., -n_channels:]
    more = rng.standard_normal((*y.shape[:2], n_channels - y.shape[2]))
    return np.concatenate([more, y], axis=2)


def resting_first(y: Array) -> Array:
    """(REST + n, n_channels) the same flight after more samples of the rest it begins with."""
    rest = y[:8].mean(axis=0)
    noise = np.resize(y[:8] - rest, (REST, y.shape[1]))
    return np.concatenate([rest + noise, y])
