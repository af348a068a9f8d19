import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.telemetry.mapping.derivations import (
    DERIVATIONS,
    HALF_WINDOW_S,
    derive,
    slopes,
    values_at,
    ways,
)
from app.telemetry.recording import Trace
from app.telemetry.targets import TARGETS
from core.channels import KEYS
from tests.support.tables import quaternion

T = np.arange(0.0, 20.0, 0.02)


def turning():
    """Euler angles of a rolling, pitching turn, and the body rates that go with them."""
    phi, phi_dot = 0.6 * np.sin(1.1 * T), 0.66 * np.cos(1.1 * T)
    theta, theta_dot = 0.2 * np.cos(0.7 * T), -0.14 * np.sin(0.7 * T)
    psi, psi_dot = 3.0 + 0.4 * T, np.full(len(T), 0.4)
    p = phi_dot - psi_dot * np.sin(theta)
    r = psi_dot * np.cos(theta) * np.cos(phi) - theta_dot * np.sin(phi)
    return {"phi": phi, "theta": theta, "psi": psi, "p": p, "r": r}


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def derived(key, **given_):
    traces = {name: Trace(T, values, source=f"s_{name}") for name, values in given_.items()}
    return derive(DERIVATIONS[key], traces)


@pytest.mark.parametrize("way", DERIVATIONS.values(), ids=DERIVATIONS)
def test_every_derivation_gives_its_target_on_the_times_of_its_first_input(way):
    rng = np.random.default_rng(2)
    traces = {
        key: Trace(
            T[:: 1 + n],
            0.5 + 0.1 * (key == "V") + 0.01 * rng.standard_normal(len(T[:: 1 + n])),
            source=f"s_{n}",
        )
        for n, key in enumerate((*way.needs, *way.helps))
    }
    trace = derive(way, traces)
    assert way.target in TARGETS
    assert trace.derived
    assert trace.t is traces[way.needs[0]].t
    assert trace.values.shape == trace.t.shape
    assert np.isfinite(trace.values).mean() > 0.9
    assert all(f" as {key}" in trace.source for key in (*way.needs, *way.helps))
    assert all(need in ways(way.target) for need in way.needs)


def test_a_channel_without_a_derivation_has_no_way():
    assert [key for key in KEYS if not ways(key)] == []
    assert ways("V") == ""


def test_sideslip_of_lateral_velocity_and_airspeed():
    trace = derived("beta_from_velocity", v=10.0 * np.sin(T), V=np.full(len(T), 100.0))
    np.testing.assert_allclose(trace.values, np.arcsin(0.1 * np.sin(T)))


def test_no_sideslip_without_airspeed():
    trace = derived("beta_from_velocity", v=np.full(len(T), 5.0), V=np.where(T < 1, 0.0, 4.0))
    assert np.isnan(trace.values).all()


@pytest.mark.parametrize("key", ["p", "r"])
def test_body_rates_of_the_attitude_through_a_turn_of_the_heading(key):
    motion = turning()
    motion["psi"] = wrapped(motion["psi"])
    given_ = {name: motion[name] for name in ("phi", "theta", "psi")}
    trace = derived(f"{key}_from_attitude", **given_)
    inside = (T > 0.2) & (T < 19.7)
    np.testing.assert_allclose(trace.values[inside], motion[key][inside], atol=2e-3)


def test_rates_of_one_angle_alone_are_its_derivative():
    motion = turning()
    inside = (T > 0.2) & (T < 19.7)
    p = derived("p_from_attitude", phi=motion["phi"]).values
    r = derived("r_from_attitude", psi=wrapped(motion["psi"])).values
    np.testing.assert_allclose(p[inside], 0.66 * np.cos(1.1 * T)[inside], atol=2e-3)
    np.testing.assert_allclose(r, 0.4, rtol=1e-9)


def test_gravity_is_removed_from_the_lateral_acceleration():
    m, ny = turning(), 0.1 * np.sin(2 * T)
    held = ny + np.sin(m["phi"]) * np.cos(m["theta"])
    full = derived("Ny_without_gravity", Ay=held, phi=m["phi"], theta=m["theta"])
    np.testing.assert_allclose(full.values, ny, atol=1e-12)
    level = derived("Ny_without_gravity", Ay=ny + np.sin(m["phi"]), phi=m["phi"])
    np.testing.assert_allclose(level.values, ny, atol=1e-12)


def test_attitude_of_the_quaternion():
    m = turning()
    q = quaternion(m["phi"], m["theta"], m["psi"])
    for sign in (1.0, -1.0):  # both mean the same attitude
        for angle in ("phi", "theta", "psi"):
            trace = derived(f"{angle}_from_quaternion", **{k: sign * x for k, x in q.items()})
            np.testing.assert_allclose(wrapped(trace.values - m[angle]), 0.0, atol=1e-9)


def test_a_quaternion_of_zeros_is_no_attitude():
    zeros = {key: np.zeros(len(T)) for key in ("q0", "q1", "q2", "q3")}
    assert np.isnan(derived("phi_from_quaternion", **zeros).values).all()


