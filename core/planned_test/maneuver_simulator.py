"""Flights of a planned manoeuvre on random aircraft, as flown, judged and recorded."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from core.channels import Dictionary
from core.computed import complete
from core.kernels.pilot import NOBODY, Pilots
from core.limits.limits import Envelope
from core.simulation.imperfections import Imperfections, channel_array, from_trim, seed_of
from core.simulation.maneuver import Maneuver
from core.simulation.pilot import Crew, Pilot
from core.simulation.simulator import Parameters, Rollouts, Stopped
from core.simulation.stability_margins import LeastMargins, Margins
from core.simulation.turbulence import LateralGust
from core.types import Array, Indices

MOST_SAMPLES = 20_000
"""Largest number of steps of a rollout, so that a chunk fits in memory."""
USUAL_TIMING_JITTER_S, USUAL_AMPLITUDE_JITTER = 0.1, 0.15
"""Scatter of a pilot who flies a doublet by hand."""

Look = Callable[[Array, Array], object]
"""Called with the true outputs (n, n_samples, n_measured), from trim where channels count from it,
and with that trim (n, n_measured), of a block of flights after the other."""
BLOCK = 1024
"""Flights whose true outputs the processor's cache holds from their computation to their record."""


class Noise(Protocol):
    """Sensor noise, 1 sigma of each channel."""

    def add_to(self, y: Array, rng: np.random.Generator) -> None: ...


class PlannedManeuver(Protocol):
    """What of a recipe says how a manoeuvre is flown and recorded."""

    @property
    def maneuver(self) -> Maneuver: ...

    @property
    def pilot(self) -> Pilot: ...

    @property
    def margins(self) -> LeastMargins: ...

    @property
    def imperfections(self) -> Imperfections: ...

    @property
    def noise(self) -> Noise: ...

    @property
    def dt(self) -> float: ...

    @property
    def substeps(self) -> int: ...

    @property
    def n_obs(self) -> int: ...


def by_hand(maneuver: Maneuver) -> Maneuver:
    """The manoeuvre with the usual scatter of a pilot."""
    jitter = {
        "timing_jitter_s": USUAL_TIMING_JITTER_S,
        "amplitude_jitter": USUAL_AMPLITUDE_JITTER,
    }
    return replace(maneuver, **jitter)


def n_steps(test: PlannedManeuver) -> int:
    """Computed steps of a rollout, including its run-up."""
    run_up = test.imperfections.run_up(test.dt)
    return (run_up + test.maneuver.n_samples(test.dt)) * test.substeps


def check_steps(test: PlannedManeuver) -> None:
    """ValueError for more steps than fit in memory."""
    n_samples = test.maneuver.n_samples(test.dt)
    if n_samples * test.substeps > MOST_SAMPLES:
        raise ValueError(
            f"a rollout has {n_samples} samples in {test.substeps} substeps: at most "
            f"{MOST_SAMPLES} steps fit, choose a larger dt or a shorter manoeuvre"
        )


def check_observations(test: PlannedManeuver) -> None:
    """ValueError for more observation times than samples, or for a single sample."""
    n_samples = test.maneuver.n_samples(test.dt)
    if not 2 <= n_samples >= test.n_obs:
        raise ValueError(
            f"n_obs={test.n_obs} was given: a rollout has {n_samples} samples, choose fewer "
            "observation times or a smaller dt"
        )


class Drawn(NamedTuple):
    """The random part of flights: theta (n, n_parameters), commands (1 or n, n_samples,
    n_surfaces) with the run-up, samples at rest (n,), gusts (n, n_steps) each, pilots in the loop,
    whose `gave_up` is written by the flights."""

    theta: Array
    commands: Array
    rest: Indices
    gusts: tuple[Array, ...]
    in_loop: Pilots = NOBODY

    def some(self, which: Indices | slice) -> "Drawn":
        commands = self.commands if len(self.commands) == 1 else self.commands[which]
        gusts = tuple(gust[which] for gust in self.gusts)
        pilots = self.in_loop.some(which)
        return Drawn(self.theta[which], commands, self.rest[which], gusts, pilots)


