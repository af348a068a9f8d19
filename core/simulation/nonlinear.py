"""Nonlinear aircraft in flight: the condition, trim, the linear model at trim, and rollouts.

Thrust is held at its trim value, along the body x axis: the models have no engine.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import acos, asin, ceil, cos, degrees, exp, inf, radians, tan
from typing import Annotated

import numpy as np

from core.bounds import Bounds, check_bounds
from core.kernels.compiled import in_chunks
from core.kernels.pilot import NOBODY, Pilots, memory_of
from core.kernels.six_dof import (
    LAW,
    N_TRIM,
    RANGES,
    FlightPoint,
    Loop,
    Times,
    bank_of,
    begin,
    follow,
    motion,
    outputs_of,
    roll_out,
    trim,
)
from core.simulation.atmosphere import HIGHEST, air_at
from core.simulation.control_law import Actuator, Controller
from core.simulation.nonlinear_aircraft import NonlinearAircraft
from core.simulation.published import STANDARD_GRAVITY
from core.simulation.uncertain_plant import Plants, UncertainPlant
from core.types import Array, Flags

CHUNK = 64
"""Rollouts that a thread flies at a time."""
LONGEST_STEP = 0.01
"""[s] Runge-Kutta step, and at most half the fastest time constant of actuators and law."""
NO_GUSTS = np.empty((0, 0, 2))
FIRST_GUESS = 0.05
"""Angle of attack from which trim is sought [rad]."""
LATERAL_STATES = ("beta", "p", "r", "phi")
SMALL = 1e-6
ALTITUDES = Bounds(least=0, below=HIGHEST, words="give 0 to 20,000 m")
MACHS = Bounds(above=0, below=1, words="the models hold below the speed of sound: give 0 to 1")
PATHS = Bounds(least=-30, below=30, words="give -30 to 30 deg")
"""Step of the finite differences of the linear model."""


class TrimError(ValueError):
    """No trim at a flight condition."""


@dataclass(frozen=True)
class TrimCondition:
    """Trimmed flight in the standard atmosphere: straight, or a turn without sideslip.

    The rate of a turn follows from its load factor: tan(bank) g / (V cos(path)), with
    cos(bank) = cos(path) / load factor; bank itself is that which holds the turn.
    """

    altitude_m: Annotated[float, ALTITUDES] = 4572.0
    """altitude: pressure altitude; 4572 m are 15,000 ft [m]."""
    mach: Annotated[float, MACHS] = 0.6
    """Mach number: sets the airspeed; the aerodynamics have no effects of Mach."""
    load_factor: Annotated[float, Bounds(least=1)] = 1.0
    """load factor: 1 for straight flight, more for a steady turn to the right [g]."""
    path_deg: Annotated[float, PATHS] = 0.0
    """flight path angle: climb is positive [deg]."""

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def point(self) -> FlightPoint:
        air, climb = air_at(self.altitude_m), radians(self.path_deg)
        airspeed = self.mach * air.sound
        straight = self.load_factor <= 1.0
        bank = 0.0 if straight else acos(cos(climb) / self.load_factor)
        turn = STANDARD_GRAVITY * tan(bank) / (airspeed * cos(climb))
        return FlightPoint(
            airspeed,
            climb,
            bank,
            turn,
            self.altitude_m,
            air.density,
            air.thinning,
            STANDARD_GRAVITY,
        )


def trimmed(
    aircraft: NonlinearAircraft, point: FlightPoint, theta: Array, position: float = inf
) -> Array:
    """Trim of theta (n, n_parameters): (n, 6) alpha, bank [rad], thrust per mass [m/s2], aileron,
    rudder and elevator [rad].

    position: limit of the surfaces [rad].
    TrimError if one has no trim within the ranges of its aerodynamics and surfaces.
    """
    body = aircraft.body
    begun = np.zeros((1, N_TRIM))
    begun[0, :2] = FIRST_GUESS, point.bank
    nominal = np.ascontiguousarray(aircraft.nominal[np.newaxis])
    lost = trim(body, nominal, point, begun, 0, 1) >= 0
    if lost or _beyond(begun, body.model, position).any():
        raise TrimError(f"the nominal aircraft has no trim {_where(point)}")
    out = np.repeat(begun, len(theta), axis=0)

    def solve(first: int, last: int) -> None:
        failed = trim(body, theta, point, out, first, last)
        bad = np.flatnonzero(_beyond(out[first:last], body.model, position)) + first
        if failed >= 0 or len(bad):
            k = failed if failed >= 0 else int(bad[0])
            far = np.abs(theta[k] - aircraft.nominal) / (np.abs(aircraft.nominal) + 1e-9)
            name, value = aircraft.names[far.argmax()], theta[k, far.argmax()]
            raise TrimError(
                f"an aircraft with {name}={value:.4g} has no trim {_where(point)}, or give the "
                "parameters smaller spreads"
            )

    in_chunks(len(theta), CHUNK, solve)
    return out


def _beyond(trims: Array, model: int, position: float) -> Flags:
    """(n,) whether alpha is beyond the model's range, or surfaces beyond their limit [rad]."""
    low, high, _ = RANGES[model]
    alpha, surfaces = trims[:, 0], np.abs(trims[:, 3:]).max(axis=1)
    return (alpha < low) | (alpha > high) | (surfaces > position)