def test_inputs_of_another_clock_are_interpolated_but_never_across_a_gap():
    slow = np.arange(0.0, 20.0, 0.1)
    slow = slow[(slow < 5.0) | (slow > 8.0)]
    traces = {
        "v": Trace(T, 3.0 + T, source="v"),
        "V": Trace(slow, 100.0 + slow, source="V"),
    }
    trace, t = derive(DERIVATIONS["beta_from_velocity"], traces), T
    known = (t <= slow[slow < 5.0][-1]) | ((t >= slow[slow > 8.0][0]) & (t <= slow[-1]))
    np.testing.assert_allclose(trace.values[known], np.arcsin((3.0 + t) / (100.0 + t))[known])
    assert np.isnan(trace.values[~known]).all()


def test_a_heading_on_another_clock_is_interpolated_the_short_way_round():
    slow = np.arange(0.0, 20.01, 0.1)
    heading = Trace(slow, wrapped(3.0 + 0.4 * slow), source="psi")
    values = derive(DERIVATIONS["r_from_attitude"], {"psi": heading}).values
    np.testing.assert_allclose(values, 0.4, rtol=1e-9)
    traces = {
        "phi": Trace(T, np.zeros(len(T)), source="phi"),
        "theta": Trace(T, np.full(len(T), 0.3), source="theta"),
        "psi": heading,
    }
    p = derive(DERIVATIONS["p_from_attitude"], traces).values
    np.testing.assert_allclose(p, -0.4 * np.sin(0.3), rtol=1e-9)


@given(
    st.lists(st.floats(0.001, 0.5), min_size=1, max_size=40),
    st.floats(-5, 5),
    st.floats(-5, 5),
    st.randoms(use_true_random=False),
)
def test_the_slope_of_a_straight_line_is_exact_on_any_clock(steps, slope, start, random):
    t = np.concatenate([[0.0], np.cumsum(steps)])
    order = list(range(len(t)))
    random.shuffle(order)
    result = slopes(t[order], (start + slope * t)[order])
    known = np.isfinite(result)
    np.testing.assert_allclose(result[known], slope, rtol=1e-6, atol=1e-6)
    assert known.all() or len(steps) > 1


@pytest.mark.parametrize("rate", [20, 50, 100, 1000])
def test_noise_grows_as_the_docstring_says(rate):
    t = np.arange(0, 40, 1 / rate)
    noise = np.random.default_rng(4).standard_normal(len(t))
    result = slopes(t, noise)[rate:-rate].std()
    n = 2 * HALF_WINDOW_S * rate + 1
    exact = np.sqrt(12.0 / (n * (n * n - 1))) * rate
    terms = min(int(HALF_WINDOW_S * rate + 1e-6), 10)
    if terms == HALF_WINDOW_S * rate:
        assert result == pytest.approx(exact, rel=0.1)
    else:  # evenly spread ones of more samples
        assert exact < result < 5.0 * exact
    assert result < 0.5 * (np.diff(noise) * rate).std()


@pytest.mark.parametrize("frequency", [0.2, 0.5, 1.0, 1.5])
def test_a_sine_keeps_its_slope_and_is_not_delayed(frequency):
    omega = 2 * np.pi * frequency
    result = slopes(T, np.sin(omega * T))[50:-50]
    gain = 1.0 - (omega * HALF_WINDOW_S) ** 2 / 10.0
    want = gain * omega * np.cos(omega * T)[50:-50]
    np.testing.assert_allclose(result, want, atol=0.015 * omega)


def test_a_slope_does_not_look_across_a_gap_or_a_missing_value():
    t = np.arange(0.0, 4.0, 0.02)
    x = np.where(t < 2.0, 0.0, 100.0)
    holes = (t < 1.9) | (t > 2.1)
    result = slopes(t[holes], x[holes])
    np.testing.assert_allclose(result, 0.0, atol=1e-9)
    x[100] = np.nan
    assert np.isnan(slopes(t, x)[100])
    lonely = slopes(np.array([0.0, 0.1, 0.2, 5.0]), np.array([0.0, 1.0, 2.0, 9.0]))
    np.testing.assert_allclose(lonely, [10.0, 10.0, 10.0, np.nan])


@given(st.lists(st.floats(0, 1e3), min_size=2, max_size=30, unique=True), st.data())
def test_between_samples_values_lie_between_them_and_on_samples_are_exact(times, data):
    t = np.array(times)
    x = np.array(data.draw(st.lists(st.floats(-9, 9), min_size=len(t), max_size=len(t))))
    np.testing.assert_array_equal(values_at(t, t, x), x)
    at = np.array(data.draw(st.lists(st.floats(-10, 1.1e3), max_size=10)))
    result = values_at(at, t, x)
    assert np.isnan(result[(at < t.min()) | (at > t.max())]).all()
    known = result[np.isfinite(result)]
    assert ((known >= x.min() - 1e-9) & (known <= x.max() + 1e-9)).all()
