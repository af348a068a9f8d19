"""Flights of a planned manoeuvre on random aircraft, as flown, judged and recorded."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from copy import deepcopy
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from core.channels import Dictionary
from core.computed import complete
from core.kernels.compiled import in_chunks
from core.kernels.pilot import NOBODY, Pilots
from core.limits.limits import Envelope
from core.simulation.imperfections import channel_array, seed_of, trim_of
from core.simulation.pilot import Crew
from core.simulation.simulator import Parameters, Rollouts, Stopped
from core.simulation.stability_margins import Margins
from core.simulation.turbulence import LateralGust, sideslip_gusts
from core.types import Array, Indices

if TYPE_CHECKING:
    from core.planned_test.planned_test import ManeuverTest

Look = Callable[[slice, Array, Array], object]
"""Called with a block of flights, their true outputs (n, n_samples, n_measured), from trim where
channels count from it, and that trim (n, n_measured)."""
Planned = Callable[[slice], Array]
"""Commands (1 or n, n_samples, n_surfaces) [rad] of a block of flights, before imperfections."""
BLOCK = 256
"""Flights whose commands and true outputs the processor's cache holds until they are recorded."""


class Drawn(NamedTuple):
    """The random part of flights: theta (n, n_parameters), commands (1 or n, n_samples,
    n_surfaces) with the run-up, samples at rest (n,), gusts (n, n_steps) each, pilots in the loop,
    whose `gave_up` is written by the flights, and how many of the first outputs may be missing."""

    theta: Array
    commands: Array
    rest: Indices
    gusts: tuple[Array, ...]
    in_loop: Pilots = NOBODY
    unused: int = 0

    def some(self, which: Indices) -> "Drawn":
        commands = self.commands if len(self.commands) == 1 else self.commands[which]
        gusts = tuple(gust[which] for gust in self.gusts)
        pilots = self.in_loop.some(which)
        return Drawn(self.theta[which], commands, self.rest[which], gusts, pilots)


