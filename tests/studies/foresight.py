"""Foresight: the chance that a flight will exceed a limit, from aircraft that it might be.

A doublet is forked at each sample. The input so far is known; the pilot's next switches and the
other half's amplitude are drawn, given what was flown. Each fork is flown to its end.
"""

from collections.abc import Sequence
from copy import deepcopy
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.simulation.imperfections import seed_of
from core.simulation.maneuver import COLUMN, Doublet
from core.types import Array, Indices

N_FORKS, N_BEFORE = 32, 256
"""Forks of a flight at each sample, and flights of each aircraft before the flight."""
AT_ONCE = 200
"""Flights that are forked at a time."""
SURE = 1e-9


class Switches(NamedTuple):
    """(n,) first samples of the first half, of the second half, and of neutral controls."""

    first: Indices
    second: Indices
    neutral: Indices

    @classmethod
    def of(cls, planned: Array, sign: float) -> "Switches":
        """planned: (n, n_samples) command without imperfections.   sign: of the first half."""
        n_samples, is_on, is_second = planned.shape[1], planned != 0.0, planned * sign < 0.0
        first = np.where(is_on.any(axis=1), is_on.argmax(axis=1), n_samples)
        neutral = n_samples - is_on[:, ::-1].argmax(axis=1)
        neutral = np.where(is_on.any(axis=1), neutral, n_samples)
        second = np.where(is_second.any(axis=1), is_second.argmax(axis=1), neutral)
        return cls(first, second, neutral)


