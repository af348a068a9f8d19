from math import cos, inf, nan, pi, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from core.channels import KEYS, N_CHANNELS
from core.simulation import attitude as kinematics
from core.simulation.aircraft import PublishedAircraft
from core.simulation.attitude import (
    LONGEST_GAP_S,
    WASH_OUT_S,
    Attitude,
    DisplayAttitude,
    attitude,
    surface_signs,
    wrapped,
)
from core.simulation.published import DERIVATIVES, MODELS


def flown(p, r, dt: float = 0.05, **options) -> np.ndarray:
    """Attitudes (n, 3) of rates, sample by sample."""
    display = DisplayAttitude(**options)
    return np.array(
        [display.update(k * dt, *rates) for k, rates in enumerate(zip(p, r, strict=True))]
    )


def test_constant_rates_integrate_by_the_kinematics(monkeypatch):
    monkeypatch.setattr(kinematics, "WASH_OUT_S", inf)
    n, p, r, theta0 = 41, 0.3, 0.1, 0.2
    phi, theta, psi = flown([p] * n, [r] * n, theta0=theta0)[-1]
    assert phi == pytest.approx(2.0 * (p + tan(theta0) * r), rel=1e-12)
    assert theta == theta0
    assert psi == pytest.approx(2.0 * r / cos(theta0), rel=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_bank_equals_that_of_the_four_state_model(name, monkeypatch):
    monkeypatch.setattr(kinematics, "WASH_OUT_S", inf)
    recipe = PublishedAircraft(name, n_states=4)
    a, b, _, _ = (matrix[0] for matrix in recipe.uncertain_plant().nominal_plant())
    t = np.linspace(0.0, 4.0, 801)

    def flight(time, x):
        return a @ x + b @ np.deg2rad([0.5, 1.0 if time < 1.0 else -1.0])

    x = solve_ivp(flight, (0.0, 4.0), np.zeros(4), t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.01).y
    display = DisplayAttitude(recipe.model.theta0)
    bank = [display.update(*row).phi for row in zip(t, x[1], x[2], strict=True)]
    error = wrapped_all(np.array(bank) - x[3])
    assert np.abs(error).max() < 1e-3 * max(1.0, np.abs(x[3]).max())


def wrapped_all(angles: np.ndarray) -> np.ndarray:
    return np.array([wrapped(angle) for angle in angles])


def test_a_rate_bias_of_an_hour_ends_as_a_small_bank():
    bias = np.deg2rad(0.1)
    bank = flown([bias] * 72_000, [0.0] * 72_000)[:, 0]
    assert bank.max() == pytest.approx(bias * WASH_OUT_S, rel=1e-3)


def test_a_manoeuvre_loses_little_of_its_bank():
    bank = flown([0.5] * 41 + [0.0] * 80, [0.0] * 121)[-1, 0]
    assert 0.9 < bank / (0.5 * 2.025) < 1.0


def test_a_full_roll_comes_back_to_level_and_the_wash_out_does_not_unroll_it():
    n = 81
    bank = flown([pi / 2] * n, [0.0] * n)[:, 0]
    assert bank.max() > 3.0
    assert bank.min() < -3.0
    assert abs(bank[-1]) < 0.25


@given(st.lists(st.tuples(*[st.floats(-10, 10)] * 2), max_size=60), st.floats(-1.4, 1.4))
def test_bank_and_heading_stay_within_half_a_turn(rates, theta0):
    display = DisplayAttitude(theta0)
    for k, (p, r) in enumerate(rates):
        phi, _, psi = display.update(0.05 * k, p, r)
        assert -pi < phi <= pi
        assert -pi < psi <= pi


@given(st.floats(-50, 50))
def test_wrapping_keeps_the_direction(angle):
    assert -pi < wrapped(angle) <= pi
    assert cos(wrapped(angle)) == pytest.approx(cos(angle), abs=1e-12)


@pytest.mark.parametrize("rates", [(nan, 0.1), (0.1, nan), (inf, 0.0)])
def test_a_sample_without_finite_rates_holds_the_attitude(rates):
    display = DisplayAttitude()
    display.update(0.0, 0.2, 0.1)
    before = display.update(0.05, 0.2, 0.1)
    assert display.update(0.10, *rates) == before
    assert display.update(0.15, 0.2, 0.1).phi == pytest.approx(0.2 * 0.15, rel=1e-2)


def test_a_gap_holds_the_attitude():
    display = DisplayAttitude()
    display.update(0.0, 0.2, 0.1)
    before = display.update(0.05, 0.2, 0.1)
    assert display.update(0.06 + LONGEST_GAP_S, 0.2, 0.1) == before
    assert display.update(0.11 + LONGEST_GAP_S, 0.2, 0.1).phi > before.phi


def test_time_that_runs_backwards_starts_a_new_run_at_trim():
    display = DisplayAttitude(0.1)
    for k in range(10):
        display.update(0.05 * k, 0.5, 0.5)
    assert display.update(0.0, 0.5, 0.5) == pytest.approx(Attitude(0.0, 0.1, 0.0), abs=1e-15)


def test_a_whole_trajectory_equals_sample_by_sample():
    rng = np.random.default_rng(3)
    t, y = np.arange(0.0, 4.0, 0.02), rng.normal(size=(200, N_CHANNELS))
    p, r = y[:, KEYS.index("p")], y[:, KEYS.index("r")]
    whole = attitude(t, y, theta0=0.05)
    display = DisplayAttitude(0.05)
    single = [display.update(*map(float, row)) for row in zip(t, p, r, strict=True)]
    assert np.array_equal(whole, np.array(single))
    assert attitude(t[:0], y[:0]).shape == (0, 3)


@pytest.mark.parametrize("options", [{"theta0": pi / 2}, {"theta0": nan}])
def test_impossible_options_are_refused(options):
    with pytest.raises(ValueError, match="theta0"):
        DisplayAttitude(**options)


@pytest.mark.parametrize("name", MODELS)
def test_surface_signs_are_those_of_the_published_derivatives(name):
    plant = PublishedAircraft(name).uncertain_plant()
    nominal = dict(zip(DERIVATIVES, plant.nominal, strict=True))
    assert surface_signs(plant) == (np.sign(nominal["L_da"]), np.sign(nominal["N_dr"]))
