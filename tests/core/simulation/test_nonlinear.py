"""Nonlinear aircraft: published check points, mechanics, trim, and the linear model at trim."""

from dataclasses import replace
from math import inf, radians

import numpy as np
import pytest

from core.kernels.pilot import NOBODY
from core.kernels.six_dof import (
    ALTITUDE,
    LAW,
    Loop,
    Times,
    begin,
    f16_polynomial,
    generic_stability_axes,
    motion,
    roll_out,
)
from core.simulation.atmosphere import air_at
from core.simulation.control_law import NoFeedback, RateDamper
from core.simulation.nonlinear import (
    PitchLaw,
    TrimCondition,
    TrimError,
    fly,
    linear_lateral,
    trimmed,
)
from core.simulation.nonlinear_aircraft import NONLINEAR_AIRCRAFT, GenericAircraft
from core.simulation.published import FOOT
from core.types import Array

F16, GGAM_F16, A7 = (NONLINEAR_AIRCRAFT[name] for name in NONLINEAR_AIRCRAFT)
SEA_LEVEL = TrimCondition(0.0, 0.45).point._replace(airspeed=502 * FOOT)
NO_LAW = NoFeedback().controller(linear_lateral(F16, SEA_LEVEL))


def at_gravity(aircraft, chords: float):
    return replace(aircraft, airframe=replace(aircraft.airframe, centre_of_gravity=chords))


def check_rates(chord_ft: float, span_ft: float) -> tuple[float, float, float]:
    """p, q, r of 0.3, 0.1 and -0.2 rad/s at 500 ft/s, made dimensionless."""
    return 0.3 * span_ft / 1000, 0.1 * chord_ft / 1000, -0.2 * span_ft / 1000


# Evaluated by an independent script at alpha 0.1, beta 0.05, elevator -0.04, aileron 0.05 and
# rudder 0.06 rad.
@pytest.mark.parametrize(
    ("aircraft", "chord", "span", "published"),
    [
        (GGAM_F16, 11.32, 30.0,
         (0.052899131, -0.051408, 0.510859498, -0.013673, -0.039816223, 0.008751375)),
        (A7, 10.8, 38.7,
         (0.0298884, -0.03327836, 0.3249621, -0.01318387, -0.070788206, 0.001089285)),
    ],
)  # fmt: skip
def test_the_generic_model_gives_the_coefficients_of_its_check_point(
    aircraft, chord, span, published
):
    rates = check_rates(chord, span)
    given = generic_stability_axes(aircraft.nominal, 0.1, 0.05, *rates, 0.05, 0.06, -0.04)
    np.testing.assert_allclose(given, published, atol=6e-10)


def test_the_polynomials_give_the_coefficients_of_their_check_point():
    x, y, z, roll, pitch, yaw = f16_polynomial(
        np.ones(23), 0.1, 0.05, *check_rates(11.32, 30.0), 0.05, 0.06, -0.04
    )
    offset = 0.05
    given = x, y, z, roll, pitch + offset * z, yaw - offset * y * 11.32 / 30
    published = (0.010082043, -0.049346687, -0.538178961, -0.017814232, -0.024687103, 0.011046124)
    np.testing.assert_allclose(given, published, atol=6e-10)


# alpha [deg], then L_beta, N_beta, L_p, N_p, N_r, L_da, N_da, N_dr at sea level, 502 ft/s, from an
# independent script, and one unit of the last digit of each
@pytest.mark.parametrize(
    ("aircraft", "published"),
    [
        (at_gravity(F16, 0.35), (1.45, -32.9, 12.3, -3.52, -0.031, -0.467, -41.9, -2.03, -3.37)),
        (at_gravity(F16, 0.30), (1.57, -33.2, 13.2, -3.52, -0.030, -0.487, -42.0, -2.07, -3.50)),
        (at_gravity(GGAM_F16, 0.35), (2.35, -19.2, 9.7, -3.77, 0.013, -0.527, -40.8, -2.09, -3.54)),
    ],
)
def test_the_linear_model_at_trim_has_the_derivatives_of_the_table(aircraft, published):
    alpha = trimmed(aircraft, SEA_LEVEL, aircraft.nominal[np.newaxis])[0, 0]
    (a,), (b,) = linear_lateral(aircraft, SEA_LEVEL).fixed[:2]
    of_states = a[1, 0], a[2, 0], a[1, 1], a[2, 1], a[2, 2]
    given = np.array([np.degrees(alpha), *of_states, b[1, 0], b[2, 0], b[2, 1]])
    unit = np.array([0.01, 0.1, 0.1, 0.01, 0.001, 0.001, 0.1, 0.01, 0.01])
    assert (np.abs(given - published) <= unit).all()