class Foresight:
    """The flights that `LateralSimulator.fly` draws from rng, for someone who foresees them.

    candidates: (n, n_candidates, n_parameters) aircraft that each might be; None if it is known.
    Who knows the aircraft also knows the gust and the small movements of the hands to come: only
    the pilot's next decisions stay open.
    ValueError for manoeuvres other than doublets.
    """

    def __init__(
        self,
        test: DatasetRecipe,
        theta: Array,
        rng: np.random.Generator,
        candidates: Array | None = None,
    ) -> None:
        if not isinstance(test.maneuver, Doublet):
            raise ValueError(f"{type(test.maneuver).__name__} was given: foresight needs a doublet")
        self._test, self._maneuver, self._simulator = test, test.maneuver, LateralSimulator(test)
        self._candidates = theta[:, np.newaxis] if candidates is None else candidates
        self._is_known = candidates is None
        n, self._column = len(theta), COLUMN[test.maneuver.surface]
        planned = test.maneuver.pilot(test.dt, n, rng)
        planned = np.broadcast_to(planned, (n, *planned.shape[1:]))
        before = deepcopy(rng)
        self._flown = self._simulator._flown(theta, planned.__getitem__, rng)(slice(0, n))
        self._moves = np.zeros_like(self._flown.commands)
        if not test.imperfections.are_none:
            self._moves, _ = self._simulator._inexact(np.zeros_like(planned), n, seed_of(before))
        self.n_samples = planned.shape[1]
        self._run_up = self._moves.shape[1] - self.n_samples
        self._inputs = (self._flown.commands - self._moves)[:, self._run_up :, self._column]
        sign = np.sign(test.maneuver.peak_deg)
        self._switches = Switches.of(planned[..., self._column], sign)
        self._uniform = qmc.Sobol(4, scramble=False).random(2 * N_FORKS)[N_FORKS:]

    def before(self, rng: np.random.Generator) -> Array:
        """(n,) chance of an exceedance before the flight."""
        n, n_candidates, _ = self._candidates.shape
        each = -(-N_BEFORE // n_candidates)
        theta = np.repeat(self._candidates, each, axis=1).reshape(n * n_candidates * each, -1)
        parts = [
            self._simulator.fly(theta[first : first + 100 * N_BEFORE], rng)[0].is_unsafe
            for first in range(0, len(theta), 100 * N_BEFORE)
        ]
        return np.concatenate(parts).reshape(n, -1).mean(axis=1)

    def chances(self, windows: Sequence[int], until: Indices) -> Array:
        """Chance of an exceedance within a window while the input is on; 0 at other times.

        windows: samples to look ahead.   until: (n,) last sample that needs one.
        Returns (n_windows, n, n_samples).
        """
        chances = np.zeros((len(windows), len(until), self.n_samples))
        first, _, neutral = self._switches
        for now in range(1, self.n_samples):
            every = np.flatnonzero((first < now) & (now <= np.minimum(neutral, until)))
            for start in range(0, len(every), AT_ONCE):
                which = every[start : start + AT_ONCE]
                ends = self._ends(which, self._forked(which, now))
                for k, window in enumerate(windows):
                    soon = (ends < self.n_samples) & (ends <= now + window)
                    chances[k, which, now] = soon.mean(axis=1)
        return chances

    def _forked(self, which: Indices, now: int) -> Array:
        """Inputs (m, N_FORKS, n_samples), as flown before sample `now`, then drawn."""
        maneuver, dt = self._maneuver, self._test.dt
        first, second, _ = (samples[which, np.newaxis] for samples in self._switches)
        u = self._uniform.T
        half, scatter = maneuver.half_s / dt, maneuver.timing_jitter_s / dt
        is_first = now <= second
        start = first - u[0]
        switch = np.where(is_first, start + _lasting(half, scatter, now - 1 - start, u[1]), second)
        begin = np.where(is_first, switch, second - u[0])
        passed = np.where(is_first, 0.0, now - 1 - begin)
        end = begin + _lasting(half, scatter, passed, u[2])
        flown = self._inputs[which]
        level = np.take_along_axis(flown, np.minimum(first, self.n_samples - 1), axis=1)
        other = np.take_along_axis(flown, np.minimum(second, self.n_samples - 1), axis=1)
        other = np.where(is_first, self._other_half(level, ndtri(u[3])), other)
        samples = np.arange(self.n_samples)
        inputs = np.where(
            samples >= np.ceil(end)[..., np.newaxis],
            0.0,
            np.where(
                samples >= np.ceil(switch)[..., np.newaxis],
                other[..., np.newaxis],
                level[..., np.newaxis],
            ),
        )
        inputs[:, :, :now] = flown[:, np.newaxis, :now]
        return inputs

    def _other_half(self, level: Array, normal: Array) -> Array:
        """Amplitude of the second half (m, N_FORKS), given that of the first (m, 1).

        The first is a (1 + x) (1 + d) and the second a (1 - d), with the scatter x and the
        asymmetry d; d given the first is normal but for terms of second order.
        """
        scatter, asymmetry = self._maneuver.amplitude_jitter, self._test.imperfections.asymmetry
        off = np.abs(level) / np.deg2rad(abs(self._maneuver.peak_deg)) - 1.0
        total = max(scatter**2 + asymmetry**2, SURE)
        unequal = off * asymmetry**2 / total + scatter * asymmetry / np.sqrt(total) * normal
        return -level * (1.0 - unequal) / (1.0 + unequal)

    def _ends(self, which: Indices, inputs: Array) -> Indices:
        """(m, N_FORKS) first exceedance of each fork, n_samples without one."""
        m, n_forks, _ = inputs.shape
        forked = np.repeat(which, n_forks)
        moves, gusts = self._moves[forked], self._flown.some(forked).gusts
        if not self._is_known:
            moves[:], gusts = 0.0, tuple(map(np.zeros_like, gusts))
        moves[:, self._run_up :, self._column] += inputs.reshape(m * n_forks, -1)
        candidates = self._candidates[which]
        theta = candidates[:, np.arange(n_forks) % candidates.shape[1]]
        forks = self._flown.some(forked)._replace(
            theta=theta.reshape(m * n_forks, -1), commands=moves, gusts=gusts
        )
        y = self._simulator.outputs(forks)
        ends = self._simulator._first_exceedance(y, self._simulator._trim(y, forks), forks)
        return ends.reshape(m, n_forks)


def _lasting(half: float, scatter: float, passed: Array, u: Array) -> Array:
    """Samples that a half lasts, drawn by uniform u, given that it lasts longer than `passed`."""
    if scatter == 0.0:
        return np.maximum(half, passed) + 0.0 * u
    over = ndtr((passed - half) / scatter)
    return np.maximum(half + scatter * ndtri(np.minimum(over + (1.0 - over) * u, 1.0 - SURE)), 0.0)
