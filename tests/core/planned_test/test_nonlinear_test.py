"""Planned tests of nonlinear aircraft: flights, limits, amplitude, collection."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from core.channels import SIX_DOF
from core.computed import complete
from core.limits.flight_limits import ALL_CHANNELS, FinLoad, LoadLimits, WingBending
from core.limits.limits import IntervalLimits
from core.planned_test.amplitude import suggest_amplitude
from core.planned_test.collection import collect
from core.planned_test.nonlinear_test import NonlinearTest
from core.planned_test.planned_test import DatasetRecipe
from core.simulation.maneuver import ALL_SURFACES, LATERAL_MANEUVERS, MANEUVERS, Ramps
from core.simulation.nonlinear import TrimCondition
from core.simulation.nonlinear_aircraft import NONLINEAR_AIRCRAFT
from core.simulation.pilot import usual_pilot
from core.simulation.simulator import Flies, Stops

TEST = NonlinearTest(n_unsafe=20, seed=1)
EVERY_LIMIT = LoadLimits(Nz_high=7.0, fin_load=1e6, wing_bending=1e6)


@pytest.mark.parametrize("aircraft", NONLINEAR_AIRCRAFT)
@pytest.mark.parametrize("maneuver", MANEUVERS)
def test_every_nonlinear_aircraft_flies_every_manoeuvre_as_flown(aircraft: str, maneuver: str):
    test = replace(
        TEST,
        aircraft=NONLINEAR_AIRCRAFT[aircraft],
        maneuver=MANEUVERS[maneuver],
        pilot=usual_pilot(MANEUVERS[maneuver]),
        specification=EVERY_LIMIT,
    ).as_flown()
    flights = test.simulator().rollouts(8, np.random.default_rng(0))
    assert np.isfinite(flights.y).all()
    assert flights.y.shape[2] == len(EVERY_LIMIT.dictionary)


def test_the_same_seed_makes_the_same_flights_and_chunks_do_not_matter():
    simulator = TEST.as_trained().simulator()
    first = simulator.rollouts(150, np.random.default_rng(3))
    again = simulator.rollouts(150, np.random.default_rng(3))
    np.testing.assert_array_equal(first.y, again.y)
    np.testing.assert_array_equal(first.fail_index, again.fail_index)


def test_a_wind_up_turn_begins_at_the_load_factor_and_tightens():
    test = replace(
        TEST,
        condition=TrimCondition(load_factor=2.0),
        maneuver=MANEUVERS["wind_up_turn"],
        specification=LoadLimits(alpha_high_deg=25.0),
    )
    simulator = test.simulator()
    y = simulator.fly(simulator.parameters.nominal[np.newaxis], np.random.default_rng(0))[0].y[0]
    nz, alpha = y[:, SIX_DOF.index("Nz")], y[:, SIX_DOF.index("alpha")]
    assert nz[0] == pytest.approx(2.0, rel=0.01)
    assert nz.max() > 3.0
    assert (np.diff(alpha[20:160]) > 0).all()
    # surfaces and rates count from trim, the others are absolute
    assert np.abs(y[0, [SIX_DOF.index(key) for key in ("q", "p", "r", "delta_e")]]).max() == 0.0
    assert y[0, SIX_DOF.index("phi")] == pytest.approx(np.arccos(0.5), rel=0.01)


def test_the_margin_of_a_flight_is_one_at_its_limit():
    simulator = TEST.simulator()
    theta = simulator.parameters.sample(200, np.random.default_rng(1))
    flights, margin = simulator.fly(theta, np.random.default_rng(2))
    np.testing.assert_array_equal(margin >= 1.0, flights.is_unsafe)
    peak = flights.y[:, :, SIX_DOF.index("Nz")].max(axis=1)
    rest = simulator.specification.intervals["Nz"].rest
    np.testing.assert_allclose(margin, (peak - rest) / (2.25 - rest), rtol=0.02, atol=0.02)


def test_a_stopped_manoeuvre_fails_less():
    simulator = TEST.as_flown().simulator()
    assert isinstance(simulator, Flies)
    assert isinstance(simulator, Stops)
    flights = simulator.rollouts(100, np.random.default_rng(4))
    stopped = simulator.stopping(100, np.random.default_rng(4))
    every = np.arange(100)
    n_samples = flights.y.shape[1]
    whole = stopped(every, np.full(100, n_samples))
    np.testing.assert_array_equal(whole, flights.fail_index)
    assert (stopped(every, np.full(100, 12)) < n_samples).mean() < 0.5 * flights.is_unsafe.mean()


def test_the_suggested_amplitude_keeps_its_sign_and_a_quarter_exceeds():
    suggested = suggest_amplitude(TEST)
    assert suggested.amplitude_deg < 0.0
    assert suggested.share == pytest.approx(0.25, abs=0.02)


def test_a_collection_ends_with_its_failures_and_knows_its_limits():
    dataset = collect(TEST)
    assert len(dataset.unsafe) == 20
    assert dataset.theta_names[0] == "C_X_0"
    assert isinstance(dataset.specification, IntervalLimits)
    assert list(dataset.specification.intervals) == ["Nz"]
    np.testing.assert_array_equal(
        dataset.specification.envelope.first_exceedance(dataset.unsafe), dataset.fail_index
    )


def test_the_loads_are_those_of_their_equations():
    limits = replace(EVERY_LIMIT, fin=FinLoad(5.0, 0.9, 3.0, 6.0, 0.4), wing=WingBending(1e5, 2.0))
    dictionary = limits.dictionary
    values = {"beta": 0.1, "r": 0.2, "V": 150.0, "delta_r": -0.05, "qbar": 9000.0}
    values |= {"Nz": 3.0, "p": 0.5, "delta_a": 0.1}
    measured = np.array([[[values.get(key, 0.0) for key in dictionary.measured]]])
    y = complete(dictionary, measured, 0.05)[0, 0]
    fin = 9000 * 5 * 0.9 * 3 * (-0.1 + 6 * 0.2 / 150 - 0.4 * 0.05)
    assert y[dictionary.index("fin_load")] == pytest.approx(fin)
    wing = 0.5 * 1e5 * 2.0 * 0.8 * 3.0 + 9000 * abs(120 * 0.5 / 150 + 6 * 0.1)
    assert y[dictionary.index("wing_bending")] == pytest.approx(wing)


def test_one_sided_and_computed_limits_judge_flights():
    test = replace(TEST, specification=LoadLimits(V_low_mps=191.85, fin_load=50_000.0))
    simulator = test.simulator()
    flights = simulator.rollouts(100, np.random.default_rng(0))
    slow = flights.y[:, :, simulator.dictionary.index("V")].min(axis=1) <= 191.85
    assert 0 < slow.sum() < 100
    np.testing.assert_array_equal(flights.is_unsafe, slow)


def test_a_limit_that_trim_exceeds_is_refused():
    with pytest.raises(ValueError, match=r"\(alpha\) is 1\.\d+ deg .* below 1 deg"):
        replace(TEST, specification=LoadLimits(alpha_high_deg=1.0)).simulator()


@pytest.mark.parametrize("maneuver", MANEUVERS)
def test_a_manoeuvre_brings_limits_that_some_of_its_flights_exceed(maneuver: str):
    planned = MANEUVERS[maneuver]
    test = replace(TEST, maneuver=planned, pilot=usual_pilot(planned)).with_usual().as_trained()
    flights = test.simulator().rollouts(200, np.random.default_rng(0))
    assert 0.05 < flights.is_unsafe.mean() < 0.95
    assert (test.condition.load_factor > 1.0) == (maneuver == "wind_up_turn")


def test_limits_by_channel_and_their_parameters_agree():
    limits = LoadLimits(Nz_low=-1.0, Nz_high=4.9, alpha_high_deg=15.0, beta_deg=8.0, fin_load=5e4)
    assert limits.ends["alpha"] == (None, pytest.approx(radians(15.0)))
    assert limits.ends["beta"] == (-radians(8.0), radians(8.0))
    given = LoadLimits.given(limits.ends)
    assert given == pytest.approx(
        {"Nz_low": -1.0, "Nz_high": 4.9, "alpha_high_deg": 15.0, "beta_deg": 8.0, "fin_load": 5e4}
    )
    assert ALL_CHANNELS.index("wing_bending") == len(ALL_CHANNELS) - 1
    with pytest.raises(ValueError, match="theta"):
        LoadLimits.given({"theta": (None, 1.0)})


@pytest.mark.parametrize("name", [n for n, m in MANEUVERS.items() if isinstance(m, Ramps)])
def test_a_manoeuvre_of_ramps_reaches_its_levels_on_time(name: str):
    maneuver = MANEUVERS[name]
    assert isinstance(maneuver, Ramps)
    commands = np.degrees(maneuver.pilot(0.05, 1, np.random.default_rng(0))[0])
    at, levels = maneuver.lead_in_s, {}
    for duration, *level in maneuver.levels_s:
        at += duration
        levels[round(at / 0.05)] = level
    for k, level in levels.items():
        planned = maneuver.amplitude_deg * np.array(level[: commands.shape[1]])
        np.testing.assert_allclose(commands[min(k, len(commands) - 1)], planned, atol=1e-6)


def test_a_manoeuvre_with_the_elevator_needs_a_nonlinear_aircraft():
    assert "pitch_doublet" not in LATERAL_MANEUVERS
    assert MANEUVERS["pitch_doublet"].n_surfaces == ALL_SURFACES
    with pytest.raises(ValueError, match="elevator"):
        DatasetRecipe(maneuver=MANEUVERS["wind_up_turn"])