class ManeuverSimulator(ABC):
    """Flies a planned manoeuvre on any aircraft, and stops it on the way."""

    dictionary: Dictionary
    gust: LateralGust | None
    n_gusts = 1
    crew: Crew | None = None

    @property
    @abstractmethod
    def test(self) -> PlannedManeuver: ...

    @property
    @abstractmethod
    def limits(self) -> Envelope:
        """Of the channels of the dictionary."""

    @property
    @abstractmethod
    def parameters(self) -> Parameters: ...

    @abstractmethod
    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """Draw theta (n, n_parameters)."""

    @abstractmethod
    def margins(self, theta: Array) -> Margins:
        """Stability margins of theta (n, n_parameters). ValueError where the loop is unknown."""

    @abstractmethod
    def outputs(self, drawn: Drawn) -> Array:
        """True outputs (n, n_steps, n_measured), including the run-up; in fresh arrays."""

    @property
    def dt(self) -> float:
        return self.test.dt

    def rollouts(self, n: int, rng: np.random.Generator) -> Rollouts:
        """Roll out n random aircraft."""
        return self._rolled_out(self._drawn(n, rng), rng, lambda y, trim: None)

    def fly(
        self, theta: Array, rng: np.random.Generator, scale: Array | None = None
    ) -> tuple[Rollouts, Array]:
        """Fly these aircraft, theta (n, n_parameters), each with its own pilot.

        scale: (n,) factors on their commands.
        Returns the rollouts, and (n,) the largest part of a limit reached by the true outputs,
        infinite for a diverged flight.
        """
        pilot = self.test.maneuver.pilot(self.dt, len(theta), rng)
        if scale is not None:
            pilot = scale[:, np.newaxis, np.newaxis] * pilot
        peaks: list[Array] = []

        def look(y: Array, trim: Array) -> None:
            parts = self.limits.shares(complete(self.dictionary, y, self.dt))
            peaks.append(np.nan_to_num(parts, nan=np.inf, posinf=np.inf).max(axis=(1, 2)))

        rollouts = self._rolled_out(self._flown(theta, pilot, rng), rng, look)
        return rollouts, np.concatenate(peaks)

    def _rolled_out(self, drawn: Drawn, rng: np.random.Generator, look: Look) -> Rollouts:
        """Roll out flights as measured. look: as in `recorded`; trim is 0 without
        imperfections."""
        if not self.test.imperfections.are_none:
            return self._recorded(drawn, rng, look)
        y = self.outputs(drawn)
        first = self._first_exceedance(y, drawn)
        y = np.ascontiguousarray(y[:, :: self.test.substeps])
        look(y, np.zeros_like(y[:, 0]))
        self.test.noise.add_to(y, rng)
        return Rollouts(complete(self.dictionary, y, self.dt), first, drawn.theta)

    def recorded(self, n: int, rng: np.random.Generator, look: Look) -> Rollouts:
        """Roll out n aircraft as flown and recorded, with any imperfections.

        look: called with the true outputs and trim, see `Look`; gust and inexact inputs shift
        trim from 0.
        """
        return self._recorded(self._drawn(n, rng), rng, look)

    def _recorded(self, drawn: Drawn, rng: np.random.Generator, look: Look) -> Rollouts:
        test, n = self.test, len(drawn.theta)
        start = test.imperfections.run_up(test.dt) * test.substeps
        noise = channel_array(test.noise, self.dictionary.measured)
        seed, step = seed_of(rng), test.dt / test.substeps
        out = np.empty((n, test.maneuver.n_samples(test.dt), len(noise)))
        fail_index = np.empty(n, np.int64)
        for block in (slice(first, first + BLOCK) for first in range(0, n, BLOCK)):
            some = drawn.some(block)
            y = self.outputs(some)
            trim = y[:, start].copy()
            fail_index[block] = self._first_exceedance(y, some)
            trim -= y[:, start]
            look(y[:, start :: test.substeps], trim)
            test.imperfections.record(
                y, start, test.substeps, drawn.rest[block], noise, step, seed,
                self.dictionary, block.start, out[block],
            )  # fmt: skip
        return Rollouts(complete(self.dictionary, out, self.dt), fail_index, drawn.theta)

    def stopping(self, n: int, rng: np.random.Generator, theta: Array | None = None) -> Stopped:
        """Draw n flights from rng as `rollouts` does, to fly some again with the manoeuvre stopped.

        theta: (n, n_parameters) of given aircraft; their flights are then drawn as in `fly`.
        Neutral controls are reached with the manoeuvre's pedal lag.
        """
        if theta is None:
            theta, pilot = self._planned(n, rng)
        else:
            pilot = self.test.maneuver.pilot(self.dt, n, rng)
        pilot, rng_before = np.broadcast_to(pilot, (n, *pilot.shape[1:])), deepcopy(rng)
        drawn = self._flown(theta, pilot, rng)

        def stopped(which: Indices, neutral_from: Indices) -> Indices:
            if not len(which):
                return which
            commands = pilot[which]
            is_neutral = np.arange(pilot.shape[1]) >= neutral_from[:, np.newaxis]
            commands[is_neutral] = 0.0
            repeated = drawn.some(which)._replace(commands=commands)
            if not self.test.imperfections.are_none:
                all_commands = pilot.copy()
                all_commands[which] = commands
                all_commands, _ = self._inexact(all_commands, n, deepcopy(rng_before))
                repeated = repeated._replace(commands=all_commands[which])
            return self._first_exceedance(self.outputs(repeated), repeated)

        return stopped

    def commands(self, n: int, rng: np.random.Generator) -> Array:
        """Commands (n, n_samples, n_surfaces) [rad] of the n flights that `rollouts` draws from
        rng, before imperfections."""
        _, pilot = self._planned(n, rng)
        return np.broadcast_to(pilot, (n, *pilot.shape[1:]))

    def _drawn(self, n: int, rng: np.random.Generator) -> Drawn:
        """The random part of n flights."""
        return self._flown(*self._planned(n, rng), rng)

    def _planned(self, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Theta (n, n_parameters), and the pilot's commands (1 or n, n_samples, n_surfaces)."""
        theta = self.sample(n, rng)
        return theta, self.test.maneuver.pilot(self.dt, n, rng)

    def _flown(self, theta: Array, pilot: Array, rng: np.random.Generator) -> Drawn:
        """Add imperfections to these flights."""
        test, n = self.test, len(theta)
        if test.imperfections.are_none:
            in_loop = self._pilots(n, pilot.shape[1], rng)
            return Drawn(theta, pilot, np.zeros(n, np.int64), (), in_loop)
        commands, rest = self._inexact(pilot, n, rng)
        n_steps, step = (commands.shape[1] - 1) * test.substeps + 1, test.dt / test.substeps
        gusts = (
            test.imperfections.gusts(self.gust, n, n_steps, step, rng) for _ in range(self.n_gusts)
        )
        blowing = tuple(gust for gust in gusts if gust is not None)
        return Drawn(theta, commands, rest, blowing, self._pilots(n, commands.shape[1], rng))

    def _pilots(self, n: int, n_samples: int, rng: np.random.Generator) -> Pilots:
        if self.crew is None:
            return NOBODY
        return self.crew.draw(n, n_samples, self.dt, self.test.noise, rng)

    def _inexact(self, pilot: Array, n: int, rng: np.random.Generator) -> tuple[Array, Indices]:
        """Commands as n pilots fly them, with a run-up before; and samples at rest."""
        lead_in = round(self.test.maneuver.lead_in_s / self.dt)
        return self.test.imperfections.fly(pilot, n, self.dt, lead_in, rng)

    def _first_exceedance(self, y: Array, drawn: Drawn) -> Indices:
        """(n,) first sample that exceeds a limit, or at which the pilot gives up if that labels
        flights, the last one of aircraft with too little stability margin if that does; n_samples
        for none. Subtracts trim from y."""
        test, every = self.test, self.test.substeps
        n_samples = test.maneuver.n_samples(test.dt)
        if not test.imperfections.are_none:
            start = test.imperfections.run_up(test.dt) * every
            y = from_trim(y, start, every, drawn.rest, self.dictionary)
        if test.margins.label:
            theta, which = np.unique(drawn.theta, axis=0, return_inverse=True)
            unsafe = test.margins.too_little(self.margins(theta))[which.ravel()]
            return n_samples - unsafe
        if test.pilot.label:
            gave_up = drawn.in_loop.gave_up - test.imperfections.run_up(test.dt)
            return np.clip(gave_up, 0, n_samples)
        whole = complete(self.dictionary, y, test.dt / every)
        first = -(-self.limits.first_exceedance(whole) // every)
        return np.minimum(first, n_samples)
