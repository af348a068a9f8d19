from itertools import product
from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from core.kernels.closed_loop import DEGREE, input_series
from core.simulation import rollout
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import (
    CONTROL_LAWS,
    Actuator,
    Controller,
    NoFeedback,
    RateDamper,
    StateSpaceLaw,
    closed_loops,
)
from core.simulation.rollout import roll_out
from core.simulation.uncertain_plant import Plants

F16 = {n: PublishedAircraft("f16_sl_h0_v502", n).uncertain_plant() for n in (3, 4)}
DT = 0.05
toolbox: Any = control  # its types do not know all that it takes
DAMPER = RateDamper()
NONE = NoFeedback().controller(F16[3])


def rows(matrix):
    return tuple(map(tuple, matrix.tolist()))


POLES = 1.0 + np.arange(6.0)
LAWS = CONTROL_LAWS | {
    "six_states": StateSpaceLaw(  # with the aircraft more states than are unrolled
        inputs=("r", "p"),
        outputs=("delta_a", "delta_r"),
        a=rows(np.diag(-POLES) + np.diag(np.ones(5), 1)),
        b=rows(np.outer(POLES, (0.1, 0.02))),
        c=rows(np.outer((0.02, 0.1), 1.0 / POLES)),
        d=((0.0, 0.1), (-0.2, 0.0)),
    )
}
LAWS_AND_STATES = [(n, s) for n, s in product(LAWS, (3, 4)) if (n, s) != ("f16_sl_ofb", 3)]


def draw(n, seed=0, n_states=3):
    return F16[n_states].plants(F16[n_states].sample(n, np.random.default_rng(seed)))


def doublet(n_samples=121, degrees=5.0):
    pilot = np.zeros((1, n_samples, 2))
    pilot[0, 10:30, 1], pilot[0, 30:50, 1] = np.radians(degrees), -np.radians(degrees)
    pilot[0, 15:40, 0] = np.radians(1.0)
    return pilot


def one(plants, i):
    return Plants(*(matrix[i : i + 1] for matrix in plants))


def random_plants(n, nx, rng, speed=1.0):
    """Plants of any size with dense C and D; rows 4 and 5 are the surfaces."""
    a = speed * (rng.standard_normal((n, nx, nx)) - 1.5 * np.eye(nx))
    c, d = rng.standard_normal((n, 6, nx)), rng.standard_normal((n, 6, 2))
    c[:, 4:], d[:, 4:] = 0.0, np.eye(2)
    return Plants(a, rng.standard_normal((n, nx, 2)), c, d)


def closed_form(plant, controller, actuator, pilot, dt, lag):
    """Response of one plant by the matrix exponential, the pedals' lag as two more states."""
    (loop,), drive = closed_loops(plant, controller, actuator)
    n, nx = len(loop), plant.a.shape[1]
    lagged = 2 if lag else 0
    block = np.zeros((n + lagged + 2,) * 2)
    block[:n, :n], block[:n, n : n + 2] = loop, drive
    if lag:
        block[n : n + 2, n : n + 2] = -np.eye(2) / lag
        block[n : n + 2, n + 2 :] = np.eye(2) / lag
    step = expm(block * dt)
    z = np.zeros(n + lagged)
    y = []
    for command in pilot:
        y.append(plant.c[0] @ z[:nx] + plant.d[0] @ z[nx : nx + 2])
        z = (step @ np.concatenate([z, command]))[:-2]
    return np.array(y)


