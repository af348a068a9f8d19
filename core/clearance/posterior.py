"""Posterior of aircraft parameters by the filter-error method, for many aircraft at once.

Jategaonkar, Flight Vehicle System Identification, 2nd ed. (2015), chapter 5: Gauss-Newton steps
minimise the residuals of a Kalman filter. The prior is D_theta, or the posterior of earlier
flights. Initial state and biases of each record are fitted too; a constant input is not, because
initial state and biases can represent it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from core.channels import N_CHANNELS
from core.clearance.joint_model import (
    N_OUTPUTS,
    Law,
    SurfaceMotion,
    driven_response,
    exponential,
    joint_flow,
    joint_model,
    law_part,
)
from core.clearance.kalman import gains, white_residuals
from core.simulation.uncertain_plant import UncertainPlant
from core.types import Array

STEPS, SMALL_STEP = 12, 0.02
"""Largest number of Gauss-Newton steps, and the step that ends them, in standard deviations of
D_theta."""
LARGEST_STEP, HALVINGS = 2.0, 4
"""Largest step in those deviations, and how often a step that does not help is halved."""
DIFFERENCE = 0.01
"""Finite difference in theta, in standard deviations of D_theta."""
WIDE = 1.0
"""Prior deviation of initial states and biases [rad, rad/s, g], far wider than real ones."""
LEAST_NOISE, LEAST_RESOLUTION = 1e-4, 1e-6
"""Smallest noise of a channel: as a share of its motion, plus this in its unit."""


class PlantPosterior(NamedTuple):
    """Posterior of deviates of n aircraft; standard normal before any flight.

    mean: (n, m).   covariance: (n, m, m).
    """

    mean: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class RecordedStep:
    """The record of a manoeuvre by n aircraft, from trim.

    y: (n, n_samples, 6), one sample each dt [s].   noise: (6,) 1 sigma of each channel, SI units,
    N_y in g; infinite for an output that was not recorded.
    """

    y: Array
    dt: float
    noise: Array


class Fit(NamedTuple):
    """The fit of records of n aircraft.

    posterior: of their deviates.   chi_square: (n, n_records) mean square of the white residuals;
    about 1 if model and noise are right.   distance: (n,) squared distance of the mean from the
    prior's, in the prior's covariance.
    """

    posterior: PlantPosterior
    chi_square: Array
    distance: Array


def prior_of(plant: UncertainPlant, n: int) -> PlantPosterior:
    """D_theta itself, for n aircraft."""
    m = plant.root.shape[1]
    return PlantPosterior(np.zeros((n, m)), np.broadcast_to(np.eye(m), (n, m, m)))


def fit(
    plant: UncertainPlant, law: Law, records: Sequence[RecordedStep], prior: PlantPosterior
) -> Fit:
    """Posterior of n aircraft, each from its own records."""
    fits = [RecordFit(plant, law, record) for record in records]
    mean, information = settle(fits, prior, prior.mean)
    covariance, away = np.linalg.inv(information), mean - prior.mean
    return Fit(
        PlantPosterior(mean, 0.5 * (covariance + np.swapaxes(covariance, -1, -2))),
        np.stack([np.square(part.white(mean)).mean(axis=1) for part in fits], axis=1),
        np.einsum("ni,nij,nj->n", away, np.linalg.inv(prior.covariance), away) / mean.shape[1],
    )


def settle(
    fits: Sequence["RecordFit"], prior: PlantPosterior, mean: Array, steps: int = STEPS
) -> tuple[Array, Array]:
    """Iterate from a mean (n, m) to the posterior's mean, with at most `steps` steps.

    Initial states and biases of the records are updated too.
    Returns the mean, and the posterior's information (n, m, m).
    """
    from_prior = np.asarray(np.linalg.inv(prior.covariance), np.float64)
    information = from_prior
    for _ in range(steps):
        for part in fits:
            part.filter_of(mean)
        pieces = [part.linearise(mean) for part in fits]
        information = np.add(from_prior, sum(part for part, _ in pieces))
        pull = from_prior @ (prior.mean - mean)[..., np.newaxis] + sum(pull for _, pull in pieces)
        change = np.asarray(np.linalg.solve(information, pull)[..., 0], np.float64)
        share = _step_share(fits, prior, from_prior, mean, change)
        for part in fits:
            part.follow(change, share)
        change = share[:, np.newaxis] * change
        mean = mean + change
        if np.abs(change).max() < SMALL_STEP:
            break
    return mean, information


def _step_share(
    fits: Sequence["RecordFit"],
    prior: PlantPosterior,
    from_prior: Array,
    mean: Array,
    change: Array,
) -> Array:
    """(n,) share of a change that is small enough and does not increase the misfit."""

    def misfit(share: Array) -> Array:
        away = mean + share[:, np.newaxis] * change - prior.mean
        squares = np.einsum("ni,nij,nj->n", away, from_prior, away)
        return squares + sum(part.misfit(mean, change, share) for part in fits)

    share = LARGEST_STEP / np.maximum(np.abs(change).max(axis=1), LARGEST_STEP)
    before = misfit(np.zeros_like(share))
    for _ in range(HALVINGS):
        if not (worse := ~(misfit(share) <= before)).any():
            break
        share = np.where(worse, 0.5 * share, share)
    return share


class RecordFit:
    """One record of n aircraft during a fit: its filter, initial states and biases."""

    def __init__(self, plant: UncertainPlant, law: Law, record: RecordedStep) -> None:
        self._plant, self._law, self._y, self._dt = plant, law, record.y, record.dt
        n, self._n_states = len(record.y), len(plant.states)
        moved = np.sqrt(np.square(np.nan_to_num(record.y)).mean(axis=(0, 1)))
        self.noise = np.maximum(record.noise, LEAST_NOISE * moved + LEAST_RESOLUTION)
        self.measured = np.isfinite(self.noise)
        self._outputs = np.flatnonzero(self.measured[:N_OUTPUTS])
        pilot = self._y[..., N_OUTPUTS:] - law_part(law, self._y, self._dt)
        self._motion = SurfaceMotion.likeliest(pilot, self.noise[N_OUTPUTS:], self._dt)
        self._offsets = np.zeros((n, len(plant.states) + len(self._outputs)))

    @property
    def n_offsets(self) -> int:
        """Number of initial states and biases of one aircraft."""
        return self._offsets.shape[1]

    def filter_of(self, mean: Array) -> None:
        """Use the optimal filter for these deviates (n, m)."""
        plants = self._plant.plants(self._plant.theta_of(mean))
        model = joint_model(plants, self._law, self._motion, self._dt)
        self._gains = gains(model, self.noise[np.newaxis], self._y.shape[1])

    def linearise(self, mean: Array) -> tuple[Array, Array]:
        """Information (n, m, m) and gradient (n, m, 1) for deviates about a mean (n, m).

        Initial state and biases are eliminated.
        """
        m = mean.shape[1]
        tried = np.repeat(mean[:, np.newaxis], m + 1, axis=1)
        tried[:, np.arange(1, m + 1), np.arange(m)] += DIFFERENCE
        white = self._white(tried, self._offsets)
        residual = white[:, 0]
        slopes = (white[:, :1] - white[:, 1:]) / DIFFERENCE
        free = self._free_columns(mean)
        columns = np.concatenate([slopes, free], axis=1)
        self._information = columns @ np.swapaxes(columns, -1, -2)
        self._pull = columns @ residual[..., np.newaxis]
        k = free.shape[1]
        self._information[:, m + np.arange(k), m + np.arange(k)] += WIDE**-2
        self._pull[:, m:, 0] -= self._offsets / WIDE**2
        across = np.linalg.solve(self._information[:, m:, m:], self._information[:, m:, :m])
        information = (
            self._information[:, :m, :m]
            - np.swapaxes(across, -1, -2) @ self._information[:, m:, :m]
        )
        pull = self._pull[:, :m] - np.swapaxes(across, -1, -2) @ self._pull[:, m:]
        return information, pull

    def follow(self, change: Array, share: Array) -> None:
        """Update initial states and biases for a share (n,) of a change (n, m) of the
        deviates."""
        self._offsets = self._followed(change, share)

    def _followed(self, change: Array, share: Array) -> Array:
        m = change.shape[1]
        rest = (
            self._pull[:, m:, 0] - (self._information[:, m:, :m] @ change[..., np.newaxis])[..., 0]
        )
        moved = np.linalg.solve(self._information[:, m:, m:], rest[..., np.newaxis])[..., 0]
        return self._offsets + share[:, np.newaxis] * moved

    def misfit(self, mean: Array, change: Array, share: Array) -> Array:
        """(n,) sum of squares after a share (n,) of a change, with initial states and biases."""
        offsets = self._followed(change, share)
        white = self._white((mean + share[:, np.newaxis] * change)[:, np.newaxis], offsets)[:, 0]
        return np.square(white).sum(axis=1) + np.square(offsets / WIDE).sum(axis=1)

    def white(self, mean: Array) -> Array:
        """(n, all) white residuals of these deviates (n, m)."""
        return self._white(mean[:, np.newaxis], self._offsets)[:, 0]

    def innovations(self, mean: Array) -> Array:
        """(n, n_samples, 4) white residuals of the outputs times their assumed noise; NaN for
        outputs that were not recorded."""
        white = self.white(mean).reshape(len(mean), self._y.shape[1], -1)
        out = np.full((*white.shape[:2], N_OUTPUTS), np.nan)
        out[..., self._outputs] = white[..., : len(self._outputs)] * self.noise[self._outputs]
        return out

    def output_residuals(self, mean: Array) -> Array:
        """(n, n_samples, 4) outputs minus the response to the measured surfaces alone."""
        nx, outputs = self._n_states, self._outputs
        plants = self._plant.plants(self._plant.theta_of(mean))
        surfaces = self._y[..., N_OUTPUTS:]
        expected = driven_response(plants, surfaces, self._dt, self._offsets[:, :nx])
        expected[..., outputs] += self._offsets[:, np.newaxis, nx:]
        return self._y[..., :N_OUTPUTS] - expected

    def _white(self, tried: Array, offsets: Array) -> Array:
        """(n, c, all) white residuals of deviates (n, c, m)."""
        n, c, m = tried.shape
        plants = self._plant.plants(self._plant.theta_of(tried.reshape(-1, m)))
        flow, h = joint_flow(plants, self._law, self._motion.times(c))
        f, k = exponential(self._dt * flow), flow.shape[1]
        y, start = self._without(offsets, k)
        out = white_residuals(
            f.reshape(n, c, k, k),
            h.reshape(n, c, N_CHANNELS, k),
            self._gains,
            y[:, np.newaxis],
            np.broadcast_to(start[:, np.newaxis], (n, c, k)),
            self.measured,
        )
        return out.reshape(n, c, -1)

    def _without(self, offsets: Array, k: int) -> tuple[Array, Array]:
        """Samples without the biases, and their initial state (n, k)."""
        nx = self._n_states
        start, y = np.zeros((len(self._y), k)), self._y.copy()
        start[:, :nx] = offsets[:, :nx]
        y[..., self._outputs] -= offsets[:, np.newaxis, nx:]
        return y, start

    def _free_columns(self, mean: Array) -> Array:
        """(n, nx + outputs, all) contribution of each initial state and bias to the prediction."""
        plants = self._plant.plants(self._plant.theta_of(mean))
        flow, h = joint_flow(plants, self._law, self._motion)
        f, (n, k) = exponential(self._dt * flow), flow.shape[:2]
        nx, outputs = self._n_states, self._outputs
        c = nx + len(outputs)
        start, y = np.zeros((n, c, k)), np.zeros((1, c, self._y.shape[1], N_CHANNELS))
        start[:, np.arange(nx), np.arange(nx)] = -1.0
        y[0, nx + np.arange(len(outputs)), :, outputs] = 1.0
        f, h = (np.broadcast_to(x[:, np.newaxis], (n, c, *x.shape[1:])) for x in (f, h))
        out = white_residuals(f, h, self._gains, y, start, self.measured)
        return out.reshape(n, c, -1)