def _where(point: FlightPoint) -> str:
    return (
        f"at {point.altitude:g} m, {point.airspeed:.4g} m/s, bank {degrees(point.bank):.3g} deg "
        f"and a path of {degrees(point.climb):.3g} deg: give a lower altitude or load factor, or a "
        "higher Mach number"
    )


def linear_lateral(aircraft: NonlinearAircraft, point: FlightPoint) -> UncertainPlant:
    """The nominal aircraft's lateral motion at trim, without uncertainty, for control laws.

    States beta, p, r, phi; outputs as those of linear aircraft. Central differences.
    """
    fixed, none = lateral_plants(aircraft, point, aircraft.nominal[np.newaxis]), np.empty(0)
    return UncertainPlant(LATERAL_STATES, (), none, none, "normal", fixed, ())


def lateral_plants(aircraft: NonlinearAircraft, point: FlightPoint, theta: Array) -> Plants:
    """Lateral motion of theta (n, n_parameters), each linearised at its own trim. TrimError."""
    jacobian = np.empty((len(theta), 5, 6))
    for k, at in enumerate(trimmed(aircraft, point, theta)):
        rates = _lateral_rates(aircraft, point, np.ascontiguousarray(theta[k]), at)
        for column in range(6):
            step = np.zeros(6)
            step[column] = SMALL
            jacobian[k, :, column] = (rates(step) - rates(-step)) / (2 * SMALL)
    c, d = np.zeros((len(theta), 6, 4)), np.zeros((len(theta), 6, 2))
    c[:, :3, :3], d[:, 4:] = np.eye(3), np.eye(2)
    c[:, 3], d[:, 3] = jacobian[:, 4, :4], jacobian[:, 4, 4:]
    parts = jacobian[:, :4, :4], jacobian[:, :4, 4:], c, d
    return Plants(*map(np.ascontiguousarray, parts))


def _lateral_rates(
    aircraft: NonlinearAircraft, point: FlightPoint, k: Array, at: Array
) -> Callable[[Array], Array]:
    """Function from changes of beta, p, r, phi, aileron, rudder to the rates of the first four, and
    N_y.   k: (n_parameters,) of the aircraft.   at: its trim."""
    x0, change = np.empty(LAW), np.empty(LAW)
    begin(point, at, x0)
    body, speed = aircraft.body, point.airspeed

    def rates(step: Array) -> Array:
        x = x0.copy()
        beta = asin(x[1] / speed) + step[0]
        level = speed * cos(beta) / np.hypot(x[0], x[2])
        x[0], x[1], x[2] = level * x[0], speed * np.sin(beta), level * x[2]
        x[3] += step[1]
        x[5] += step[2]
        half = np.array([np.cos(step[3] / 2), np.sin(step[3] / 2)])
        q = x[6:10].copy()  # rolled about the body's x axis
        x[6] = q[0] * half[0] - q[1] * half[1]
        x[7] = q[0] * half[1] + q[1] * half[0]
        x[8] = q[2] * half[0] + q[3] * half[1]
        x[9] = q[3] * half[0] - q[2] * half[1]
        x[11:13] += step[4:]
        _, _, ay, _, _ = motion(body, k, point, at[2], x, 0.0, 0.0, change)
        along = (x[0] * change[0] + x[1] * change[1] + x[2] * change[2]) / speed
        beta_rate = (change[1] - x[1] / speed * along) / (speed * cos(beta))
        pitch = np.arcsin(2 * (x[6] * x[8] - x[7] * x[9]))
        bank = bank_of(x)
        bank_rate = x[3] + np.tan(pitch) * (x[4] * np.sin(bank) + x[5] * np.cos(bank))
        return np.array([beta_rate, change[3], change[5], bank_rate, ay / point.gravity])

    return rates


@dataclass(frozen=True)
class PitchLaw:
    """Feedback to the elevator: delta_e = pilot + k_alpha (alpha - trim) + k_q q.

    Positive gains stabilise, because positive elevator is nose down. The default damps the F-16's
    pitch; it is assumed, not published.
    """

    k_alpha: float = 0.0
    """gain of the angle of attack: elevator per alpha."""
    k_q: float = 0.25
    """gain of the pitch rate: elevator per pitch rate [s]."""


