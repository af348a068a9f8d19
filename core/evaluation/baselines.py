"""Baselines: published warning rules, calibrated like monitors to compare at equal miss rates.

Without calibration they promise no miss rate. Each scores every sample of a flight from the
samples so far; a low score is close to a failure.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from core.channels import KEYS, LATERAL, Dictionary
from core.dataset import Dataset
from core.evaluation.rates import Evaluation, count_silent
from core.kernels.reductions import box_distances, grow_boxes
from core.limits.limits import envelope_of
from core.monitor.calibration import alert_above, p_values
from core.monitor.observation import channel_scale, lead_steps
from core.monitor.peak_forecast import lowest_within
from core.monitor.recipe import MonitorRecipe
from core.rollouts import LabelledFlights
from core.simulation.simulator import Rollouts
from core.types import Array

LEAST_WIDTH = 0.05
"""Least half width of an envelope, as a share of the channel's largest."""
TOLERANCE, REACH = 0.1, 0.05
"""See `grow_boxes`; in standard deviations of the channels on safe flights."""
REGRESSORS = [KEYS.index(key) for key in ("beta", "p", "r", "delta_a", "delta_r")]
RATES, FORCE = [KEYS.index(key) for key in ("p", "r")], KEYS.index("Ny")

Scores = Callable[[Array], Array]
"""From flights y (n, n_samples, n_channels) to scores (n, n_samples); NaN where unknown."""


@dataclass(frozen=True)
class Baseline(ABC):
    """A rule of others. It learns from safe flights alone."""

    assumption: ClassVar[str]
    dictionary: ClassVar[Dictionary | None] = None
    """the channels that it needs; None: any"""

    @abstractmethod
    def fit(self, dataset: Dataset) -> Scores:
        """ValueError for a dataset whose channels or limits it cannot use."""


@dataclass(frozen=True)
class SafeEnvelope(Baseline):
    """Envelope of the simulated safe flights (SafeEnvelope, first approach).

    Minus the distance from its middle in half widths, of the channel that is farthest out.
    """

    assumption: ClassVar[str] = (
        "a flight is safe while each channel stays within what simulated safe flights reached at "
        "the same time of the manoeuvre"
    )

    def fit(self, dataset: Dataset) -> Scores:
        low, high = np.nanmin(dataset.safe, axis=0), np.nanmax(dataset.safe, axis=0)
        middle, half = (low + high) / 2, (high - low) / 2
        widest = np.where((peak := half.max(axis=0)) > 0, peak, 1.0)
        half = np.maximum(half, LEAST_WIDTH * widest)
        return lambda y: -(np.abs(y - middle) / half).max(axis=2)


@dataclass(frozen=True)
class BoundedDerivatives(Baseline):
    """Recursive least squares of the derivatives, with bounds on them (SafeEnvelope, second one).

    The bounds are the extremes of the estimates at the end of the safe flights. Minus the distance
    from their middle in half widths, of the derivative that is farthest out.
    """

    dictionary: ClassVar[Dictionary | None] = LATERAL
    assumption: ClassVar[str] = (
        "an aircraft is safe while each estimated derivative of roll, yaw and side force lies "
        "within those of simulated safe aircraft, whatever the input and the other derivatives"
    )

    def fit(self, dataset: Dataset) -> Scores:
        if dataset.dictionary != LATERAL:
            raise ValueError(
                f"derivatives need the channels {', '.join(KEYS)}: the dataset has "
                f"{', '.join(dataset.dictionary.keys)}"
            )
        x, moments = _equations(dataset.safe, dataset.dt)
        scale = channel_scale(x.reshape(-1, x.shape[2]))
        pooled = (each.reshape(-1, each.shape[2]) for each in (x / scale, moments))
        usual = np.asarray(np.linalg.lstsq(*pooled, rcond=1e-10)[0], np.float64)

        def estimates(y: Array) -> Array:
            x, moments = _equations(y, dataset.dt)
            return recursive_estimates(x / scale, moments, usual)

        final = estimates(dataset.safe)[:, -1]
        low, high = final.min(axis=0), final.max(axis=0)
        middle, half = (low + high) / 2, (high - low) / 2
        half = np.where(half > 0, half, np.inf)
        return lambda y: -(np.abs(estimates(y) - middle) / half).max(axis=(2, 3))


