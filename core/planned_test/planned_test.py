"""The planned test: a manoeuvre on an uncertain aircraft, its limits, its simulation."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import radians
from typing import Annotated, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import KEYS, LATERAL, Dictionary
from core.limits.limits import Envelope, Limits, Specification
from core.monitor.group import GROUPINGS, Grouping
from core.planned_test.maneuver_simulator import Drawn, ManeuverSimulator
from core.recipe import later, to_plain
from core.seeds import Branch, stream
from core.simulation.aircraft import AIRCRAFT, Aircraft
from core.simulation.control_law import (
    CONTROL_LAWS,
    FEEDBACK,
    PHI_STATE,
    ControlLaw,
    check_usable,
    closed_loops,
    measured_rows,
)
from core.simulation.imperfections import (
    USUAL_IMPERFECTIONS,
    ByChannel,
    Imperfections,
)
from core.simulation.maneuver import (
    COLUMN,
    LATERAL_MANEUVERS,
    LATERAL_SURFACES,
    MANEUVERS,
    MOVED_BY,
    Axis,
    Maneuver,
)
from core.simulation.pilot import OpenLoop, Pilot, Sight
from core.simulation.rollout import roll_out, sideslip_state
from core.simulation.simulator import Parameters
from core.simulation.stability_margins import LeastMargins, Margins, stability_margins
from core.simulation.uncertain_plant import Plants
from core.types import Array

DEFAULT_AIRCRAFT = AIRCRAFT["f16_sl_h0_v502"]
USUAL = DEFAULT_AIRCRAFT.condition.usual_test
LARGEST_CHUNK = 4096
MARGIN_AIRCRAFT = 100
"""Aircraft whose stability margins an error names."""
CHUNK_STEPS, MOST_SAMPLES = 2_000_000, 20_000
"""Steps of all rollouts of a chunk, about 100 MB; largest number of steps of one rollout."""
USUAL_TIMING_JITTER_S, USUAL_AMPLITUDE_JITTER = 0.1, 0.15
"""Scatter of a pilot who flies a doublet by hand."""


@dataclass(frozen=True)
class SensorNoise(ByChannel):
    """White Gaussian sensor noise, 1 sigma of each channel in its SI unit.

    It is not fed back, and limits are judged without it.
    """

    called: ClassVar[str] = "noise"
    keys: ClassVar[tuple[str, ...]] = KEYS

    def add_to(self, y: Array, rng: np.random.Generator) -> None:
        """Add noise to y (n, n_samples, n_channels) in place, channel by channel."""
        for c, key in enumerate(self.keys[: y.shape[2]]):
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
SIGHTS: dict[Axis, Sight] = {
    "bank": Sight(FEEDBACK.index("phi")),
    "sideslip": Sight(FEEDBACK.index("beta")),
    "heading": Sight(FEEDBACK.index("r"), is_rate=True),
}
"""Motions of a linear aircraft that a pilot sees; without a bank angle, the integral of p."""
USUAL_SOFTNESS_S = 0.5
"""Pilots move the pedals differently: with their lag of 0.1 s, 0.1 to 0.6 s."""


@dataclass(frozen=True)
class ManeuverTest(ABC):
    """A planned manoeuvre on an uncertain aircraft, its limits, and how much of it to simulate."""

    aircraft: Any
    maneuver: Maneuver
    specification: Any
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
    max_rollouts: Annotated[int, Bounds(least=1)] = 100_000
    """budget of rollouts: a collection that would exceed it stops early."""
    max_safe: Annotated[int, Bounds(least=1)] = 10_000
    """safe rollouts kept: the first ones; further ones are only counted."""
    pilot: Pilot = later(OpenLoop())  # noqa: RUF009
    margins: LeastMargins = later(LeastMargins())  # noqa: RUF009
    """stability margins instead of limits: they label rollouts, and judge nothing in flight."""

    sights: ClassVar[Mapping[Axis, Sight]] = SIGHTS
    """motions of the aircraft that a pilot sees."""
    fewer: ClassVar[Mapping[str, Iterable[str]]] = {}
    """Parts of which it has not all members of their family, and those that it has; also choices
    of such a part, by part.choice."""
    usual_noise: ClassVar[SensorNoise] = USUAL_NOISE

    def __post_init__(self) -> None:
        if not 0 < self.dt < self.maneuver.duration_s:
            raise ValueError(
                f"dt={self.dt} s was given: it must be positive and shorter than the manoeuvre's "
                f"{self.maneuver.duration_s:g} s"
            )
        check_bounds(self)
        self.pilot.check(self.maneuver, self.sights)
        if self.pilot.label and self.margins.label:
            raise ValueError(
                "the pilot who gives up and stability margins would both label the rollouts: omit "
                "one"
            )
        n_samples = self.maneuver.n_samples(self.dt)
        if n_samples * self.substeps > MOST_SAMPLES:
            raise ValueError(
                f"a rollout has {n_samples} samples in {self.substeps} substeps: at most "
                f"{MOST_SAMPLES} steps fit, choose a larger dt or a shorter manoeuvre"
            )
        if not 2 <= n_samples >= self.n_obs:
            raise ValueError(
                f"n_obs={self.n_obs} was given: a rollout has {n_samples} samples, choose fewer "
                "observation times or a smaller dt"
            )

    @property
    def judged_by(self) -> Specification:
        """Limits or label that decide which flights fail."""
        return self.pilot.label or self.margins.label or self._limits()

    @property
    @abstractmethod
    def dictionary(self) -> Dictionary:
        """Channels of its flights."""

    @abstractmethod
    def _limits(self) -> Specification:
        """Limits of its flights, used unless the pilot or margins give a label."""

    @property
    def for_more(self) -> str:
        """How more flights of the test fail."""
        if self.margins.label:
            return f"{self.first_margins()}raise the least margin"
        return "raise the amplitude, lower the limit"

    @property
    def for_fewer(self) -> str:
        if self.margins.label:
            return f"{self.first_margins()}lower the least margin"
        return "lower the amplitude, raise the limit"

    def first_margins(self) -> str:
        """The stability margins of its first aircraft, as the begin of a remedy. ValueError where
        they have none."""
        simulator = self.simulator()
        rng = stream(self.seed, Branch.PILOT_RUN)
        margins = simulator.margins(simulator.sample(MARGIN_AIRCRAFT, rng))
        return f"the first {MARGIN_AIRCRAFT} aircraft have {self.margins.in_words(margins)}: "

    @property
    def most_at_once(self) -> int:
        """Rollouts that fit in memory together."""
        return max(1, min(LARGEST_CHUNK, CHUNK_STEPS // self.n_steps))

    @abstractmethod
    def simulator(self) -> ManeuverSimulator: ...

    def to_plain(self) -> dict[str, Any]:
        return to_plain(self)

    @property
    def n_steps(self) -> int:
        """Computed steps of a rollout, including its run-up."""
        run_up = self.imperfections.run_up(self.dt)
        return (run_up + self.maneuver.n_samples(self.dt)) * self.substeps

    def as_flown(self) -> Self:
        """The same test with the usual noise, jitter and imperfections of real flights."""
        return replace(
            self,
            maneuver=replace(
                self.maneuver,
                timing_jitter_s=USUAL_TIMING_JITTER_S,
                amplitude_jitter=USUAL_AMPLITUDE_JITTER,
            ),
            noise=self.usual_noise,
            imperfections=USUAL_IMPERFECTIONS,
        )

    def as_trained(self) -> Self:
        """The test as flown by pilots of different softness, to train a monitor for any of them."""
        flown = self.as_flown()
        soft = replace(flown.imperfections, softness_s=USUAL_SOFTNESS_S)
        return replace(flown, imperfections=soft)


@dataclass(frozen=True)
class DatasetRecipe(ManeuverTest):
    """The planned test of a linear aircraft and how much of it to simulate.

    The default is the usual test of an F-16 with yaw and roll damper: a rudder doublet that exceeds
    a limit on about a quarter of the aircraft.
    """

    aircraft: Aircraft = DEFAULT_AIRCRAFT
    maneuver: Maneuver = MANEUVERS["rudder_doublet"].with_peak(USUAL.doublet_deg)  # noqa: RUF009
    specification: Limits = Limits(Ny=USUAL.limit_g)  # noqa: RUF009
    max_rollouts: Annotated[int, Bounds(least=1)] = 1_000_000
    max_safe: Annotated[int, Bounds(least=1)] = 50_000
    control_law: ControlLaw = CONTROL_LAWS[USUAL.control_law]

    fewer: ClassVar[Mapping[str, Iterable[str]]] = {
        "maneuver": LATERAL_MANEUVERS,
        "maneuver.axis": SIGHTS,
        "maneuver.surface": [surface for surface, k in COLUMN.items() if k < LATERAL_SURFACES],
        "pilot.axis": SIGHTS,
    }

    def __post_init__(self) -> None:
        if self.maneuver.n_surfaces > LATERAL_SURFACES:
            raise ValueError(
                "the manoeuvre moves the elevator, which a linear lateral aircraft does not have: "
                "choose another manoeuvre, or a nonlinear aircraft"
            )
        super().__post_init__()

    def simulator(self) -> "LateralSimulator":
        return LateralSimulator(self)

    @property
    def dictionary(self) -> Dictionary:
        return LATERAL

    def _limits(self) -> Specification:
        return self.specification

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


class LateralSimulator(ManeuverSimulator):
    """The linear lateral plant: it can fly, stop, and be planned otherwise, from its recipe."""

    dictionary: Dictionary = LATERAL
    in_threads = True

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
        has_bank = len(self.plant.states) > PHI_STATE
        rolls: dict[Axis, Sight] = {"bank": Sight(FEEDBACK.index("p"), is_rate=True)}
        self.sights = SIGHTS if has_bank else SIGHTS | rolls
        self.crew = recipe.pilot.crew(recipe.maneuver, self.sights, self._respond)

    def _respond(self, axis: Axis, s: complex) -> complex:
        """Angle of an axis per command of its surface, of the nominal aircraft."""
        nominal, recipe, sight = self.plant.nominal_plant(), self.recipe, self.sights[axis]
        (loop,), drive = closed_loops(nominal, self.controller, recipe.control_law.actuator)
        moved = np.linalg.solve(s * np.eye(len(loop)) - loop, drive[:, COLUMN[MOVED_BY[axis]]])
        (rows,) = measured_rows(nominal)
        row = rows[sight.output]
        seen = row @ moved[: len(row)] / (1.0 + recipe.maneuver.pedal_lag_s * s)
        return complex(seen / s if sight.is_rate else seen)

    @property
    def test(self) -> DatasetRecipe:
        return self.recipe

    @property
    def limits(self) -> Envelope:
        return self.recipe.specification.envelope

    @property
    def parameters(self) -> Parameters:
        return self.plant.parameters

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        theta = self.plant.sample(n, rng)
        if self.spread != 1.0:
            theta = self.plant.nominal + self.spread * (theta - self.plant.nominal)
        return theta

    def plants(self, theta: Array) -> Plants:
        return self.plant.plants(theta)

    def margins(self, theta: Array) -> Margins:
        return stability_margins(
            self.plants(theta), self.controller, self.recipe.control_law.actuator
        )

    def outputs(self, drawn: Drawn) -> Array:
        recipe = self.recipe
        return roll_out(
            self.plants(drawn.theta),
            self.controller,
            recipe.control_law.actuator,
            drawn.commands,
            recipe.dt,
            pedal_lag_s=recipe.maneuver.pedal_lag_s,
            substeps=recipe.substeps,
            gust=drawn.gusts[0] if drawn.gusts else None,
            in_loop=drawn.in_loop,
            skip=drawn.unused,
        )


def needs_limits(test: ManeuverTest, what: str) -> None:
    """ValueError for a test with stability margins, where limits are needed."""
    if test.margins.label:
        raise ValueError(
            f"stability margins label rollouts of datasets, for monitors by forewarn train, the "
            f"form or POST /datasets, and {what} needs limits: give limits instead"
        )


@runtime_checkable
class Replans(Protocol):
    """A simulator of a planned manoeuvre that can be planned otherwise: other amplitudes, hands,
    noise or aircraft. Cards and identification need one."""

    recipe: DatasetRecipe
