"""Manoeuvres are detected where the crew moved a surface, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.signal import find_peaks, lfilter

from app.assessment.manoeuvres import detect, peaks
from app.assessment.planned_test import PlannedTest
from core.limits.limits import Limits
from core.simulation.maneuver import MANEUVERS, Doublet, Maneuver
from tests.support.attas import DOUBLET, record

DT = 0.05
LIMITS = Limits().magnitudes
PLAN = PlannedTest(DT, LIMITS, DOUBLET)
NO_PLAN = PlannedTest(DT, LIMITS)
AMPLITUDE = np.radians(3.7)


def lagged(commands: np.ndarray, dt: float = DT, lag: float = 0.1) -> np.ndarray:
    """Surfaces that follow commands (n, 2) through a first-order lag."""
    keep = np.exp(-dt / lag)
    return np.asarray(lfilter([0.0, 1.0 - keep], [1.0, -keep], commands, axis=0))


def doublets(n: int, at: np.ndarray, dt: float = DT, amplitude: float = AMPLITUDE) -> np.ndarray:
    """(n, 2) surfaces at rest except for rudder doublets that begin at these times [s]."""
    t, commands = np.arange(n) * dt, np.zeros((n, 2))
    for start in at:
        elapsed = t - start + 1e-9
        commands[(elapsed >= 0.0) & (elapsed < 1.0), 1] = amplitude
        commands[(elapsed >= 1.0) & (elapsed < 2.0), 1] = -amplitude
    return lagged(commands, dt)


def turbulence(n: int, rms: float, time: float, rng: np.random.Generator) -> np.ndarray:
    """(n, 2) surfaces that a damper keeps moving."""
    keep = np.exp(-DT / time)
    white = rng.standard_normal((n, 2)) * rms * np.sqrt(1.0 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], white, axis=0))


def onsets(surfaces: np.ndarray, plan: PlannedTest = PLAN) -> list[float]:
    return [activity.onset * plan.dt for activity in detect(surfaces, plan)]


@pytest.mark.parametrize("rms_deg", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("time", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("plan", [PLAN, NO_PLAN], ids=["planned", "unplanned"])
def test_an_hour_yields_its_doublets_and_nothing_else(
    rms_deg: float, time: float, plan: PlannedTest
):
    rng, n = np.random.default_rng(3), 72_000
    at = np.sort(rng.choice(np.arange(30, 3500, 15), 12, replace=False)).astype(float)
    drift = np.radians(0.5) * np.arange(n)[:, None] * DT / 60.0
    noise = 3e-4 * rng.standard_normal((n, 2))
    surfaces = doublets(n, at) + turbulence(n, np.radians(rms_deg), time, rng) + drift + noise
    detected = onsets(surfaces, plan)
    assert len(detected) == len(at)
    assert np.abs(np.array(detected) - at).max() <= (0.06 if rms_deg == 0.0 else 0.5)


@pytest.mark.parametrize("plan", [PLAN, NO_PLAN], ids=["planned", "unplanned"])
def test_a_cruise_has_no_manoeuvre(plan: PlannedTest):
    rng, n = np.random.default_rng(4), 72_000
    surfaces = turbulence(n, np.radians(0.1), 0.5, rng)
    surfaces += np.radians(3.0) * np.sin(2.0 * np.pi * np.arange(n)[:, None] * DT / 1800.0)
    surfaces[rng.choice(n, 20, replace=False)] += np.radians(40.0)  # one-sample outliers
    surfaces[5000:5400] = np.nan
    assert onsets(surfaces, plan) == []


def test_quiet_surfaces_and_unknown_ones_have_no_manoeuvre():
    assert onsets(np.zeros((2000, 2))) == []
    assert onsets(np.full((2000, 2), np.nan)) == []


@pytest.mark.parametrize("name", sorted(MANEUVERS))
def test_every_planned_manoeuvre_is_detected_whole(name: str):
    maneuver = replace(MANEUVERS[name], lead_in_s=2.0, duration_s=30.0)
    plan = PlannedTest(DT, LIMITS, maneuver)
    surfaces = lagged(plan.commands)
    (activity,) = detect(np.vstack([surfaces, np.repeat(surfaces[-1:], 400, axis=0)]), plan)
    assert activity.onset * DT == pytest.approx(2.0, abs=0.1)
    last_input = 1 + np.flatnonzero(np.diff(plan.commands, axis=0).any(axis=1))[-1]
    assert activity.end * DT == pytest.approx(last_input * DT, abs=0.5)


def test_inputs_of_one_manoeuvre_are_joined_across_rests():
    maneuver: Maneuver = MANEUVERS["table"]
    table = {"t_s": (0.0, 1.0, 4.0, 5.0), "delta_a_deg": (0.0,) * 4}
    maneuver = replace(
        maneuver, **table, delta_r_deg=(5.0, 0.0, 5.0, 0.0), interpolation="hold", duration_s=12.0
    )
    plan = PlannedTest(DT, LIMITS, maneuver)
    assert [activity.times for activity in detect(lagged(plan.commands), plan)] == [1]
    assert len(detect(lagged(plan.commands), PLAN)) == 2


def test_manoeuvres_in_quick_succession_stay_separate():
    at = np.array([10.0, 15.0, 20.0])
    assert onsets(doublets(700, at)) == pytest.approx(at, abs=0.06)


@pytest.mark.parametrize("gap", [0.3, 1.0])
def test_inputs_too_close_to_separate_are_counted(gap: float):
    assert [a.times for a in detect(doublets(700, np.array([10.0])), PLAN)] == [1]
    for n in (2, 3):
        at = 10.0 + (2.0 + gap) * np.arange(n)
        for sign in (1.0, -1.0):
            assert [a.times for a in detect(doublets(700, at, amplitude=sign), PLAN)] == [n]
            assert [a.times for a in detect(sign * doublets(700, at), NO_PLAN)] == [1]


def test_a_step_of_a_build_up_is_detected():
    assert onsets(doublets(2000, np.array([50.0]), amplitude=0.3 * AMPLITUDE)) == [50.0]


def test_detection_continues_after_a_new_trim():
    surfaces = doublets(3000, np.array([40.0, 100.0]))
    surfaces[1200:, 1] += np.radians(2.0)
    assert onsets(surfaces) == pytest.approx([40.0, 60.0, 100.0], abs=0.06)


def test_a_recording_may_begin_just_before_the_input():
    assert onsets(doublets(400, np.array([0.2]))) == [pytest.approx(0.2)]


def test_an_input_of_the_other_surface_is_detected():
    assert onsets(doublets(2000, np.array([50.0]), amplitude=4 * AMPLITUDE)[:, ::-1]) == [50.0]


@pytest.mark.parametrize("change", ["sign", "trim"])
def test_sign_and_trim_of_a_surface_do_not_matter(change: str):
    rng = np.random.default_rng(5)
    surfaces = doublets(6000, np.array([60.0, 200.0])) + 3e-4 * rng.standard_normal((6000, 2))
    other = -surfaces if change == "sign" else surfaces + np.array([0.03, -0.1])
    assert detect(other, PLAN) == detect(surfaces, PLAN)


def test_times_do_not_depend_on_the_rate():
    at = np.array([30.0, 60.0])
    fine = replace(PLAN, dt=0.01)
    assert onsets(doublets(10_000, at, dt=0.01), fine) == pytest.approx(at, abs=0.06)


@pytest.mark.parametrize(
    ("name", "onset"),
    [
        ("attas_rud1", 5.8),
        ("attas_ail1", 5.5),
        ("citation_20190312_dutchroll", 6.0),
        ("citation_20190312_dutchroll_yd", 4.8),
    ],
)
def test_real_records_hold_one_manoeuvre_each(name: str, onset: float):
    channels = record(name).channels
    surfaces = np.column_stack([channels["delta_a"].values, channels["delta_r"].values])
    t = channels["delta_r"].t
    plan = PlannedTest(float(np.median(np.diff(t))), LIMITS, Doublet(amplitude_deg=-3.7))
    (activity,) = detect(surfaces, plan)
    assert activity.onset * plan.dt == pytest.approx(onset, abs=0.25)


@given(
    x=arrays(float, st.integers(0, 60), elements=st.sampled_from([0.0, 0.5, 1.0, 2.0])),
    height=st.sampled_from([-1.0, 0.5, 1.0, 3.0]),
    distance=st.integers(1, 20),
)
def test_peaks_are_those_of_scipy(x: np.ndarray, height: float, distance: int):
    expected, _ = find_peaks(x, height=height, distance=distance)
    assert peaks(x, height, distance).tolist() == expected.tolist()