def loop_of(controller: Controller, actuator: Actuator, pitch_law: PitchLaw) -> Loop:
    limits = actuator.rate_limit_deg_s, actuator.position_limit_deg
    rate, position = (inf if limit is None else radians(limit) for limit in limits)
    a, b, c, d = (np.ascontiguousarray(each, dtype=np.float64) for each in controller)
    gains = pitch_law.k_alpha, pitch_law.k_q
    return Loop(a, b, c, d, *gains, actuator.bandwidth_rad_s, rate, position)


def linear_loop(
    aircraft: NonlinearAircraft, point: FlightPoint, loop: Loop
) -> tuple[Array, Array, Array]:
    """A (n, n), B (n, 3) and C (13, n) of the nominal aircraft at trim, in closed loop.

    States as in `six_dof`, inputs the pilot's aileron, rudder and elevator. Central differences.
    """
    z = trimmed(aircraft, point, aircraft.nominal[np.newaxis])[0]
    body, k, n = aircraft.body, np.ascontiguousarray(aircraft.nominal), LAW + len(loop.a)
    x0, change, still = np.empty(n), np.zeros(n), np.zeros(3)
    begin(point, z, x0)
    _, _, side, _, _ = motion(body, k, point, z[2], x0, 0.0, 0.0, change)

    def rates(x: Array, commands: Array) -> Array:
        out = np.zeros(n + 13)
        outputs_of(body, k, point, z[2], x, still, change, out[n:])
        alpha, beta, ay, _, _ = motion(body, k, point, z[2], x, 0.0, 0.0, out[:n])
        read = np.array(
            [beta, *(x - x0)[[3, 5]], ay - side, *(x - x0)[[11, 12]], bank_of(x) - z[1]]
        )
        read[3] /= point.gravity
        follow(loop, x, read, z, x[4] - x0[4], alpha, commands, still, out[:n])
        return out

    jacobian = np.empty((n + 13, n + 3))
    for column, step in enumerate(SMALL * np.eye(n + 3)):
        up, down = (rates(x0 + s * step[:n], s * step[n:]) for s in (1.0, -1.0))
        jacobian[:, column] = (up - down) / (2 * SMALL)
    return jacobian[:n, :n], jacobian[:n, n:], jacobian[n:, :n]


def fly(
    aircraft: NonlinearAircraft,
    point: FlightPoint,
    theta: Array,
    pilot: Array,
    dt: float,
    *,
    controller: Controller,
    actuator: Actuator,
    pitch_law: PitchLaw,
    pedal_lag_s: float = 0.0,
    substeps: int = 1,
    gust: Array | None = None,
    in_loop: Pilots = NOBODY,
    n_outputs: int = 13,
) -> tuple[Array, Array]:
    """Trim and fly aircraft theta (n, n_parameters).

    pilot: (1 or n, n_samples, 3) [rad] aileron, rudder and elevator from trim, each held for dt.
    gust: (n, n_out, 2) alpha and beta of the air [rad].   in_loop: who changes the commands by the
    outputs from trim; its `gave_up` is written.   n_outputs: 13 or 14, see `six_dof.N_OUTPUTS`.
    Returns outputs (n, (n_samples - 1) substeps + 1, n_outputs), and trim, see `trimmed`.
    """
    theta, pilot = np.ascontiguousarray(theta), np.ascontiguousarray(pilot)
    loop = loop_of(controller, actuator, pitch_law)
    trims = trimmed(aircraft, point, theta, loop.position)
    law_poles = np.abs(np.linalg.eigvals(controller.a)) if len(controller.a) else np.zeros(1)
    step, longest = dt / substeps, 0.5 / max(actuator.bandwidth_rad_s, law_poles.max())
    parts = ceil(step / min(LONGEST_STEP, longest) - 1e-9)
    half_fade = exp(-0.5 * step / parts / pedal_lag_s) if pedal_lag_s > 0.0 else 0.0
    times = Times(step, substeps, parts, half_fade)
    gust = NO_GUSTS if gust is None else np.ascontiguousarray(gust)
    out = np.empty((len(theta), (pilot.shape[1] - 1) * substeps + 1, n_outputs))
    about = aircraft.body, theta, point, trims, loop, pilot, times, gust, in_loop

    def simulate(first: int, last: int) -> None:
        roll_out(*about, np.empty(memory_of(in_loop)), np.empty(3), out, first, last)

    in_chunks(len(theta), CHUNK, simulate)
    return out, trims