def in_gust(plant, controller, actuator, pilot, dt, substeps, gust):
    """Response of one plant to piecewise linear gusts, by the matrix exponential."""
    (loop,), drive = closed_loops(plant, controller, actuator)
    n, nx, step = len(loop), plant.a.shape[1], dt / substeps
    block = np.zeros((n + 3,) * 2)
    block[:n, :n], block[:n, n : n + 2], block[0, n + 2] = loop, drive, 1.0
    block = expm(block * step)
    z, y = np.zeros(n), []
    for k, rate in enumerate(np.append(np.diff(gust) / step, 0.0)):
        y.append(plant.c[0] @ z[:nx] + plant.d[0] @ z[nx : nx + 2])
        z = (block @ np.concatenate([z, pilot[k // substeps], [rate]]))[:n]
    return np.array(y)


def python_control(plant, controller, actuator, pilot, dt, lag):
    """Response of one plant by python-control: connect, c2d with zero-order hold, simulate."""
    a, b, c, d = (matrix[0] for matrix in plant)
    nx = len(a)
    c = np.vstack([c, np.eye(nx)[3] if nx > 3 else np.zeros(nx)])
    airframe = toolbox.ss(a, b, c, np.vstack([d, np.zeros((1, 2))]))
    w = actuator.bandwidth_rad_s
    surfaces = toolbox.ss(-w * np.eye(2), w * np.eye(2), np.eye(2), np.zeros((2, 2)))
    loop = toolbox.feedback(airframe * surfaces, toolbox.ss(*controller))
    if lag:
        loop = loop * toolbox.ss(-np.eye(2) / lag, np.eye(2) / lag, np.eye(2), np.zeros((2, 2)))
    times = np.arange(len(pilot)) * dt
    return toolbox.forced_response(toolbox.c2d(loop, dt, "zoh"), times, pilot.T).outputs[:6].T


@pytest.mark.parametrize("lag", [0.0, 0.1])
@pytest.mark.parametrize(("name", "n_states"), LAWS_AND_STATES)
def test_rollouts_equal_python_control_and_the_matrix_exponential(name, n_states, lag):
    law = LAWS[name]
    controller = law.controller(F16[n_states])
    plants = draw(19, n_states=n_states)
    pilot = doublet()
    y = roll_out(plants, controller, law.actuator, pilot, DT, pedal_lag_s=lag)
    assert y.shape == (19, 121, 6)
    assert np.abs(y[:, :, 3]).max() > 0.1
    for i in (0, 7, 18):
        arguments = one(plants, i), controller, law.actuator, pilot[0], DT, lag
        np.testing.assert_allclose(y[i], python_control(*arguments), atol=1e-11)
        np.testing.assert_allclose(y[i], closed_form(*arguments), atol=1e-12)


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("n_states", [3, 4])
@pytest.mark.parametrize("name", ["f16_damper", "six_states"])
def test_an_aircraft_in_gusts_equals_the_matrix_exponential(name, n_states, substeps):
    law, plants = LAWS[name], draw(19, n_states=n_states)
    controller, pilot = law.controller(F16[n_states]), doublet(41)
    steps = np.random.default_rng(1).standard_normal((19, 40 * substeps + 1))
    gust = 0.01 + 0.002 * steps.cumsum(axis=1)

    def flown(actuator, gust):
        return roll_out(plants, controller, actuator, pilot, DT, substeps=substeps, gust=gust)

    y = flown(law.actuator, gust)
    for i in (0, 7, 18):
        expected = in_gust(
            one(plants, i), controller, law.actuator, pilot[0], DT, substeps, gust[i]
        )
        np.testing.assert_allclose(y[i], expected, atol=1e-12)
    limited = flown(Actuator(rate_limit_deg_s=1e6), gust)
    np.testing.assert_allclose(limited, y, atol=1e-7)
    steady = flown(law.actuator, np.full_like(gust, 0.3))
    np.testing.assert_array_equal(steady, flown(law.actuator, None))


@pytest.mark.parametrize("limited", [False, True])
def test_each_rollout_has_its_own_gust(limited):
    plants, controller = draw(21), DAMPER.controller(F16[3])
    actuator = Actuator(rate_limit_deg_s=20.0) if limited else Actuator()
    gust = np.random.default_rng(1).standard_normal((21, 31)).cumsum(axis=1) * 1e-3
    pilot = doublet(31)
    everything = roll_out(plants, controller, actuator, pilot, DT, gust=gust)
    alone = roll_out(one(plants, 17), controller, actuator, pilot, DT, gust=gust[17:18])
    np.testing.assert_array_equal(alone, everything[17:18])


@pytest.mark.parametrize("lag", [0.0, 1e-3, 0.1, 20.0])
@pytest.mark.parametrize("nx", [1, 2, 4, 7, 13])
def test_plants_of_any_size_and_outputs_are_simulated(nx, lag):
    rng = np.random.default_rng(nx)
    m = 3
    plants = random_plants(5, nx, rng)
    controller = Controller(
        -2.0 * np.eye(m) + 0.3 * rng.standard_normal((m, m)),
        rng.standard_normal((m, 7)),
        0.1 * rng.standard_normal((2, m)),
        0.1 * rng.standard_normal((2, 7)),
    )
    if nx < 4:
        controller.b[:, -1] = controller.d[:, -1] = 0.0
    pilot = rng.standard_normal((5, 23, 2))
    y = roll_out(plants, controller, Actuator(), pilot, DT, pedal_lag_s=lag)
    for i in range(5):
        expected = closed_form(one(plants, i), controller, Actuator(), pilot[i], DT, lag)
        np.testing.assert_allclose(y[i], expected, rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("lag", [0.0, 0.02])
@pytest.mark.parametrize("speed", [1e-6, 0.1, 5.0, 60.0])
def test_scaling_and_squaring_holds_from_slow_to_fast_plants(speed, lag):
    rng = np.random.default_rng(3)
    plants = random_plants(8, 4, rng, speed)
    plants.a[:] -= 3 * speed * np.eye(4)
    pilot = rng.standard_normal((1, 30, 2))
    controller = NONE
    y = roll_out(plants, controller, Actuator(), pilot, DT, pedal_lag_s=lag)
    for i in range(8):
        expected = closed_form(one(plants, i), controller, Actuator(), pilot[0], DT, lag)
        np.testing.assert_allclose(y[i], expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("lag_s", [1e-4, 3e-3, 0.05, 1.0, 1e4])
def test_input_series_is_the_integral_that_defines_it(lag_s):
    # phi_{j+1}(-x), the integral of exp(-x t) (1 - t)^j / j! over 0..1: a chain of integrators
    series, decays = input_series(0.05, lag_s)
    for s in (0, 1, 5, 40):
        x = 0.05 / 2**s / lag_s
        chain = np.diag(np.ones(DEGREE + 1), 1)
        chain[0, 0] = -x
        phi = expm(chain)[0, 1:] if x < 40 else None
        if phi is not None:
            np.testing.assert_allclose(series[1, s], phi, rtol=1e-12, atol=1e-18)
        assert series[1, s, 0] == pytest.approx(-np.expm1(-x) / x, rel=1e-13)
        assert decays[s] == pytest.approx(np.exp(-x), rel=1e-13)


@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.parametrize("own_pilot", [False, True])
@pytest.mark.parametrize("lag", [0.0, 0.1])
def test_bits_of_a_rollout_depend_only_on_itself(own_pilot, lag, limited, monkeypatch):
    rng = np.random.default_rng(5)
    n = 67
    plants = draw(n)
    plants.a[::3] *= 9.0  # neighbours that need other scales
    pilot = np.repeat(doublet(31), n if own_pilot else 1, axis=0)
    if own_pilot:
        pilot *= rng.uniform(0.5, 1.5, (n, 1, 1))
    actuator = Actuator(rate_limit_deg_s=20.0) if limited else Actuator()
    controller = DAMPER.controller(F16[3])

    def run(which):
        return roll_out(
            Plants(*(matrix[which] for matrix in plants)),
            controller,
            actuator,
            pilot[which] if own_pilot else pilot,
            DT,
            pedal_lag_s=lag,
        )

    everything = run(np.arange(n))
    order = rng.permutation(n)
    np.testing.assert_array_equal(run(order), everything[order])
    np.testing.assert_array_equal(run(np.array([41])), everything[41:42])
    np.testing.assert_array_equal(run(np.arange(5, 31)), everything[5:31])
    for size in (1, 8, 24, 1000):
        monkeypatch.setattr(rollout, "CHUNK", size)
        np.testing.assert_array_equal(run(np.arange(n)), everything)


def test_one_common_pilot_gives_the_same_bits_as_copies():
    plants, controller = draw(20), DAMPER.controller(F16[3])
    shared = roll_out(plants, controller, Actuator(), doublet(), DT, pedal_lag_s=0.1)
    each = np.repeat(doublet(), 20, axis=0)
    np.testing.assert_array_equal(
        roll_out(plants, controller, Actuator(), each, DT, pedal_lag_s=0.1), shared
    )


@pytest.mark.parametrize("lag", [0.0, 0.1])
@pytest.mark.parametrize("m", [2, 3, 10])
def test_substeps_add_samples_between_the_same_samples(m, lag):
    plants, controller = draw(9), DAMPER.controller(F16[3])
    coarse = roll_out(plants, controller, Actuator(), doublet(), DT, pedal_lag_s=lag)
    fine = roll_out(plants, controller, Actuator(), doublet(), DT, pedal_lag_s=lag, substeps=m)
    assert fine.shape == (9, 120 * m + 1, 6)
    np.testing.assert_allclose(fine[:, ::m], coarse, atol=1e-12)
    finer_pilot = np.repeat(doublet(), m, axis=1)[:, : 120 * m + 1]
    finer = roll_out(plants, controller, Actuator(), finer_pilot, DT / m, pedal_lag_s=lag)
    np.testing.assert_allclose(fine, finer, atol=1e-12)


def test_command_acts_after_its_sample():
    pilot = np.zeros((1, 5, 2))
    pilot[0, 2:, 1] = 0.1
    y = roll_out(draw(1), NONE, Actuator(), pilot, DT)[0]
    assert not y[:3].any()
    np.testing.assert_allclose(y[3, 5], 0.1 * -np.expm1(-20.2 * DT), rtol=1e-13)


@pytest.mark.parametrize("n_samples", [1, 2, 3, 4, 5, 8, 9])
def test_every_length_is_written_completely(n_samples):
    pilot = np.full((1, n_samples, 2), 0.1)
    long = roll_out(draw(17), NONE, Actuator(), np.full((1, 12, 2), 0.1), DT)
    out = roll_out(draw(17), NONE, Actuator(), pilot, DT)
    np.testing.assert_array_equal(out, long[:, :n_samples])


AMPLITUDES = st.lists(st.floats(-0.5, 0.5), min_size=24, max_size=24)


@given(AMPLITUDES, AMPLITUDES, st.floats(-3, 3), st.sampled_from([0.0, 0.1]))
def test_responses_superpose(first, second, factor, lag):
    plants, controller = draw(3), DAMPER.controller(F16[3])

    def run(commands):
        pilot = np.reshape(commands, (1, 12, 2))
        return roll_out(plants, controller, Actuator(), pilot, DT, pedal_lag_s=lag)

    together = run(np.array(first) + factor * np.array(second))
    np.testing.assert_allclose(together, run(first) + factor * run(second), atol=1e-12)


def test_a_diverging_rollout_exceeds_every_limit_without_affecting_others():
    plants = draw(8)
    plants.a[3] += 400.0 * np.eye(3)
    y = roll_out(plants, NONE, Actuator(), doublet(), DT)
    assert not np.isfinite(y[3, -1, :4]).any()
    assert np.isfinite(np.delete(y, 3, axis=0)).all()
    first = np.argmax(~(np.abs(y[3, :, 3]) < 0.5))
    assert np.isfinite(y[3, first, 3])
    assert not (np.abs(y[3, first:, 3]) < 0.5).any()


LIMITS = [
    Actuator(rate_limit_deg_s=15.0),
    Actuator(position_limit_deg=2.0),
    Actuator(rate_limit_deg_s=20.0, position_limit_deg=3.0),
]


@pytest.mark.parametrize("lag", [0.0, 0.1])
@pytest.mark.parametrize("actuator", LIMITS)
def test_limited_surfaces_equal_an_adaptive_integrator(actuator, lag):
    plants, controller = draw(9), DAMPER.controller(F16[3])
    pilot = doublet(61)
    y = roll_out(plants, controller, actuator, pilot, DT, pedal_lag_s=lag)
    rate = np.radians(actuator.rate_limit_deg_s or 1e9)
    position = np.radians(actuator.position_limit_deg or 1e9)
    for i in (0, 8):
        a, b, c, d = (matrix[i] for matrix in plants)

        def slope(_, z, command, a=a, b=b, c=c, d=d):
            x, delta, law, pedals = z[:3], z[3:5], z[5:6], z[6:]
            measured = np.append(c @ x + d @ delta, 0.0)
            wanted = (pedals if lag else command) - controller.c @ law - controller.d @ measured
            moving = 20.2 * (np.clip(wanted, -position, position) - delta)
            return np.concatenate(
                [
                    a @ x + b @ delta,
                    np.clip(moving, -rate, rate),
                    controller.a @ law + controller.b @ measured,
                    (command - pedals) / lag if lag else np.zeros(2),
                ]
            )

        z = np.zeros(8)
        for k in range(60):
            expected = np.append(c @ z[:3], 0)[:6] + d @ z[3:5]
            np.testing.assert_allclose(y[i, k], expected, atol=1e-4)
            z = solve_ivp(
                slope, (0, DT), z, "DOP853", args=(pilot[0, k],), rtol=1e-9, atol=1e-11,
                max_step=DT / 3,
            ).y[:, -1]  # fmt: skip
    assert np.abs(y[:, :, 4:]).max() <= position * (1 + 1e-12)
    assert np.abs(np.diff(y[:, :, 4:], axis=1)).max() <= rate * DT * (1 + 1e-12)
    free = roll_out(plants, controller, Actuator(), pilot, DT, pedal_lag_s=lag)
    assert np.abs(free - y).max() > 0.01


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("lag", [0.0, 0.1])
@pytest.mark.parametrize(("name", "n_states"), LAWS_AND_STATES)
def test_limits_that_are_never_reached_change_nothing(name, n_states, lag, substeps):
    law = LAWS[name]
    controller, plants = law.controller(F16[n_states]), draw(9, n_states=n_states)
    wide = Actuator(law.actuator.bandwidth_rad_s, 1e5, 1e4)
    options = {"pedal_lag_s": lag, "substeps": substeps}
    limited = roll_out(plants, controller, wide, doublet(), DT, **options)
    exact = roll_out(plants, controller, law.actuator, doublet(), DT, **options)
    np.testing.assert_allclose(limited, exact, atol=1e-6)


def changed(plants, **matrices):
    return plants._replace(**matrices)


def bad_inputs():
    plants, pilot = draw(4), doublet()
    nan = plants.c.copy()
    nan[2, 0, 0] = np.nan
    fast = plants.a.copy()
    fast[1] = 1e300
    return [
        ({"plants": changed(plants, a=plants.a[:, :2])}, r"the shapes \(\(4, 2, 3\)"),
        ({"plants": changed(plants, b=plants.b[:2])}, r"give \(\(4, 3, 3\), \(4, 3, 2\)"),
        ({"plants": changed(plants, d=plants.d[:, :5])}, r"\(4, 5, 2\)"),
        ({"plants": changed(plants, c=nan)}, "plant 2 holds numbers that are not finite"),
        ({"plants": changed(plants, a=fast)}, "a plant among 0 to 3 is too fast for steps of"),
        ({"controller": NONE._replace(d=np.zeros((2, 6)))}, r"\(2, 6\)"),
        ({"pilot": pilot[0]}, r"commands \(121, 2\): give .* \(1 or 4, n_samples, 2\)"),
        ({"pilot": np.repeat(pilot, 3, axis=0)}, "commands"),
    ]  # fmt: skip


@pytest.mark.parametrize(("change", "message"), bad_inputs())
def test_impossible_rollout_is_refused(change, message):
    given = {
        "plants": draw(4),
        "controller": NONE,
        "actuator": Actuator(),
        "pilot": doublet(),
        "dt": DT,
    } | change
    positional = [given.pop(name) for name in ("plants", "controller", "actuator", "pilot", "dt")]
    with pytest.raises(ValueError, match=message):
        roll_out(*positional, **given)