class ManeuverSimulator(ABC):
    """Flies a planned manoeuvre on any aircraft, and stops it on the way."""

    dictionary: Dictionary
    gust: LateralGust | None
    n_gusts = 1
    in_threads = False
    """Whether blocks of flights may be computed in several threads at once."""
    crew: Crew | None = None

    @property
    @abstractmethod
    def test(self) -> "ManeuverTest": ...

    @property
    @abstractmethod
    def limits(self) -> Envelope:
        """Limits of the dictionary's channels."""

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
        """True outputs (n, n_steps, n_measured), including the run-up unless `unused`; in fresh
        arrays."""

    @property
    def dt(self) -> float:
        return self.test.dt

    def rollouts(self, n: int, rng: np.random.Generator) -> Rollouts:
        """Roll out n random aircraft."""
        return self._rolled_out(*self._planned(n, rng), rng)

    def fly(
        self, theta: Array, rng: np.random.Generator, scale: Array | None = None
    ) -> tuple[Rollouts, Array]:
        """Fly these aircraft, theta (n, n_parameters), each with its own pilot.

        scale: (n,) factors on their commands.
        Returns the rollouts, and (n,) the largest part of a limit reached by the true outputs,
        infinite for a diverged flight.
        """
        planned, peaks = self._by_hands(len(theta), rng), np.empty(len(theta))

        def scaled(block: slice) -> Array:
            return planned(block) if scale is None else scale[block, None, None] * planned(block)

        def look(block: slice, y: Array, trim: Array) -> None:
            parts = self.limits.shares(complete(self.dictionary, y, self.dt))
            peaks[block] = np.nan_to_num(parts, nan=np.inf, posinf=np.inf).max(axis=(1, 2))

        return self._rolled_out(theta, scaled, rng, look), peaks

    def _rolled_out(
        self, theta: Array, planned: Planned, rng: np.random.Generator, look: Look | None = None
    ) -> Rollouts:
        """Roll out flights as measured. look: as in `recorded`; trim is 0 without
        imperfections."""
        if not self.test.imperfections.are_none:
            return self._recorded(theta, planned, rng, look)
        every = slice(0, len(theta))
        drawn = self._flown(theta, planned, rng)(every)
        y = self.outputs(drawn)
        first = self._first_exceedance(y, self._trim(y, drawn), drawn)
        y = np.ascontiguousarray(y[:, :: self.test.substeps])
        if look is not None:
            look(every, y, np.zeros_like(y[:, 0]))
        self.test.noise.add_to(y, rng)
        return Rollouts(complete(self.dictionary, y, self.dt), first, theta)

    def recorded(self, n: int, rng: np.random.Generator, look: Look) -> Rollouts:
        """Roll out n aircraft as flown and recorded, with any imperfections.

        look: called with the true outputs and trim, see `Look`; gust and inexact inputs shift
        trim from 0.
        """
        return self._recorded(*self._planned(n, rng), rng, look)

    def _recorded(
        self, theta: Array, planned: Planned, rng: np.random.Generator, look: Look | None
    ) -> Rollouts:
        test, n, flown = self.test, len(theta), self._flown(theta, planned, rng)
        noise = channel_array(test.noise, self.dictionary.measured)
        seed, step = seed_of(rng), test.dt / test.substeps
        unused = test.imperfections.unused(test.dt, test.substeps)
        out = np.empty((n, test.maneuver.n_samples(test.dt), len(noise)))
        fail_index = np.empty(n, np.int64)

        def record(first: int, last: int) -> None:
            for begin in range(first, last, BLOCK):
                block = slice(begin, min(begin + BLOCK, last))
                some = flown(block)
                y = self.outputs(some._replace(unused=unused))
                start = self._start(y)
                trim = self._trim(y, some)
                fail_index[block] = self._first_exceedance(y, trim, some)
                if look is not None:
                    look(block, y[:, start :: test.substeps] - trim[:, np.newaxis], trim)
                test.imperfections.record(
                    y, trim, start, test.substeps, some.rest, noise, step, seed,
                    self.dictionary, begin, out[block],
                )  # fmt: skip

        in_chunks(n, BLOCK if self.in_threads else n, record)
        return Rollouts(complete(self.dictionary, out, self.dt), fail_index, theta)

    def stopping(self, n: int, rng: np.random.Generator, theta: Array | None = None) -> Stopped:
        """Draw n flights from rng as `rollouts` does, to fly some again with the manoeuvre stopped.

        theta: (n, n_parameters) of given aircraft; their flights are then drawn as in `fly`.
        Neutral controls are reached with the manoeuvre's pedal lag.
        """
        if theta is None:
            theta, planned = self._planned(n, rng)
        else:
            planned = self._by_hands(n, rng)
        pilot, rng_before = self._all(planned, n), deepcopy(rng)
        drawn = self._flown(theta, planned, rng)(slice(0, n))

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
                all_commands, _ = self._inexact(all_commands, n, seed_of(deepcopy(rng_before)))
                repeated = repeated._replace(commands=all_commands[which])
            y = self.outputs(repeated)
            return self._first_exceedance(y, self._trim(y, repeated), repeated)

        return stopped

    def commands(self, n: int, rng: np.random.Generator) -> Array:
        """Commands (n, n_samples, n_surfaces) [rad] of the n flights that `rollouts` draws from
        rng, before imperfections."""
        _, planned = self._planned(n, rng)
        return self._all(planned, n)

    def _all(self, planned: Planned, n: int) -> Array:
        pilot = planned(slice(0, n))
        return np.broadcast_to(pilot, (n, *pilot.shape[1:]))

    def _drawn(self, n: int, rng: np.random.Generator) -> Drawn:
        """The random part of n flights."""
        return self._flown(*self._planned(n, rng), rng)(slice(0, n))

    def _planned(self, n: int, rng: np.random.Generator) -> tuple[Array, Planned]:
        """Theta (n, n_parameters), and the commands of their pilots."""
        theta = self.sample(n, rng)
        return theta, self._by_hands(n, rng)

    def _by_hands(self, n: int, rng: np.random.Generator) -> Planned:
        """Draw the scatter of n pilots."""
        hands = self.test.maneuver.hands(n, rng)
        return lambda block: self.test.maneuver.flown(self.dt, hands.some(block))

    def _flown(
        self, theta: Array, planned: Planned, rng: np.random.Generator
    ) -> Callable[[slice], Drawn]:
        """Draw the imperfections of these flights; returns a function that draws a block."""
        test, n, errors = self.test, len(theta), self.test.imperfections
        n_gusts = 0 if self.gust is None else self.n_gusts
        seeds = [] if errors.are_none else [seed_of(rng) for _ in range(1 + n_gusts)]
        n_samples = errors.run_up(test.dt) + test.maneuver.n_samples(test.dt)
        n_steps, step = (n_samples - 1) * test.substeps + 1, test.dt / test.substeps
        in_loop = NOBODY
        if self.crew is not None:
            in_loop = self.crew.draw(n, n_samples, self.dt, test.noise, rng)

        def some(block: slice) -> Drawn:
            commands, own, first = planned(block), theta[block], block.start
            rest, gusts = np.zeros(len(own), np.int64), ()
            if seeds:
                commands, rest = self._inexact(commands, len(own), seeds[0], first)
            if self.gust is not None:
                about = self.gust, step, len(own), n_steps
                gusts = tuple(sideslip_gusts(*about, seed, first) for seed in seeds[1:])
            return Drawn(own, commands, rest, gusts, in_loop.some(block))

        return some

    def _inexact(
        self, planned: Array, n: int, seed: np.uint64, number: int = 0
    ) -> tuple[Array, Indices]:
        """Commands as n pilots fly them, with a run-up before; and samples at rest."""
        lead_in = round(self.test.maneuver.lead_in_s / self.dt)
        return self.test.imperfections.fly(planned, n, self.dt, lead_in, seed, number)

    def _start(self, y: Array) -> int:
        """The step at which rollouts begin, after the run-up."""
        return y.shape[1] - (self.test.maneuver.n_samples(self.dt) - 1) * self.test.substeps - 1

    def _trim(self, y: Array, drawn: Drawn) -> Array:
        """(n, n_measured) from which true outputs count: 0 without imperfections."""
        if self.test.imperfections.are_none:
            return np.zeros_like(y[:, 0])
        return trim_of(y, self._start(y), self.test.substeps, drawn.rest, self.dictionary)

    def _first_exceedance(self, y: Array, trim: Array, drawn: Drawn) -> Indices:
        """(n,) first sample that exceeds a limit, or at which the pilot gives up if that labels
        flights, the last one of aircraft with too little stability margin if that does; n_samples
        for none."""
        test, every = self.test, self.test.substeps
        n_samples = test.maneuver.n_samples(test.dt)
        if test.margins.label:
            theta, which = np.unique(drawn.theta, axis=0, return_inverse=True)
            unsafe = test.margins.too_little(self.margins(theta))[which.ravel()]
            return n_samples - unsafe
        if test.pilot.label:
            gave_up = drawn.in_loop.gave_up - test.imperfections.run_up(test.dt)
            return np.clip(gave_up, 0, n_samples)
        y = y[:, self._start(y) :]
        if self.dictionary.formulas:
            y = complete(self.dictionary, y - trim[:, np.newaxis], test.dt / every)
            trim = np.zeros((1, y.shape[2]))
        first = -(-self.limits.first_exceedance(y, trim) // every)
        return np.minimum(first, n_samples)
