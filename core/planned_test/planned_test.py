"""The planned test: a manoeuvre on an uncertain aircraft, its limits, its simulation."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from math import radians
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import KEYS, LATERAL, Dictionary
from core.limits.limits import Limits
from core.monitor.group import GROUPINGS, Grouping
from core.recipe import to_plain
from core.simulation.aircraft import AIRCRAFT, Aircraft
from core.simulation.control_law import CONTROL_LAWS, ControlLaw, check_usable
from core.simulation.imperfections import (
    USUAL_IMPERFECTIONS,
    ByChannel,
    Imperfections,
    channel_array,
    from_trim,
)
from core.simulation.maneuver import MANEUVERS, Maneuver
from core.simulation.rollout import roll_out, sideslip_state
from core.simulation.simulator import Parameters, Rollouts, Stopped
from core.types import Array, Indices

DEFAULT_AIRCRAFT = AIRCRAFT["f16_sl_h0_v502"]
USUAL = DEFAULT_AIRCRAFT.condition.usual_test
MOST_SAMPLES = 20_000
"""Largest number of steps of a rollout, so that a chunk fits in memory."""
LARGEST_CHUNK = 4096
CHUNK_STEPS = 2_000_000
"""Steps of all rollouts of a chunk: about 100 MB."""


@dataclass(frozen=True)
class SensorNoise(ByChannel):
    """White Gaussian sensor noise, 1 sigma of each channel in its SI unit.

    It is not fed back, and limits are judged without it.
    """

    called: ClassVar[str] = "noise"

    def add_to(self, y: Array, rng: np.random.Generator) -> None:
        """Add noise to y (n, n_samples, 6) in place, channel by channel."""
        for c, key in enumerate(KEYS):
            if deviation := getattr(self, key):
                y[..., c] += deviation * rng.standard_normal(y.shape[:2])


USUAL_NOISE = SensorNoise(
    beta=radians(0.05),
    p=radians(0.1),
    r=radians(0.1),
    Ny=0.003,
    delta_a=radians(0.02),
    delta_r=radians(0.02),
)
"""Noise of a flight-test vane, rate gyros, accelerometer and position transducers."""
USUAL_TIMING_JITTER_S, USUAL_AMPLITUDE_JITTER = 0.1, 0.15
"""Scatter of a pilot who flies a doublet by hand."""
USUAL_SOFTNESS_S = 0.5
"""No two pilots move the pedals alike: with their lag of 0.1 s, 0.1 to 0.6 s."""


@dataclass(frozen=True)
class DatasetRecipe:
    """The planned test and how much of it to simulate.

    The default is the usual test of an F-16 with yaw and roll damper: a rudder doublet that exceeds
    a limit on about a quarter of the aircraft.
    """

    aircraft: Aircraft = DEFAULT_AIRCRAFT
    control_law: ControlLaw = CONTROL_LAWS[USUAL.control_law]
    maneuver: Maneuver = MANEUVERS["rudder_doublet"].with_peak(USUAL.doublet_deg)  # noqa: RUF009
    specification: Limits = Limits(Ny=USUAL.limit_g)  # noqa: RUF009
    noise: SensorNoise = SensorNoise()
    """sensor noise: white and Gaussian, 1 sigma of each channel."""
    imperfections: Imperfections = Imperfections()  # noqa: RUF009
    """imperfections of a real flight: effects besides noise and jitter, drawn for each rollout."""
    dt: Annotated[float, Bounds(above=0)] = 0.05
    """sample interval of the telemetry [s]."""
    substeps: Annotated[int, Bounds(least=1)] = 1
    """substeps of a sample: limits are checked after each; an exceedance between two samples counts
    at the later one."""
    n_unsafe: Annotated[int, Bounds(least=2)] = 50
    """unsafe rollouts to collect; at least as many of each group."""
    groups: Grouping = GROUPINGS["pooled"]
    """groups of failing rollouts: each gets enough of them, for a monitor calibrated by groups."""
    n_obs: Annotated[int, Bounds(least=1)] = 50
    """observation times kept of each safe rollout."""
    seed: Annotated[int, Bounds(least=0)] = 0
    """seed of every random draw: the same recipe makes the same dataset."""
    max_rollouts: Annotated[int, Bounds(least=1)] = 1_000_000
    """budget of rollouts: a collection that would exceed it stops early."""
    max_safe: Annotated[int, Bounds(least=1)] = 50_000
    """safe rollouts kept: the first ones; further ones are only counted."""

    for_more: ClassVar[str] = "raise the amplitude, lower the limit"
    for_fewer: ClassVar[str] = "lower the amplitude, raise the limit"
    """How more, or fewer, flights of the test fail."""

    def __post_init__(self) -> None:
        if not 0 < self.dt < self.maneuver.duration_s:
            raise ValueError(
                f"dt={self.dt} s was given: it must be positive and shorter than the manoeuvre's "
                f"{self.maneuver.duration_s:g} s"
            )
        n_samples = self.maneuver.n_samples(self.dt)
        if n_samples * self.substeps > MOST_SAMPLES:
            raise ValueError(
                f"a rollout has {n_samples} samples in {self.substeps} substeps: at most "
                f"{MOST_SAMPLES} steps fit, choose a larger dt or a shorter manoeuvre"
            )
        check_bounds(self)
        if self.n_obs > n_samples:
            raise ValueError(
                f"n_obs={self.n_obs} was given: a rollout has {n_samples} samples, choose fewer "
                "observation times or a smaller dt"
            )

    def simulator(self) -> "LateralSimulator":
        return LateralSimulator(self)

    def to_plain(self) -> dict[str, Any]:
        return to_plain(self)

    @property
    def most_at_once(self) -> int:
        """Rollouts that fit in memory together."""
        return max(1, min(LARGEST_CHUNK, CHUNK_STEPS // self.n_steps))

    @property
    def n_steps(self) -> int:
        """Computed steps of a rollout, including its run-up."""
        run_up = self.imperfections.run_up(self.dt)
        return (run_up + self.maneuver.n_samples(self.dt)) * self.substeps

    @classmethod
    def usual(cls, aircraft: Aircraft) -> "DatasetRecipe":
        """The usual first test of this aircraft: about a quarter of the rollouts exceed a limit."""
        usual = aircraft.condition.usual_test
        return cls(
            aircraft=aircraft,
            control_law=CONTROL_LAWS[usual.control_law],
            maneuver=MANEUVERS["rudder_doublet"].with_peak(usual.doublet_deg),
            specification=Limits(Ny=usual.limit_g),
        )

    def as_flown(self) -> "DatasetRecipe":
        """The same test with the usual noise, jitter and imperfections of real flights."""
        maneuver = replace(
            self.maneuver,
            timing_jitter_s=USUAL_TIMING_JITTER_S,
            amplitude_jitter=USUAL_AMPLITUDE_JITTER,
        )
        return replace(
            self, maneuver=maneuver, noise=USUAL_NOISE, imperfections=USUAL_IMPERFECTIONS
        )

    def as_trained(self) -> "DatasetRecipe":
        """The test as flown by pilots of different softness, to train a monitor for any of them."""
        flown = self.as_flown()
        soft = replace(flown.imperfections, softness_s=USUAL_SOFTNESS_S)
        return replace(flown, imperfections=soft)


Look = Callable[[Array, Array], object]
"""Called with the true outputs from trim (n, n_samples, 6), and with that trim (n, 6)."""


class LateralSimulator:
    """The linear lateral plant: it can fly, stop, and be planned otherwise, from its recipe."""

    dictionary: Dictionary = LATERAL

    def __init__(self, recipe: DatasetRecipe, spread: float = 1.0) -> None:
        """spread: width of D_theta about its mean, as a multiple of the recipe's."""
        self.recipe, self.spread = recipe, spread
        self.plant = recipe.aircraft.uncertain_plant()
        self.controller = recipe.control_law.controller(self.plant)
        check_usable(
            self.plant,
            self.controller,
            recipe.control_law.actuator,
            recipe.maneuver.duration_s,
        )
        condition = recipe.aircraft.condition
        self.gust = recipe.imperfections.gust(condition.altitude, condition.airspeed)
        if self.gust is not None:
            sideslip_state(self.plant.nominal_plant())

    @property
    def dt(self) -> float:
        return self.recipe.dt

    @property
    def parameters(self) -> Parameters:
        return self.plant.parameters

    def rollouts(self, n: int, rng: np.random.Generator) -> Rollouts:
        """Roll out n aircraft drawn from D_theta."""
        return self._rolled_out(self._drawn(n, rng), rng, lambda y, trim: None)

    def fly(
        self, theta: Array, rng: np.random.Generator, scale: Array | None = None
    ) -> tuple[Rollouts, Array]:
        """Fly these aircraft, theta (n, n_parameters), each with its own pilot.

        scale: (n,) factors on their commands.
        Returns the rollouts, and (n,) the largest part of a limit reached by the true outputs,
        infinite for a diverged flight.
        """
        pilot = self.recipe.maneuver.pilot(self.recipe.dt, len(theta), rng)
        if scale is not None:
            pilot = scale[:, np.newaxis, np.newaxis] * pilot
        peaks: list[Array] = []

        def look(y: Array, trim: Array) -> None:
            parts = np.abs(y) / self.recipe.specification.magnitudes
            peaks.append(np.nan_to_num(parts, nan=np.inf, posinf=np.inf).max(axis=(1, 2)))

        rollouts = self._rolled_out(self._flown(theta, pilot, rng), rng, look)
        return rollouts, peaks[0]

    def _rolled_out(self, drawn: "_Drawn", rng: np.random.Generator, look: Look) -> Rollouts:
        """Roll out flights as measured. look: as in `recorded`; trim is 0 without
        imperfections."""
        if not self.recipe.imperfections.are_none:
            return self._recorded(drawn, rng, look)
        y = self._outputs(drawn)
        first = self._first_exceedance(y, drawn)
        y = np.ascontiguousarray(y[:, :: self.recipe.substeps])
        look(y, np.zeros_like(y[:, 0]))
        self.recipe.noise.add_to(y, rng)
        return Rollouts(y, first, drawn.theta)

    def recorded(self, n: int, rng: np.random.Generator, look: Look) -> Rollouts:
        """Roll out n aircraft as flown and recorded, with any imperfections.

        look: called with the true outputs from trim (n, n_samples, 6) and that trim (n, 6); gust
        and inexact inputs shift it from 0.
        """
        return self._recorded(self._drawn(n, rng), rng, look)

    def _recorded(self, drawn: "_Drawn", rng: np.random.Generator, look: Look) -> Rollouts:
        recipe, imperfections = self.recipe, self.recipe.imperfections
        every, step = recipe.substeps, recipe.dt / recipe.substeps
        start = imperfections.run_up(recipe.dt) * every
        y = self._outputs(drawn)
        trim = y[:, start].copy()
        first = self._first_exceedance(y, drawn)
        trim -= y[:, start]
        look(y[:, start::every], trim)
        noise = channel_array(recipe.noise)
        out = imperfections.record(y, start, every, drawn.rest, noise, step, rng)
        return Rollouts(out, first, drawn.theta)

    def stopping(self, n: int, rng: np.random.Generator, theta: Array | None = None) -> Stopped:
        """Draw n flights from rng as `rollouts` does, to fly some again with the manoeuvre stopped.

        theta: (n, n_parameters) of given aircraft; their flights are then drawn as in `fly`.
        Neutral controls are reached with the manoeuvre's pedal lag.
        """
        if theta is None:
            theta, pilot = self._planned(n, rng)
        else:
            pilot = self.recipe.maneuver.pilot(self.recipe.dt, n, rng)
        pilot, rng_before = np.broadcast_to(pilot, (n, *pilot.shape[1:])), deepcopy(rng)
        drawn = self._flown(theta, pilot, rng)

        def stopped(which: Indices, neutral_from: Indices) -> Indices:
            if not len(which):
                return which
            commands = pilot[which]
            is_neutral = np.arange(pilot.shape[1]) >= neutral_from[:, np.newaxis]
            commands[is_neutral] = 0.0
            repeated = drawn.some(which)._replace(commands=commands)
            if not self.recipe.imperfections.are_none:
                all_commands = pilot.copy()
                all_commands[which] = commands
                all_commands, _ = self._inexact(all_commands, n, deepcopy(rng_before))
                repeated = repeated._replace(commands=all_commands[which])
            return self._first_exceedance(self._outputs(repeated), repeated)

        return stopped

    def commands(self, n: int, rng: np.random.Generator) -> Array:
        """Commands (n, n_samples, 2) [rad] of the n flights that `rollouts` draws from rng.

        Before imperfections.
        """
        _, pilot = self._planned(n, rng)
        return np.broadcast_to(pilot, (n, *pilot.shape[1:]))

    def _drawn(self, n: int, rng: np.random.Generator) -> "_Drawn":
        """The random part of n flights."""
        return self._flown(*self._planned(n, rng), rng)

    def _planned(self, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Theta (n, n_parameters), and the pilot's commands (1 or n, n_samples, 2)."""
        recipe = self.recipe
        theta = self.plant.sample(n, rng)
        if self.spread != 1.0:
            theta = self.plant.nominal + self.spread * (theta - self.plant.nominal)
        return theta, recipe.maneuver.pilot(recipe.dt, n, rng)

    def _flown(self, theta: Array, pilot: Array, rng: np.random.Generator) -> "_Drawn":
        """Add imperfections to these flights."""
        recipe, n = self.recipe, len(theta)
        if recipe.imperfections.are_none:
            return _Drawn(theta, pilot, np.zeros(n, np.int64), None)
        commands, rest = self._inexact(pilot, n, rng)
        n_steps, step = (commands.shape[1] - 1) * recipe.substeps + 1, recipe.dt / recipe.substeps
        return _Drawn(
            theta, commands, rest, recipe.imperfections.gusts(self.gust, n, n_steps, step, rng)
        )

    def _inexact(self, pilot: Array, n: int, rng: np.random.Generator) -> tuple[Array, Indices]:
        """Commands as n pilots fly them, with a run-up before; and samples at rest."""
        recipe = self.recipe
        lead_in = round(recipe.maneuver.lead_in_s / recipe.dt)
        return recipe.imperfections.fly(pilot, n, recipe.dt, lead_in, rng)

    def _outputs(self, drawn: "_Drawn") -> Array:
        """True outputs (n, n_steps, 6), including the run-up."""
        recipe = self.recipe
        return roll_out(
            self.plant.plants(drawn.theta),
            self.controller,
            recipe.control_law.actuator,
            drawn.commands,
            recipe.dt,
            pedal_lag_s=recipe.maneuver.pedal_lag_s,
            substeps=recipe.substeps,
            gust=drawn.gust,
        )

    def _first_exceedance(self, y: Array, drawn: "_Drawn") -> Indices:
        """(n,) first sample that exceeds a limit, n_samples for none. Subtracts trim from y."""
        recipe, every = self.recipe, self.recipe.substeps
        if not recipe.imperfections.are_none:
            y = from_trim(y, recipe.imperfections.run_up(recipe.dt) * every, every, drawn.rest)
        first = -(-recipe.specification.first_exceedance(y) // every)
        return np.minimum(first, recipe.maneuver.n_samples(recipe.dt))


class _Drawn(NamedTuple):
    """The random part of flights: theta (n, n_parameters), commands (1 or n, n_samples, 2) with the
    run-up, samples at rest (n,), gust (n, n_steps) or None."""

    theta: Array
    commands: Array
    rest: Indices
    gust: Array | None

    def some(self, which: Indices) -> "_Drawn":
        commands = self.commands if len(self.commands) == 1 else self.commands[which]
        gust = None if self.gust is None else self.gust[which]
        return _Drawn(self.theta[which], commands, self.rest[which], gust)


@runtime_checkable
class Replans(Protocol):
    """A simulator of a planned manoeuvre that can be planned otherwise: other amplitudes, hands,
    noise or aircraft. Amplitude search, cards and campaigns need one."""

    recipe: DatasetRecipe
