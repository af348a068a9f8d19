"""The planned test of a nonlinear aircraft in six degrees of freedom."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import radians
from typing import Annotated, Any, ClassVar

import numpy as np

from core.bounds import NOT_NEGATIVE, Bounds, check_bounds
from core.channels import SIX_DOF
from core.computed import complete
from core.limits.flight_limits import QBAR, LoadLimits
from core.limits.limits import Envelope, Specification
from core.monitor.group import GROUPINGS, Grouping
from core.planned_test.maneuver_simulator import (
    Drawn,
    ManeuverSimulator,
    by_hand,
    check_observations,
    check_steps,
    n_steps,
)
from core.planned_test.planned_test import (
    CHUNK_STEPS,
    LARGEST_CHUNK,
    USUAL_NOISE,
    USUAL_SOFTNESS_S,
    SensorNoise,
)
from core.recipe import later, to_plain
from core.simulation.control_law import Actuator, ControlLaw, RateDamper, check_usable
from core.simulation.imperfections import (
    USUAL_IMPERFECTIONS,
    Imperfections,
    counts_from_trim,
)
from core.simulation.maneuver import (
    ALL_SURFACES,
    COLUMN,
    MANEUVERS,
    MOVED_BY,
    Axis,
    Capture,
    Maneuver,
    OneSurface,
    PushOverPullUp,
    RollingPullOut,
    SteadyHeadingSideslip,
    Surface,
    Table,
    WindUpTurn,
)
from core.simulation.nonlinear import (
    PitchLaw,
    TrimCondition,
    fly,
    lateral_plants,
    linear_lateral,
    linear_loop,
    loop_of,
)
from core.simulation.nonlinear_aircraft import NONLINEAR_AIRCRAFT, NonlinearAircraft
from core.simulation.pilot import CHANNEL_OF, OpenLoop, Pilot, Sight
from core.simulation.simulator import Parameters
from core.simulation.uncertain_plant import Plants
from core.types import Array

NotNegative = Annotated[float, NOT_NEGATIVE]
SIGHTS: dict[Axis, Sight] = {axis: Sight(SIX_DOF.index(key)) for axis, key in CHANNEL_OF.items()}
"""What a pilot sees of a nonlinear aircraft."""
F16_ACTUATOR = Actuator(20.2, rate_limit_deg_s=60.0, position_limit_deg=25.0)
"""Of the F-16's elevator (Stevens, Lewis and Johnson, Aircraft Control and Simulation, 3rd ed.,
appendix A), here of all surfaces."""


@dataclass(frozen=True)
class SixDofNoise(SensorNoise):
    """White Gaussian sensor noise, 1 sigma of each channel in its SI unit, not fed back."""

    keys: ClassVar[tuple[str, ...]] = (*SIX_DOF.keys, QBAR.key)
    alpha: NotNegative = 0.0
    """angle of attack [rad]."""
    q: NotNegative = 0.0
    """pitch rate [rad/s]."""
    theta: NotNegative = 0.0
    """pitch angle [rad]."""
    Nz: NotNegative = 0.0
    """normal acceleration [g]."""
    phi: NotNegative = 0.0
    """bank angle [rad]."""
    V: NotNegative = 0.0
    """true airspeed [m/s]."""
    delta_e: NotNegative = 0.0
    """elevator [rad]."""
    qbar: NotNegative = 0.0
    """dynamic pressure [Pa]."""


USUAL_SIX_DOF_NOISE = SixDofNoise(
    **vars(USUAL_NOISE),
    alpha=USUAL_NOISE.beta,
    q=USUAL_NOISE.p,
    theta=radians(0.1),
    Nz=USUAL_NOISE.Ny,
    phi=radians(0.1),
    V=0.3,
    delta_e=USUAL_NOISE.delta_a,
    qbar=30.0,
)
"""As for lateral tests; attitude, airspeed and dynamic pressure assumed."""


USUAL_LIMITS: dict[type[Maneuver], LoadLimits] = {
    WindUpTurn: LoadLimits(alpha_high_deg=17.5),
    PushOverPullUp: LoadLimits(Nz_low=-0.7, Nz_high=2.6),
    RollingPullOut: LoadLimits(wing_bending=250e3),
    SteadyHeadingSideslip: LoadLimits(fin_load=6500.0),
    Table: LoadLimits(fin_load=2900.0),
}
"""Limits of a first test, which at the default amplitude about a quarter of the F-16s exceed."""
USUAL_LIMIT_OF: dict[Surface, LoadLimits] = {
    "elevator": LoadLimits(Nz_high=2.25),
    "rudder": LoadLimits(fin_load=5000.0),
    "aileron": LoadLimits(wing_bending=74e3),
}
"""The same for manoeuvres of one control."""
TURN = 2.0
"""Load factor of the turn from which a wind-up turn is flown first."""


@dataclass(frozen=True)
class NonlinearTest:
    """The planned test of a nonlinear aircraft and how much of it to simulate.

    Trimmed at a flight condition, with thrust held there. The default is a pitch doublet of an
    F-16.
    """

    aircraft: NonlinearAircraft = NONLINEAR_AIRCRAFT["f16_polynomial"]
    condition: TrimCondition = TrimCondition()  # noqa: RUF009
    """flight condition: trim before the manoeuvre."""
    control_law: ControlLaw = RateDamper(actuator=F16_ACTUATOR)  # noqa: RUF009
    pitch_law: PitchLaw = PitchLaw()  # noqa: RUF009
    """pitch law: feedback to the elevator."""
    maneuver: Maneuver = MANEUVERS["pitch_doublet"]
    specification: LoadLimits = LoadLimits(Nz_high=2.25)  # noqa: RUF009
    noise: SixDofNoise = SixDofNoise()
    """sensor noise: white and Gaussian, 1 sigma of each channel."""
    imperfections: Imperfections = Imperfections()  # noqa: RUF009
    """imperfections of a real flight: effects besides noise and jitter, drawn for each rollout;
    gusts act on angle of attack and sideslip alike."""
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

    for_more: ClassVar[str] = "raise the amplitude, lower the limit"
    for_fewer: ClassVar[str] = "lower the amplitude, raise the limit"

    def __post_init__(self) -> None:
        check_bounds(self)
        self.pilot.check(self.maneuver, SIGHTS)
        check_steps(self)
        check_observations(self)

    def with_usual(self, limits: bool = True, load_factor: bool = True) -> "NonlinearTest":
        """The same with the limits and the load factor of a first test of its manoeuvre."""
        maneuver, condition, specification = self.maneuver, self.condition, self.specification
        if limits:
            surface: Surface = "rudder"
            if isinstance(maneuver, OneSurface):
                surface = maneuver.surface
            elif isinstance(maneuver, Capture):
                surface = MOVED_BY[maneuver.axis]
            specification = USUAL_LIMITS.get(type(maneuver), USUAL_LIMIT_OF[surface])
        if load_factor and isinstance(maneuver, WindUpTurn):
            condition = replace(condition, load_factor=TURN)
        return replace(self, condition=condition, specification=specification)

    def simulator(self) -> "NonlinearSimulator":
        return NonlinearSimulator(self)

    def to_plain(self) -> dict[str, Any]:
        return to_plain(self)

    @cached_property
    def judged_by(self) -> Specification:
        return self.pilot.label or self.simulator().specification

    @property
    def n_steps(self) -> int:
        return n_steps(self)

    @property
    def most_at_once(self) -> int:
        """Rollouts that fit in memory together."""
        return max(1, min(LARGEST_CHUNK, CHUNK_STEPS // (2 * self.n_steps)))

    def as_flown(self) -> "NonlinearTest":
        """The same test with the usual noise, jitter and imperfections of real flights."""
        return replace(
            self,
            maneuver=by_hand(self.maneuver),
            noise=USUAL_SIX_DOF_NOISE,
            imperfections=USUAL_IMPERFECTIONS,
        )

    def as_trained(self) -> "NonlinearTest":
        """The test as flown by pilots of different softness, to train a monitor for any of them."""
        flown = self.as_flown()
        soft = replace(flown.imperfections, softness_s=USUAL_SOFTNESS_S)
        return replace(flown, imperfections=soft)


class NonlinearSimulator(ManeuverSimulator):
    """A nonlinear aircraft: it can fly given aircraft, and stop."""

    n_gusts = 2

    def __init__(self, planned: NonlinearTest) -> None:
        """ValueError if the nominal aircraft has no trim, is unstable, or exceeds a limit there."""
        self.planned = planned
        self.dictionary = planned.specification.dictionary
        self.point = planned.condition.point
        self.gust = planned.imperfections.gust(planned.condition.altitude_m, self.point.airspeed)
        plant = linear_lateral(planned.aircraft, self.point)
        self.controller = planned.control_law.controller(plant)
        duration = planned.maneuver.duration_s
        check_usable(plant, self.controller, planned.control_law.actuator, duration)
        self.specification = planned.specification.of_trim(self._trim_values())
        self.crew = planned.pilot.crew(planned.maneuver, SIGHTS, self._respond)

    def _trim_values(self) -> dict[str, float]:
        """Outputs of the nominal aircraft in trim, by channel; from trim where they count so."""
        nominal = self.planned.aircraft.nominal[np.newaxis]
        still = Drawn(nominal, np.zeros((1, 1, ALL_SURFACES)), np.zeros(1, np.int64), ())
        values = complete(self.dictionary, self.outputs(still), self.dt)[0, 0]
        return dict(zip(self.dictionary.keys, values.tolist(), strict=True))

    @cached_property
    def _linear(self) -> tuple[Array, Array, Array]:
        planned = self.planned
        loop = loop_of(self.controller, planned.control_law.actuator, planned.pitch_law)
        return linear_loop(planned.aircraft, self.point, loop)

    def _respond(self, axis: Axis, s: complex) -> complex:
        """Angle of an axis per command of its surface, of the nominal aircraft."""
        a, b, c = self._linear
        moved = np.linalg.solve(s * np.eye(len(a)) - a, b[:, COLUMN[MOVED_BY[axis]]])
        seen = c[SIGHTS[axis].output] @ moved
        return complex(seen / (1.0 + self.planned.maneuver.pedal_lag_s * s))

    @property
    def test(self) -> NonlinearTest:
        return self.planned

    @property
    def limits(self) -> Envelope:
        return self.specification.envelope

    @property
    def parameters(self) -> Parameters:
        return self.planned.aircraft.parameters

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        return self.parameters.sample(n, rng)

    def plants(self, theta: Array) -> Plants:
        return lateral_plants(self.planned.aircraft, self.point, theta)

    def outputs(self, drawn: Drawn) -> Array:
        planned, commands = self.planned, drawn.commands
        if commands.shape[2] < ALL_SURFACES:
            commands = np.pad(commands, ((0, 0), (0, 0), (0, ALL_SURFACES - commands.shape[2])))
        y, _ = fly(
            planned.aircraft,
            self.point,
            drawn.theta,
            commands,
            planned.dt,
            controller=self.controller,
            actuator=planned.control_law.actuator,
            pitch_law=planned.pitch_law,
            pedal_lag_s=planned.maneuver.pedal_lag_s,
            substeps=planned.substeps,
            gust=np.stack(drawn.gusts, axis=-1) if drawn.gusts else None,
            in_loop=drawn.in_loop,
            n_outputs=len(self.dictionary.measured),
        )
        y -= np.where(counts_from_trim(self.dictionary), y[:, :1], 0.0)
        return y
