"""The planned test of a nonlinear aircraft in six degrees of freedom."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, radians
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from core.bounds import NOT_NEGATIVE
from core.channels import SIX_DOF, Dictionary
from core.computed import complete
from core.limits.flight_limits import QBAR, LoadLimits
from core.limits.limits import Envelope, IntervalLimits, Specification
from core.planned_test.maneuver_simulator import Drawn, ManeuverSimulator
from core.planned_test.planned_test import (
    CHUNK_STEPS,
    LARGEST_CHUNK,
    USUAL_NOISE,
    ManeuverTest,
    SensorNoise,
)
from core.simulation.control_law import Actuator, ControlLaw, RateDamper, check_usable
from core.simulation.flight_process import ModelSimulator
from core.simulation.imperfections import counts_from_trim
from core.simulation.jsbsim import JsbsimAircraft, usual_condition
from core.simulation.maneuver import (
    ALL_SURFACES,
    COLUMN,
    MANEUVERS,
    MOVED_BY,
    Axis,
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
from core.simulation.pilot import CHANNEL_OF, OpenLoop, Sight
from core.simulation.python_simulator import OwnCodeError
from core.simulation.simulator import Parameters, Rollouts
from core.simulation.stability_margins import Margins, stability_margins
from core.types import Array

NotNegative = Annotated[float, NOT_NEGATIVE]
SIGHTS: dict[Axis, Sight] = {
    axis: Sight(SIX_DOF.index("r"), is_rate=True)
    if axis == "heading"
    else Sight(SIX_DOF.index(key))
    for axis, key in CHANNEL_OF.items()
}
"""Motions of a nonlinear aircraft that a pilot sees."""
F16_ACTUATOR = Actuator(20.2, rate_limit_deg_s=60.0, position_limit_deg=25.0)
"""The F-16's elevator actuator (Stevens, Lewis and Johnson, Aircraft Control and Simulation, 3rd
ed., appendix A), used for all surfaces."""


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
"""Same as for lateral tests; attitude, airspeed and dynamic pressure are assumed."""


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


@dataclass(frozen=True)
class SixDofTest(ManeuverTest, ABC):
    """A planned test in six degrees of freedom, trimmed at a flight condition."""

    specification: LoadLimits
    noise: SixDofNoise = SixDofNoise()
    condition: TrimCondition = TrimCondition()  # noqa: RUF009
    """flight condition: trim before the manoeuvre."""

    usual_noise: ClassVar[SensorNoise] = USUAL_SIX_DOF_NOISE
    turn: ClassVar[float] = 2.0
    """Load factor of the turn from which a wind-up turn is flown first."""

    def usual_limits(self) -> LoadLimits:
        """Limits of a first test of its manoeuvre."""
        surface: Surface = "rudder"
        if isinstance(self.maneuver, OneSurface):
            surface = self.maneuver.surface
        elif self.maneuver.captured:
            surface = MOVED_BY[self.maneuver.captured]
        return USUAL_LIMITS.get(type(self.maneuver), USUAL_LIMIT_OF[surface])

    def with_usual(self, limits: bool = True, load_factor: bool = True) -> Self:
        """The same with the limits and the load factor of a first test of its manoeuvre."""
        condition, specification = self.condition, self.specification
        if limits:
            specification = self.usual_limits()
        if load_factor and isinstance(self.maneuver, WindUpTurn):
            condition = replace(condition, load_factor=self.turn)
        return replace(self, condition=condition, specification=specification)

    @abstractmethod
    def simulator(self) -> "SixDofSimulator": ...

    @property
    def dictionary(self) -> Dictionary:
        return self.specification.dictionary

    def _limits(self) -> Specification:
        return self._limits_in_trim

    @cached_property
    def _limits_in_trim(self) -> Specification:
        return self.simulator().specification


@dataclass(frozen=True)
class NonlinearTest(SixDofTest):
    """The planned test of a nonlinear aircraft and how much of it to simulate.

    Trimmed at a flight condition, with thrust held there. The default is a pitch doublet of an
    F-16. Gusts act on angle of attack and sideslip alike.
    """

    aircraft: NonlinearAircraft = NONLINEAR_AIRCRAFT["f16_polynomial"]
    maneuver: Maneuver = MANEUVERS["pitch_doublet"]
    specification: LoadLimits = LoadLimits(Nz_high=2.25)  # noqa: RUF009
    control_law: ControlLaw = RateDamper(actuator=F16_ACTUATOR)  # noqa: RUF009
    pitch_law: PitchLaw = PitchLaw()  # noqa: RUF009
    """pitch law: feedback to the elevator."""

    sights: ClassVar[Mapping[Axis, Sight]] = SIGHTS

    def simulator(self) -> "NonlinearSimulator":
        return NonlinearSimulator(self)

    @property
    def most_at_once(self) -> int:
        return max(1, min(LARGEST_CHUNK, CHUNK_STEPS // (2 * self.n_steps)))


@dataclass(frozen=True)
class JsbsimTest(SixDofTest):
    """The planned test of an aircraft of JSBSim and how much of it to simulate.

    Its own flight controls move the surfaces: commands in degrees are shares of a full stick.
    No pilot is in the loop. The default is a pitch doublet of a Cessna 172; gusts act on angle of
    attack and sideslip alike.
    """

    aircraft: JsbsimAircraft = JsbsimAircraft()  # noqa: RUF009
    maneuver: Maneuver = MANEUVERS["pitch_doublet"].with_peak(-6.4)  # noqa: RUF009
    specification: LoadLimits = LoadLimits(Nz_high=2.0)  # noqa: RUF009
    condition: TrimCondition = TrimCondition(altitude_m=1500.0, mach=0.165)  # noqa: RUF009

    fewer: ClassVar[Mapping[str, Iterable[str]]] = {
        "maneuver": [name for name, each in MANEUVERS.items() if each.captured is None],
        "pilot": ["open_loop"],
        "margins": [],
    }
    turn: ClassVar[float] = 1.4

    @classmethod
    def of(cls, model: str) -> Self:
        """The default test of an aircraft of JSBSim, at the condition that suits it."""
        altitude_m, mach = usual_condition(model)
        condition = TrimCondition(altitude_m=altitude_m, mach=mach)
        return cls(aircraft=JsbsimAircraft(model), condition=condition)

    @property
    def most_at_once(self) -> int:
        """Few, so that a job shows its progress: each takes some 10 ms."""
        return 64

    def __post_init__(self) -> None:
        if self.maneuver.captured or self.pilot != OpenLoop():
            raise ValueError(
                "no pilot can be in the loop of an aircraft of JSBSim: choose the pilot open_loop, "
                "and a manoeuvre that captures no target"
            )
        if self.margins.label:
            raise ValueError(
                "stability margins need a closed loop that is known here, and JSBSim's aircraft "
                "have their own flight controls: choose a linear or nonlinear aircraft"
            )
        super().__post_init__()

    def usual_limits(self) -> LoadLimits:
        pulls = self.maneuver.n_surfaces == ALL_SURFACES
        return LoadLimits(Nz_high=2.0) if pulls else LoadLimits(beta_deg=5.0)

    def simulator(self) -> "JsbsimSimulator":
        return JsbsimSimulator(self)


class SixDofSimulator(ManeuverSimulator):
    """Flights in six degrees of freedom: it can fly given aircraft, and stop."""

    planned: Any
    specification: IntervalLimits
    n_gusts = 2

    def __init__(self, planned: SixDofTest) -> None:
        """ValueError if the nominal aircraft has no trim, is unstable, or exceeds a limit there."""
        self.planned = planned
        self.dictionary = planned.specification.dictionary
        self.point = planned.condition.point
        self.gust = planned.imperfections.gust(planned.condition.altitude_m, self.point.airspeed)
        self._prepare()
        self.specification = planned.specification.of_trim(self._trim_values())

    @abstractmethod
    def _prepare(self) -> None:
        """Set what `outputs` uses. ValueError."""

    def _trim_values(self) -> dict[str, float]:
        """Outputs of the nominal aircraft in trim, by channel; from trim where they count so."""
        nominal = self.parameters.nominal[np.newaxis]
        still = Drawn(nominal, np.zeros((1, 1, ALL_SURFACES)), np.zeros(1, np.int64), ())
        values = complete(self.dictionary, self.outputs(still), self.dt)[0, 0]
        return dict(zip(self.dictionary.keys, values.tolist(), strict=True))

    @property
    def test(self) -> SixDofTest:
        return self.planned

    @property
    def limits(self) -> Envelope:
        return self.specification.envelope

    @property
    def parameters(self) -> Parameters:
        return self.test.aircraft.parameters

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        return self.parameters.sample(n, rng)

    def outputs(self, drawn: Drawn) -> Array:
        commands = drawn.commands
        if commands.shape[2] < ALL_SURFACES:
            commands = np.pad(commands, ((0, 0), (0, 0), (0, ALL_SURFACES - commands.shape[2])))
        gust = np.stack(drawn.gusts, axis=-1) if drawn.gusts else None
        y = self._true_outputs(drawn, commands, gust)
        y -= np.where(counts_from_trim(self.dictionary), y[:, :1], 0.0)
        return y

    @abstractmethod
    def _true_outputs(self, drawn: Drawn, commands: Array, gust: Array | None) -> Array:
        """Outputs (n, n_steps, n_measured), absolute.

        commands: (1 or n, n_samples, 3) [rad].   gust: (n, n_steps, 2) of alpha and beta [rad].
        """


class NonlinearSimulator(SixDofSimulator):
    """A nonlinear aircraft, whose equations are compiled here."""

    planned: NonlinearTest

    def __init__(self, planned: NonlinearTest) -> None:
        super().__init__(planned)
        self.crew = planned.pilot.crew(planned.maneuver, SIGHTS, self._respond)

    def _prepare(self) -> None:
        planned = self.planned
        plant = linear_lateral(planned.aircraft, self.point)
        self.controller = planned.control_law.controller(plant)
        duration = planned.maneuver.duration_s
        check_usable(plant, self.controller, planned.control_law.actuator, duration)

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

    def margins(self, theta: Array) -> Margins:
        plants = lateral_plants(self.planned.aircraft, self.point, theta)
        return stability_margins(plants, self.controller, self.planned.control_law.actuator)

    def _true_outputs(self, drawn: Drawn, commands: Array, gust: Array | None) -> Array:
        planned = self.planned
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
            gust=gust,
            in_loop=drawn.in_loop,
            n_outputs=len(self.dictionary.measured),
        )
        return y


class JsbsimSimulator(SixDofSimulator):
    """An aircraft of JSBSim in processes of its own, with new draws for those without trim."""

    planned: JsbsimTest

    def _prepare(self) -> None:
        planned, point, dictionary = self.planned, self.point, self.dictionary
        names, nominal, spread, _ = self.parameters
        step = planned.dt / planned.substeps
        self._own = ModelSimulator(
            planned.aircraft.in_flight(point, step, dictionary.measured),
            f"{planned.aircraft.model} of JSBSim",
            channels=dictionary,
            dt=step,
            parameters=dict(zip(names, zip(nominal, spread, strict=True), strict=True)),
            inputs=np.zeros(1),
        )

    def margins(self, theta: Array) -> Margins:
        raise ValueError("the closed loop of JSBSim's aircraft is not known here: give limits")

    def fly(
        self, theta: Array, rng: np.random.Generator, scale: Array | None = None
    ) -> tuple[Rollouts, Array]:
        """ValueError also for an aircraft without trim."""
        rollouts, peaks = super().fly(theta.copy(), rng, scale)
        if n := int((rollouts.theta != theta).any(axis=1).sum()):
            raise OwnCodeError(
                f"{n} of {len(theta)} aircraft have no trim: choose some nearer to the nominal one"
            )
        return rollouts, peaks

    def _true_outputs(self, drawn: Drawn, commands: Array, gust: Array | None) -> Array:
        """Writes theta of those drawn again."""
        planned, n = self.planned, len(drawn.theta)
        n_steps = (commands.shape[1] - 1) * planned.substeps + 1
        inputs = np.zeros((n, n_steps, ALL_SURFACES + self.n_gusts))
        lag, before = planned.maneuver.pedal_lag_s, np.zeros((len(commands), ALL_SURFACES))
        fade = exp(-planned.dt / lag) if lag else 0.0
        lasting = (1.0 - fade) * lag / planned.dt
        for k, command in enumerate(commands.swapaxes(0, 1)):  # its mean while it is held
            steps = slice(k * planned.substeps, (k + 1) * planned.substeps)
            held = command + lasting * (before - command)
            inputs[:, steps, :ALL_SURFACES] = held[:, np.newaxis]
            before = command + fade * (before - command)
        if gust is not None:
            inputs[..., ALL_SURFACES:] = gust
        y, drawn.theta[:], _ = self._own.drawn_again(drawn.theta, list(inputs))
        return y