@pytest.mark.parametrize("aircraft", [F16, GGAM_F16, A7])
def test_the_linear_model_agrees_with_a_small_flight(aircraft):
    point = TrimCondition().point
    plant = linear_lateral(aircraft, point)
    (a,), (b,), (c,), (d,) = plant.fixed
    dt, aileron = 0.01, radians(0.02)
    pilot = np.zeros((1, 51, 3))
    pilot[:, :, 0] = aileron
    actuator = NoFeedback().actuator
    y, _trims = flown(aircraft, point, pilot, dt)
    x, surface, states = np.zeros(4), 0.0, []
    for _ in range(51):
        states.append(c[:4] @ x + d[:4, 0] * surface)
        for _ in range(20):
            x = x + dt / 20 * (a @ x + b[:, 0] * surface)
            surface += dt / 20 * actuator.bandwidth_rad_s * (aileron - surface)
    measured = y[0][:, [4, 5, 6, 8]] - y[0, 0, [4, 5, 6, 8]]
    np.testing.assert_allclose(measured[-1], states[-1], rtol=0.01, atol=2e-6)


def flown(aircraft, point, pilot: Array, dt: float, **settings):
    settings = {"controller": NO_LAW, "pitch_law": PitchLaw(0.0, 0.0)} | settings
    theta = aircraft.nominal[np.newaxis]
    actuator = NoFeedback().actuator
    return fly(aircraft, point, theta, pilot, dt, actuator=actuator, **settings)


@pytest.mark.parametrize("aircraft", [F16, GGAM_F16, A7])
@pytest.mark.parametrize("load_factor", [1.0, 2.0])
def test_trim_holds_for_ten_seconds(aircraft, load_factor):
    point = TrimCondition(load_factor=load_factor).point
    pilot = np.zeros((1, 1001, 3))
    y, _ = flown(aircraft, point, pilot, 0.01, pitch_law=PitchLaw(), n_outputs=14)
    np.testing.assert_allclose(y[0], np.broadcast_to(y[0, 0], y[0].shape), rtol=1e-5, atol=1e-6)
    assert y[0, 0, 3] == pytest.approx(load_factor, rel=0.02)  # alpha tilts lift and weight
    assert y[0, 0, 9] == pytest.approx(point.airspeed)


def test_a_climb_follows_its_path():
    point = TrimCondition(path_deg=5.0).point
    at = trimmed(F16, point, F16.nominal[np.newaxis])[0]
    x, change = np.empty(LAW), np.empty(LAW)
    begin(point, at, x)
    motion(F16.body, F16.nominal, point, at[2], x, 0.0, 0.0, change)
    assert change[ALTITUDE] == pytest.approx(point.airspeed * np.sin(radians(5.0)))


