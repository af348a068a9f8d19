import hashlib
from contextlib import nullcontext
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from core.channels import KEYS
from core.kernels.compiled import on_this_thread
from core.planned_test import maneuver_simulator
from core.planned_test.planned_test import USUAL_NOISE, DatasetRecipe, LateralSimulator, SensorNoise
from core.simulation import imperfections
from core.simulation.aircraft import AIRCRAFT, MatrixAircraft, PublishedAircraft
from core.simulation.control_law import Actuator
from core.simulation.imperfections import (
    USUAL_IMPERFECTIONS,
    Imperfections,
    Quantisation,
    channel_array,
    seed_of,
    trim_of,
)
from core.simulation.rollout import roll_out
from core.simulation.turbulence import FOOT, intensity, scale_length

N, SAMPLES, START, EVERY = 400, 60, 20, 2
DT = 0.05
QUIET = np.zeros(6)
REST = np.full(N, 10)
ZERO = np.zeros((N, 6))


def truth() -> np.ndarray:
    """True outputs from trim, half a sample apart: rest, then a different ramp in each channel."""
    t = (np.arange(START + EVERY * (SAMPLES - 1) + 1) - START) * DT / EVERY
    ramp = np.maximum(t - 0.5, 0.0)[:, None] * np.arange(1.0, 7.0)
    return np.repeat(ramp[None], N, axis=0)


