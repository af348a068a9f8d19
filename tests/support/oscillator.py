"""A cheap plant for tests: a decaying swing of uncertain size, pace and damping.

It knows nothing of `core.simulation`; about one flight in four breaks |N_y| < 0.5 g.
"""

from dataclasses import replace

import numpy as np

from core.dataset import Dataset
from core.limits.limits import Limits
from core.types import Array, Indices

DT, N_SAMPLES, NY = 0.05, 61, 3
TIMES: Array = DT * np.arange(N_SAMPLES, dtype=np.float64)
THETA = ("gain", "omega", "zeta")


def fly(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """theta (n, 3) and y (n, 61, 6): at rest for 0.5 s, then swinging; a little noise."""
    theta = np.column_stack(
        [rng.normal(1, 0.25, n), rng.uniform(1.2, 2.5, n), rng.uniform(0.05, 0.3, n)]
    )
    gain, omega, zeta = theta.T[..., None]
    since = np.maximum(DT * np.arange(N_SAMPLES) - 0.5, 0)
    size = gain * np.exp(-zeta * omega * since) * (since > 0)
    swing, rate = size * np.sin(omega * since), size * np.cos(omega * since)
    other = size * np.sin(1.7 * omega * since)
    pilot = np.where(since < 1, since, 2 - since) * np.ones_like(gain)
    y = np.stack(
        [
            0.1 * swing,
            0.3 * rate + 0.1 * other,
            0.2 * other - 0.1 * rate,
            0.48 * swing + 0.04 * rate,
            0.05 * rate,
            0.02 * pilot - 0.03 * other,
        ],
        axis=-1,
    )
    return theta, y * (1 + 0.01 * rng.standard_normal(y.shape)) + 1e-4 * rng.standard_normal(
        y.shape
    )


def fail_indices(y: Array) -> Indices:
    """First sample of each flight with |N_y| >= 0.5 g, or the number of samples."""
    violates = np.abs(y[..., NY]) >= 0.5
    return np.where(violates.any(axis=1), violates.argmax(axis=1), y.shape[1])


def collect(
    rng: np.random.Generator,
    n_unsafe: int,
    n_obs: int = 20,
    specification: Limits = Limits(),  # noqa: B008
) -> Dataset:
    """Fly until n_unsafe flights failed; keep the safe ones met on the way."""
    theta, y = fly(rng, 20 * n_unsafe + 50)
    fail = specification.first_exceedance(y)
    failed = np.flatnonzero(fail < N_SAMPLES)[:n_unsafe]
    assert len(failed) == n_unsafe
    met = np.arange(len(y)) < failed[-1]
    safe = np.flatnonzero(met & (fail == N_SAMPLES))
    unsafe = y[failed].copy()
    unsafe[np.arange(N_SAMPLES) > fail[failed, None]] = np.nan
    times = np.array([rng.choice(N_SAMPLES, n_obs, replace=False) for _ in safe])
    return Dataset(
        unsafe=unsafe,
        fail_index=fail[failed],
        safe=y[safe],
        safe_times=np.sort(times, axis=1),
        theta_unsafe=theta[failed],
        theta_safe=theta[safe],
        dt=DT,
        theta_names=THETA,
        specification=specification,
        n_safe_met=len(safe),
        seed=7,
        recipe={"aircraft": "oscillator"},
    )


def with_early_failures(dataset: Dataset, n: int, fail_index: int = 3) -> Dataset:
    """The first n failures happen at fail_index instead."""
    unsafe, fail = dataset.unsafe.copy(), dataset.fail_index.copy()
    fail[:n], unsafe[:n, fail_index + 1 :] = fail_index, np.nan
    return replace(dataset, unsafe=unsafe, fail_index=fail)