def _equations(y: Array, dt: float) -> tuple[Array, Array]:
    """Between two samples each: regressors (n, n_samples, 5), and p_dot, r_dot and N_y
    (n, n_samples, 3); zeros at the first sample."""
    x, moments = (np.zeros((*y.shape[:2], m)) for m in (len(REGRESSORS), len(RATES) + 1))
    mean, slope = (y[:, 1:] + y[:, :-1]) / 2, np.diff(y, axis=1) / dt
    x[:, 1:] = mean[..., REGRESSORS]
    moments[:, 1:, :-1], moments[:, 1:, -1] = slope[..., RATES], mean[..., FORCE]
    return x, moments


def recursive_estimates(x: Array, y: Array, usual: Array) -> Array:
    """Least squares y = x b over the samples up to each one, in closed form.

    x: (n, n_samples, k) of deviation 1.   y: (n, n_samples, m).
    usual: (k, m) estimates before the first sample, which weigh as much as one sample.
    Returns (n, n_samples, k, m).
    """
    information = np.eye(x.shape[2]) + np.cumsum(x[..., np.newaxis] * x[..., np.newaxis, :], axis=1)
    known = usual + np.cumsum(x[..., np.newaxis] * y[..., np.newaxis, :], axis=1)
    return np.asarray(np.linalg.solve(information, known), np.float64)


@dataclass(frozen=True)
class InductiveMonitoring(Baseline):
    """Minus the distance to the nearest box of nominal samples.

    Iverson, "Inductive System Health Monitoring", 2004; for flight tests in 412TW-PA-16408.
    """

    assumption: ClassVar[str] = (
        "a sample unlike all samples of safe flights is unsafe, and those before it do not matter"
    )

    def fit(self, dataset: Dataset) -> Scores:
        samples = dataset.safe.reshape(-1, dataset.safe.shape[2])
        scale = channel_scale(samples)
        known = np.isfinite(samples).all(axis=1)
        low, high = grow_boxes(samples[known] / scale, TOLERANCE, REACH)
        return lambda y: (
            -box_distances((y / scale).reshape(-1, y.shape[2]), low, high).reshape(y.shape[:2])
        )


@dataclass(frozen=True)
class CurrentShare(Baseline):
    """Minus the share of its limit that the nearest channel has reached."""

    assumption: ClassVar[str] = (
        "the danger is the current share of the limit, however fast it grows"
    )

    def fit(self, dataset: Dataset) -> Scores:
        envelope = envelope_of(dataset.specification)
        if envelope is None:
            raise ValueError("the dataset has labels alone: a share of a limit needs limits")
        return lambda y: -np.nan_to_num(envelope.margin(y), nan=-np.inf)


BASELINES: dict[str, Baseline] = {
    "safe envelope": SafeEnvelope(),
    "derivatives in bounds": BoundedDerivatives(),
    "inductive monitoring": InductiveMonitoring(),
    "current share of limit": CurrentShare(),
}


def baselines_for(dictionary: Dictionary) -> dict[str, Baseline]:
    """The baselines that can use the channels of a dictionary."""
    return {name: each for name, each in BASELINES.items() if each.dictionary in (None, dictionary)}


def evaluate_baseline(
    baseline: Baseline,
    dataset: Dataset,
    flights: Rollouts | LabelledFlights,
    recipe: MonitorRecipe,
    epsilons: Array,
) -> Evaluation:
    """Counts over fresh flights at each of epsilons.

    It learns from the dataset's safe flights and is calibrated on its failures as it is flown, for
    the lead and the promise of the recipe.
    """
    scores, h = baseline.fit(dataset), lead_steps(recipe.t_early, dataset.dt)
    alphas = np.sort(lowest_within(scores(dataset.unsafe), dataset.fail_index - h))
    above = [alert_above(epsilon, len(alphas), recipe.guarantee) for epsilon in epsilons]
    n_samples = flights.y.shape[1]
    fails = flights.fail_index < n_samples
    last = np.where(fails, flights.fail_index - h, n_samples - 1)
    lowest = lowest_within(scores(flights.y), last)
    silent = p_values(lowest, alphas)[:, np.newaxis] <= above
    silent[last < 0] = True
    return count_silent(epsilons, fails, last, silent)