def recorded(errors: Imperfections, noise: np.ndarray = QUIET, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return errors.record(truth(), ZERO, START, EVERY, REST, noise, DT / EVERY, seed_of(rng))


def correlations(columns: np.ndarray) -> np.ndarray:
    """Magnitudes of the correlations of each two columns."""
    every = np.asarray(np.corrcoef(columns.T))
    return np.abs(every[np.triu_indices(len(every), 1)])


EXACT = truth()[:, START::EVERY]


def test_a_recorder_without_errors_records_the_truth():
    np.testing.assert_allclose(recorded(Imperfections(asymmetry=0.1)), EXACT, atol=1e-15)


def test_gain_is_one_factor_for_each_channel_of_a_rollout():
    factors = recorded(Imperfections(gain=0.02))[:, 30:] / EXACT[:, 30:]
    np.testing.assert_allclose(factors, factors[:, :1].repeat(30, axis=1), rtol=1e-12)
    errors = factors[:, 0].ravel() - 1.0
    assert errors.std() == pytest.approx(0.02, rel=0.06)
    assert correlations(factors[:, 0]).max() < 0.2


def test_lag_shifts_each_channel_by_its_own_time():
    shift = (EXACT - recorded(Imperfections(lag_s=0.12)))[:, 40:] / np.arange(1.0, 7.0)
    np.testing.assert_allclose(shift, shift[:, :1].repeat(20, axis=1), atol=1e-12)
    lags = np.sort(shift[:, 0].ravel())
    np.testing.assert_allclose(lags, np.linspace(0.0, 0.12, len(lags)), atol=0.006)


def test_noise_is_white_with_its_mean_at_rest_removed():
    noise = np.array([1e-3, 2e-3, 0.0, 4e-3, 1e-4, 1e-2])
    error = recorded(Imperfections(), noise) - EXACT
    np.testing.assert_allclose(error[:, 10:].std(axis=(0, 1)), noise * np.sqrt(1.1), rtol=0.02)
    np.testing.assert_allclose(error[:, :10].mean(axis=1), 0.0, atol=1e-9)
    white = error[:, 10:, 0] - error[:, 10:, 0].mean(axis=1, keepdims=True)
    assert abs(np.corrcoef(white[:, 1:].ravel(), white[:, :-1].ravel())[0, 1]) < 0.05


def test_noise_of_channels_and_rollouts_is_independent():
    still, sigma = np.zeros((N, START + 2 * SAMPLES, 6)), np.ones(6)
    y = Imperfections().record(still, ZERO, START, 1, REST, sigma, DT, np.uint64(5))[:, 10:]
    y = y - y.mean(axis=1, keepdims=True)
    assert correlations(y.reshape(-1, 6)).max() < 4 / np.sqrt(y[..., 0].size)
    for others in (y[1:, :, 0], y[:-1, :, 1]):
        together = (y[:-1, :, 0] * others).mean() / y[..., 0].var()
        assert abs(together) < 4 / np.sqrt(others.size)


def test_bias_after_trim_scales_with_the_noise():
    noise = np.array([1e-3, 2e-3, 0.0, 4e-3, 1e-4, 1e-2])
    biased = recorded(Imperfections(bias=0.5), noise)
    bias = biased - recorded(Imperfections(), noise)
    np.testing.assert_allclose(bias, bias[:, :1].repeat(SAMPLES, axis=1), atol=1e-12)
    np.testing.assert_allclose(bias[:, 0].std(axis=0), 0.5 * noise, rtol=0.15)


def test_quantised_values_are_whole_steps_apart_at_any_trim():
    step = Quantisation(beta=0.07, Ny=0.013, delta_r=0.37)
    y = recorded(Imperfections(quantisation=step))
    for key, width in (("beta", 0.07), ("Ny", 0.013), ("delta_r", 0.37)):
        c = KEYS.index(key)
        steps = np.diff(y[..., c], axis=1) / width
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
        error = (y - EXACT)[:, 30:, c] / width
        assert abs(error).max() <= 1.0 + 1e-9
        assert abs(error.mean()) < 0.01
        assert error.std() > 0.25
    np.testing.assert_allclose(y[..., 1], EXACT[..., 1], atol=1e-12)


def test_trim_is_the_mean_at_rest_of_each_rollout():
    rng = np.random.default_rng(0)
    y = rng.standard_normal((3, 9, 6))
    rest, expected = np.array([1, 2, 3]), y.copy()
    for i in range(3):
        expected[i] -= y[i, 2 : 2 + 2 * rest[i] : 2].mean(axis=0)
    np.testing.assert_allclose(y - trim_of(y, 2, 2, rest)[:, None], expected, atol=1e-15)


def fly(planned: np.ndarray, n: int, most: int = 10, **errors: Any):
    return Imperfections(**errors).fly(planned, n, DT, most, seed_of(np.random.default_rng(0)))


def test_a_rollout_rests_until_its_first_input_and_no_longer_than_planned():
    planned = np.zeros((4, 20, 2))
    planned[0, 5:, 1], planned[1, 12:, 0], planned[2, 0:, 1] = 0.1, -0.1, 0.1
    flown, rest = fly(planned, 4)
    np.testing.assert_array_equal(rest, [5, 10, 1, 10])
    np.testing.assert_array_equal(flown, planned)
    flown, rest = fly(planned[:1], 3, unsteadiness_deg=0.1, trim_deg=0.1)
    np.testing.assert_array_equal(rest, [5, 5, 5])


def test_inputs_to_one_side_grow_as_much_as_the_others_shrink():
    planned = np.zeros((1, 10, 2))
    planned[0, 2:5, 1], planned[0, 5:8, 1] = 0.1, -0.1
    flown, _ = fly(planned, 2000, asymmetry=0.05)
    right, left = flown[:, 3, 1] / 0.1, flown[:, 6, 1] / -0.1
    np.testing.assert_allclose(right + left, 2.0, atol=1e-12)
    assert right.std() == pytest.approx(0.05, rel=0.06)
    assert not flown[:, :2].any()


def test_soft_hands_lag_by_their_own_time():
    """First order: a step is approached by exp(-t / lag), the lag uniform from 0 to the largest."""
    planned = np.zeros((1, 40, 2))
    planned[0, 5:, 1] = -0.1
    flown, rest = fly(planned, 2000, softness_s=0.3)
    assert (rest == 5).all()
    missing = 1.0 - flown[..., 1] / -0.1
    lags = -DT / np.log(np.maximum(missing[:, 5], 1e-300))
    steps = np.arange(1, 36)
    np.testing.assert_allclose(missing[:, 5:], np.exp(-DT * steps / lags[:, None]), atol=1e-12)
    assert 0 < lags.min() < 0.01 < 0.29 < lags.max() < 0.3
    assert lags.mean() == pytest.approx(0.15, rel=0.04)
    np.testing.assert_array_equal(fly(planned, 3)[0], planned.repeat(3, axis=0))


def test_a_trim_error_acts_before_the_rollout_begins():
    flown, _ = fly(np.zeros((1, 10, 2)), 2000, trim_deg=0.2)
    assert flown.shape == (2000, 70, 2)
    np.testing.assert_array_equal(flown, flown[:, :1].repeat(70, axis=1))
    np.testing.assert_allclose(np.degrees(flown[:, 0].std(axis=0)), 0.2, rtol=0.06)
    assert correlations(flown[:, 0]).max() < 0.1


def test_controls_are_unsteady_with_the_autocovariance_of_a_first_order_lag():
    moves = np.degrees(fly(np.zeros((1, 10, 2)), 4000, unsteadiness_deg=0.2)[0]) / 0.2
    for first in (0, 50):
        for lag in (0, 1, 7):
            found = np.mean(moves[:, first] * moves[:, first + lag])
            assert abs(found - np.exp(-lag * DT)) < 4 / np.sqrt(4000)
    assert correlations(moves.reshape(-1, 2)).max() < 0.05


# --- gusts by flight condition --------------------------------------------------------------------


def test_a_gust_depends_on_altitude_and_airspeed():
    gust = USUAL_IMPERFECTIONS.gust(15_770 * FOOT, 131.0)
    assert gust == (0.3 / 131.0, pytest.approx(1750 * FOOT / 131.0))
    light = replace(USUAL_IMPERFECTIONS, turbulence="light").gust(3000.0, 100.0)
    assert light == (intensity("light", 3000.0) / 100.0, scale_length(3000.0) / 100.0)


def test_tests_at_sea_level_are_flown_above_the_ground():
    for height in (305.0, 50.0):
        gust = Imperfections("light", least_height_m=height).gust(0.0, 100.0)
        assert gust == (intensity("light", height) / 100, scale_length(height) / 100)


@pytest.mark.parametrize("condition", [(None, 100.0), (1000.0, None), (None, None)])
def test_without_a_flight_condition_the_gust_is_given_as_sideslip(condition):
    given = Imperfections("smooth", gust_sigma_deg=0.2, gust_time_s=3.0)
    assert given.gust(*condition) == (np.radians(0.2), 3.0)
    assert replace(given, turbulence="given").gust(1000.0, 100.0) == (np.radians(0.2), 3.0)
    assert replace(given, turbulence="none").gust(*condition) is None


@pytest.mark.parametrize("name", AIRCRAFT)
def test_every_aircraft_is_flown_with_imperfections(name: str):
    recipe = DatasetRecipe.usual(AIRCRAFT[name]).as_flown()
    flights = LateralSimulator(recipe).rollouts(200, np.random.default_rng(0))
    assert np.isfinite(flights.y).all()
    assert 0.1 < flights.is_unsafe.mean() < 0.6


def test_an_aircraft_without_sideslip_among_its_states_is_refused_with_a_gust():
    example = AIRCRAFT["matrices"]
    assert isinstance(example, MatrixAircraft)
    c = tuple(tuple(2 * number for number in row) for row in example.c[:1]) + example.c[1:]
    recipe = replace(DatasetRecipe(), aircraft=replace(example, c=c))
    LateralSimulator(recipe)
    with pytest.raises(ValueError, match="sideslip is not one of the plant's states"):
        LateralSimulator(recipe.as_flown())


# --- rollouts -------------------------------------------------------------------------------------

CLEAN = DatasetRecipe(aircraft=PublishedAircraft("attas_id_16kft", 4))


def flown(n: int = 300, noise: SensorNoise = USUAL_NOISE, **changes):
    recipe = replace(CLEAN, noise=noise, imperfections=Imperfections(**changes))
    return LateralSimulator(recipe).rollouts(n, np.random.default_rng(2))


def test_labels_use_the_true_outputs():
    recorder = {
        "gain": 0.2,
        "bias": 9.0,
        "lag_s": 0.5,
        "quantisation": Quantisation(Ny=0.1),
    }
    exact = flown(asymmetry=1e-12)
    np.testing.assert_array_equal(flown(asymmetry=1e-12, **recorder).fail_index, exact.fail_index)
    clean = LateralSimulator(CLEAN).rollouts(300, np.random.default_rng(2))
    np.testing.assert_array_equal(clean.fail_index, exact.fail_index)


def test_true_outputs_include_the_gust():
    silent = SensorNoise()
    rough = flown(noise=silent, turbulence="severe")
    np.testing.assert_array_equal(CLEAN.specification.first_exceedance(rough.y), rough.fail_index)
    assert rough.is_unsafe.sum() > flown(noise=silent, asymmetry=1e-12).is_unsafe.sum() + 20
    assert (rough.y[:, :10].std(axis=(0, 1))[:4] > 1e-3).all()
    np.testing.assert_allclose(rough.y[:, :10].mean(axis=1), 0.0, atol=1e-12)


def test_labels_of_finer_steps_count_at_the_later_sample():
    recipe = replace(CLEAN, imperfections=replace(USUAL_IMPERFECTIONS, turbulence="none"))
    fine = replace(recipe, substeps=5)
    few, many = (
        LateralSimulator(r).rollouts(500, np.random.default_rng(5)) for r in (recipe, fine)
    )
    assert (many.fail_index <= few.fail_index).all()
    assert many.is_unsafe.sum() >= few.is_unsafe.sum()
    assert few.y.shape == many.y.shape


def test_bits_of_a_rollout_do_not_depend_on_the_threads(monkeypatch):
    recipe = CLEAN.as_flown()
    everything = LateralSimulator(recipe).rollouts(300, np.random.default_rng(2))
    for chunk, block in ((7, 1024), (128, 50), (13, 37)):
        monkeypatch.setattr(imperfections, "CHUNK", chunk)
        monkeypatch.setattr(maneuver_simulator, "BLOCK", block)
        for where in (nullcontext, on_this_thread):
            with where():
                again = LateralSimulator(recipe).rollouts(300, np.random.default_rng(2))
            np.testing.assert_array_equal(again.y, everything.y)
            np.testing.assert_array_equal(again.fail_index, everything.fail_index)
    other = LateralSimulator(recipe).rollouts(300, np.random.default_rng(3))
    assert not np.array_equal(other.y, everything.y)


@pytest.mark.parametrize("rate", [None, 60.0])
def test_outputs_without_the_unused_run_up_end_as_the_whole_ones(rate: float | None):
    law = replace(CLEAN.control_law, actuator=Actuator(rate_limit_deg_s=rate))
    simulator = LateralSimulator(replace(CLEAN, control_law=law).as_flown())
    drawn = simulator._drawn(20, np.random.default_rng(2))
    some = simulator.outputs(drawn._replace(unused=10))
    whole = simulator.outputs(drawn)
    assert whole.shape[1] - some.shape[1] == 8  # whole blocks of four
    np.testing.assert_array_equal(some, whole[:, 8:])


def test_a_recipe_flies_the_rollouts_of_earlier_versions():
    recipe = replace(DatasetRecipe(), substeps=2).as_trained()
    y = LateralSimulator(recipe).rollouts(21, np.random.default_rng(5)).y
    digest = hashlib.sha256((np.round(y, 9) + 0.0).tobytes()).hexdigest()
    assert digest.startswith("83ab684b53c93a9e")


def test_without_imperfections_the_bits_equal_earlier_versions():
    maneuver = replace(CLEAN.maneuver, timing_jitter_s=0.1, amplitude_jitter=0.15)
    recipe = replace(CLEAN, maneuver=maneuver, noise=USUAL_NOISE)
    recipe = replace(recipe, imperfections=Imperfections(gust_sigma_deg=1.0, least_height_m=9.0))
    simulator, rng = LateralSimulator(recipe), np.random.default_rng(4)
    found = simulator.rollouts(30, np.random.default_rng(4)).y
    theta = simulator.plant.sample(30, rng)
    y = roll_out(
        simulator.plant.plants(theta),
        simulator.controller,
        recipe.control_law.actuator,
        maneuver.pilot(recipe.dt, 30, rng),
        recipe.dt,
        pedal_lag_s=maneuver.pedal_lag_s,
    )
    for c, sigma in enumerate(channel_array(USUAL_NOISE)):
        y[..., c] += sigma * rng.standard_normal(y.shape[:2])
    np.testing.assert_array_equal(found, y)


def test_a_recipe_has_no_imperfections_by_default():
    assert DatasetRecipe().imperfections.are_none
    for field in fields(Imperfections):
        changed = replace(Imperfections(), **{field.name: getattr(USUAL_IMPERFECTIONS, field.name)})
        assert changed.are_none == (changed == Imperfections())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"turbulence": "rough"}, "turbulence='rough' was given: choose none, smooth, light"),
        ({"gain": -0.1}, "gain=-0.1 was given: it must be a finite number, 0 or more"),
        ({"lag_s": np.nan}, "lag_s=nan was given"),
        ({"turbulence": "given", "gust_time_s": 0.0}, "gust_time_s=0 was given"),
    ],
)
def test_impossible_imperfections_are_refused(change: dict, message: str):
    with pytest.raises(ValueError, match=message):
        Imperfections(**change)


def test_a_negative_step_is_refused():
    with pytest.raises(ValueError, match="quantisation p=-1"):
        Quantisation(p=-1.0)