def test_a_body_without_torque_keeps_energy_and_angular_momentum():
    body = A7.body
    nothing = np.zeros((1, 45))
    point = TrimCondition().point._replace(gravity=1e-12, turn=1.0, climb=0.1)
    held = np.array([[0.2, 0.7, 0.0, 0.0, 0.0, 0.0]])
    loop = Loop(NO_LAW.a, NO_LAW.b, NO_LAW.c, NO_LAW.d, 0.0, 0.0, 20.2, inf, inf)
    out = np.empty((1, 1001, 13))
    gust = np.empty((0, 0, 2))
    times, still = Times(0.01, 1, 1, 0.0), np.zeros((1, 1001, 3))
    nobody = NOBODY, np.empty(0), np.empty(3)
    roll_out(body, nothing, point, held, loop, still, times, gust, *nobody, out, 0, 1)
    p, q, r = out[0, :, 5], out[0, :, 1], out[0, :, 6]
    momentum = np.array([body.ixx * p - body.ixz * r, body.iyy * q, body.izz * r - body.ixz * p])
    energy = 0.5 * (momentum * np.array([p, q, r])).sum(axis=0)
    assert np.ptp(q) > 0.5  # it tumbles
    np.testing.assert_allclose(
        np.linalg.norm(momentum, axis=0), np.linalg.norm(momentum[:, 0]), rtol=1e-8
    )
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)
    np.testing.assert_allclose(out[0, :, 9], point.airspeed, rtol=1e-8)


def test_surfaces_keep_their_rate_and_position():
    point = TrimCondition().point
    actuator = replace(NoFeedback().actuator, rate_limit_deg_s=30.0, position_limit_deg=4.0)
    pilot = np.zeros((1, 101, 3))
    pilot[:, 10:, 1] = radians(10.0)
    about = {"controller": NO_LAW, "pitch_law": PitchLaw()}
    y, _ = fly(F16, point, F16.nominal[np.newaxis], pilot, 0.01, actuator=actuator, **about)
    rudder = np.degrees(y[0, :, 12])
    assert rudder.max() == pytest.approx(4.0, abs=1e-3)
    assert np.diff(rudder).max() == pytest.approx(0.3, abs=1e-6)


def test_the_pedal_lag_fades_as_the_exponential():
    point, lag = TrimCondition().point, 0.2
    fast = replace(NoFeedback().actuator, bandwidth_rad_s=500.0)
    pilot = np.full((1, 51, 3), [0.0, 1e-3, 0.0])
    about = {"controller": NO_LAW, "pitch_law": PitchLaw(), "actuator": fast}
    y, _ = fly(F16, point, F16.nominal[np.newaxis], pilot, 0.01, pedal_lag_s=lag, **about)
    t = 0.01 * np.arange(51)
    np.testing.assert_allclose(
        y[0, 20:, 12], 1e-3 * (1 - np.exp(-(t[20:] - 0.002) / lag)), rtol=1e-3
    )


def test_dampers_have_the_signs_of_the_aircraft():
    point = TrimCondition().point
    pilot = np.zeros((1, 301, 3))
    pilot[:, 20:70, 1] = radians(3.0)
    law = RateDamper(kr=0.5, kp=0.1).controller(linear_lateral(F16, point))
    bare, _ = flown(F16, point, pilot, 0.01)
    damped, _ = flown(F16, point, pilot, 0.01, controller=law)
    assert np.abs(damped[0, 150:, 6]).max() < 0.5 * np.abs(bare[0, 150:, 6]).max()


def test_a_condition_without_trim_is_refused_with_a_remedy():
    point = TrimCondition(altitude_m=15_000, mach=0.2).point
    with pytest.raises(TrimError, match="higher Mach"):
        trimmed(F16, point, F16.nominal[np.newaxis])


def test_a_generic_aircraft_needs_its_45_parameters():
    assert isinstance(A7, GenericAircraft)
    with pytest.raises(ValueError, match="45"):
        replace(A7, theta=A7.theta[:-1])


@pytest.mark.parametrize(
    ("altitude", "density", "sound"),
    [
        (0, 1.2250, 340.294),
        (5000, 0.73612, 320.529),
        (11_000, 0.36392, 295.070),
        (20_000, 0.08803, 295.070),
    ],
)
def test_the_atmosphere_is_that_of_icao_doc_7488(altitude, density, sound):
    air = air_at(altitude)
    assert air.density == pytest.approx(density, abs=6e-6)
    assert air.sound == pytest.approx(sound, abs=6e-4)
    above = air_at(altitude + 1.0)
    assert air.thinning == pytest.approx(1 - above.density / air.density, rel=2e-4)
