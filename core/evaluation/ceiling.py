"""The information limit: how well any monitor could warn, given the samples so far.

The aircraft's derivatives and the pilot's amplitude are estimated from the samples so far, with one
Gauss-Newton step on the simulation for each sample. Aircraft drawn from this posterior continue the
planned input, with the pilot's scatter; the score is how often they exceed a limit. No monitor of
the same samples can do much better. This is too slow to use in flight.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from core.limits.limits import magnitudes_of
from core.planned_test.planned_test import DatasetRecipe, ManeuverTest
from core.simulation.imperfections import channel_array
from core.simulation.maneuver import COLUMN, LATERAL_SURFACES, Steps
from core.simulation.rollout import roll_out
from core.types import Array, Indices

N_DRAWN = 64
"""Aircraft and pilots drawn from each posterior."""
DIFFERENCE, LARGEST_STEP = 0.02, 3.0
"""Steps of the Gauss-Newton method, in standard deviations of the prior."""
LEAST_NOISE, LEAST_DEVIATION = 1e-6, 0.01
"""Smallest noise of a sample, in SI; smallest deviation of drawn peaks, in limits."""
FINEST_SHARE, MARGIN_WEIGHT = 1e-3, 0.02
"""Shares closer to 0 or 1 than the first are ranked by the margin, with this weight."""


class Posterior(NamedTuple):
    """Posterior of deviates, flight by flight; they are standard normal before the first sample.

    mean: (n, m).   root: (n, m, m), root root' is the covariance.
    """

    mean: Array
    root: Array


class Ceiling:
    """The posterior of a planned test of steps, with noise and scatter as the only imperfections.

    Uniform derivatives are treated as normal with the same variance.
    ValueError for other tests.
    """

    def __init__(self, test: ManeuverTest) -> None:
        maneuver, limits = test.maneuver, magnitudes_of(test.judged_by)
        is_exact = test.simulator().crew is None and test.imperfections.are_none
        if (
            not (isinstance(maneuver, Steps) and isinstance(test, DatasetRecipe))
            or limits is None
            or not is_exact
        ):
            raise ValueError(
                "the information limit needs a manoeuvre of steps of a linear aircraft, limits, "
                "no pilot in the loop, and no imperfections besides noise and scatter: leave it "
                "out, or those"
            )
        self._test, self._maneuver, self._limits = test, maneuver, limits
        self._simulator = test.simulator()
        plant = self._simulator.plant
        self._uncertain = np.flatnonzero(plant.spread)
        part = 1.0 if plant.distribution == "normal" else 3**-0.5
        self._deviation = part * plant.spread[self._uncertain]
        self._noise = np.maximum(channel_array(test.noise), LEAST_NOISE)
        times, steps = np.array(maneuver.switches).T
        self._apart = np.diff(times) / test.dt
        self._levels = np.deg2rad(np.concatenate([[0.0], np.cumsum(steps)]))
        self._column = COLUMN[maneuver.surface]
        m = len(self._uncertain) + 1
        from scipy.stats import qmc  # slow to import, and only needed here

        points = ndtri(qmc.Sobol(m + len(steps), scramble=False).random(2 * N_DRAWN)[N_DRAWN:])
        whitened = np.linalg.cholesky(np.linalg.inv(np.cov(points[:, :m].T, bias=True)))
        self._drawn = (points[:, :m] - points[:, :m].mean(axis=0)) @ whitened
        self._pilots = ndtr(points[:, m:])

    def scores(self, y: Array, commands: Array, last: Indices, windows: Indices) -> Array:
        """Score of each sample 0..last of flights; low means close to a failure.

        y: (n, n_samples, 6).   commands: (n, n_samples, 2) of the pilot; only past ones are used.
        last: (n,).   windows: (n_windows,) samples to look ahead, 0 for the rest of the flight.
        Returns (n_windows, n, n_samples), +inf before the first input and after `last`.
        """
        given = commands[:, :, self._column]
        changes = np.diff(given, axis=1, prepend=0.0) != 0
        scores, n_samples = np.full((len(windows), *y.shape[:2]), np.inf), y.shape[1]
        mean = np.zeros((len(y), len(self._uncertain) + 1))
        for now in range(1, int(last.max(initial=-1)) + 1):
            switched = changes[:, :now].sum(axis=1)
            which = np.flatnonzero((switched > 0) & (now <= last))
            if len(which) == 0:
                continue
            level = self._levels[np.minimum(changes[which].cumsum(axis=1), len(self._levels) - 1)]
            known = np.minimum(switched[which], len(self._levels) - 1)
            posterior = self._estimated(y[which, : now + 1], level[:, : now + 1], mean[which])
            mean[which] = posterior.mean
            latest = now - 1 - changes[which, :now][:, ::-1].argmax(axis=1)
            end = n_samples if 0 in windows else min(now + int(windows.max()) + 1, n_samples)
            margin = self._margins(posterior, level[:, :end], known, latest, now)
            for k, window in enumerate(windows):
                ahead = margin[:, :, : window or None]
                scores[k, which, now] = -_danger(ahead.max(axis=2, initial=0.0))
        return scores

    def _outputs(self, deviates: Array, level: Array) -> Array:
        """Outputs (n, n_samples, 6) of aircraft and pilots of these deviates (n, m).

        level: (n, n_samples) of the planned amplitude.
        """
        plant, test = self._simulator.plant, self._test
        theta = np.repeat(plant.nominal[np.newaxis], len(deviates), axis=0)
        theta[:, self._uncertain] += self._deviation * deviates[:, :-1]
        factor = 1.0 + self._maneuver.amplitude_jitter * deviates[:, -1:]
        pilot = np.zeros((*level.shape, LATERAL_SURFACES))
        pilot[:, :, self._column] = factor * level
        return roll_out(
            plant.plants(theta),
            self._simulator.controller,
            test.control_law.actuator,
            pilot,
            test.dt,
            pedal_lag_s=self._maneuver.pedal_lag_s,
        )

    def _estimated(self, y: Array, level: Array, mean: Array) -> Posterior:
        """One Gauss-Newton step from `mean` (n, m)."""
        n, m = mean.shape
        tried = mean[:, np.newaxis] + DIFFERENCE * np.vstack([np.zeros(m), np.eye(m)])
        outputs = self._outputs(tried.reshape(-1, m), np.repeat(level, m + 1, axis=0))
        outputs = (outputs / self._noise).reshape(n, m + 1, -1)
        slopes = (outputs[:, 1:] - outputs[:, :1]) / DIFFERENCE
        off = (y / self._noise).reshape(n, -1) - outputs[:, 0]
        covariance = np.linalg.inv(np.eye(m) + slopes @ slopes.transpose(0, 2, 1))
        step = covariance @ ((slopes @ off[:, :, np.newaxis]) - mean[:, :, np.newaxis])
        step *= np.minimum(1.0, LARGEST_STEP / np.abs(step).max(axis=1, keepdims=True))
        root = np.asarray(np.linalg.cholesky(covariance), np.float64)
        return Posterior(mean + step[:, :, 0], root)

    def _margins(
        self, posterior: Posterior, level: Array, known: Indices, latest: Indices, now: int
    ) -> Array:
        """Largest |y| / limit (n, N_DRAWN, n_samples - now - 1) of the drawn flights after `now`.

        known: (n,) number of switches before `now`.   latest: (n,) sample of the last of these.
        """
        n, n_samples = level.shape
        deviates = posterior.mean[:, np.newaxis] + self._drawn @ posterior.root.transpose(0, 2, 1)
        levels = np.repeat(level[:, np.newaxis], N_DRAWN, axis=1)
        levels[:, :, now:] = self._levels[known][:, np.newaxis, np.newaxis]
        due = np.repeat(latest[:, np.newaxis].astype(np.float64), N_DRAWN, axis=1)
        samples = np.arange(n_samples)
        for j in range(1, len(self._levels) - 1):
            pending = known <= j
            due[pending] += self._wait(j, np.where(known == j, now - latest, 0)[pending])
            at = np.where(pending[:, np.newaxis], np.maximum(np.round(due), now), n_samples)
            levels = np.where(samples >= at[:, :, np.newaxis], self._levels[j + 1], levels)
        outputs = self._outputs(
            deviates.reshape(n * N_DRAWN, -1), levels.reshape(n * N_DRAWN, n_samples)
        )
        limited = np.isfinite(self._limits)
        margin = (np.abs(outputs[:, now + 1 :, limited]) / self._limits[limited]).max(axis=2)
        return margin.reshape(n, N_DRAWN, -1)

    def _wait(self, j: int, passed: Indices) -> Array:
        """(n, N_DRAWN) samples from switch j - 1 to switch j, given that `passed` (n,) are over."""
        planned = self._apart[j - 1]
        jitter = self._maneuver.timing_jitter_s / self._test.dt
        if jitter == 0:
            return np.repeat(np.maximum(passed, planned)[:, np.newaxis], N_DRAWN, axis=1)
        before = ndtr((passed - 0.5 - planned) / jitter)[:, np.newaxis]
        before = np.where(passed[:, np.newaxis] > 0, np.minimum(before, 1 - 1e-9), 0.0)
        share = before + (1 - before) * self._pilots[:, j]
        return np.maximum(planned + jitter * ndtri(share), 0.0)


def _danger(peaks: Array) -> Array:
    """(n,) log odds of an exceedance, from drawn peaks (n, N_DRAWN) in limits."""
    share = (peaks >= 1.0).mean(axis=1)
    margin = (peaks.mean(axis=1) - 1.0) / np.hypot(peaks.std(axis=1), LEAST_DEVIATION)
    return np.log((share + FINEST_SHARE) / (1 - share + FINEST_SHARE)) + MARGIN_WEIGHT * margin
