"""A manoeuvre begins where the crew moves a surface; trim is the mean of the rest before it."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy.signal import lfilter

from app.assessment.planned_test import PlannedTest
from app.assessment.trim import BEGINNING, BEYOND, EXCEEDED, RESTING, SHARE, CausalTrim
from core.channels import LATERAL, Dictionary
from core.limits.limits import Limits
from core.simulation.maneuver import LATERAL_MANEUVERS, MANEUVERS, Doublet, Maneuver
from tests.support.attas import DOUBLET, record

CONTROLS = LATERAL.of_role("control")
DT = 0.05
LIMITS = Limits().envelope
PLAN = PlannedTest(DT, LIMITS, DOUBLET)
NO_PLAN = PlannedTest(DT, LIMITS)
AMPLITUDE = np.radians(3.7)
LEARNED_S = 20.0
"""Until then the usual motion of the surfaces is not known."""


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


def followed(surfaces: np.ndarray, plan: PlannedTest) -> list[tuple[int, int]]:
    """First and last sample of each manoeuvre. surfaces: (n, 2)."""
    y = np.zeros((len(surfaces), 6))
    y[:, CONTROLS] = surfaces
    extent = np.ptp(np.nan_to_num(surfaces), axis=0)
    sizes = None if plan.maneuver else 0.5 * extent
    return [(begin, stop - 1) for begin, stop, _ in CausalTrim(plan, sizes=sizes).follow(y)]


def onsets(surfaces: np.ndarray, plan: PlannedTest = PLAN) -> list[float]:
    return [first * plan.dt for first, _ in followed(surfaces, plan)]


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
    detected = [onset for onset in onsets(surfaces, plan) if onset > LEARNED_S]
    assert len(detected) == len(at)
    assert np.abs(np.array(detected) - at).max() <= (0.16 if rms_deg == 0.0 else 1.2)


@pytest.mark.parametrize("plan", [PLAN, NO_PLAN], ids=["planned", "unplanned"])
def test_a_cruise_has_no_manoeuvre(plan: PlannedTest):
    rng, n = np.random.default_rng(4), 72_000
    surfaces = turbulence(n, np.radians(0.1), 0.5, rng)
    surfaces += np.radians(3.0) * np.sin(2.0 * np.pi * np.arange(n)[:, None] * DT / 1800.0)
    surfaces[rng.choice(n, 20, replace=False)] += np.radians(40.0)  # one-sample outliers
    surfaces[5000:5400] = np.nan
    assert [onset for onset in onsets(surfaces, plan) if onset > LEARNED_S] == []


def test_quiet_surfaces_and_unknown_ones_have_no_manoeuvre():
    assert onsets(np.zeros((2000, 2))) == []
    assert onsets(np.full((2000, 2), np.nan)) == []


@pytest.mark.parametrize(
    "name", sorted(name for name, each in LATERAL_MANEUVERS.items() if not each.captured)
)
def test_every_planned_manoeuvre_is_detected_whole(name: str):
    maneuver = replace(MANEUVERS[name], lead_in_s=2.0, duration_s=30.0)
    plan = PlannedTest(DT, LIMITS, maneuver)
    surfaces = lagged(plan.commands)
    ((first, last),) = followed(np.vstack([surfaces, np.repeat(surfaces[-1:], 400, axis=0)]), plan)
    slow = BEGINNING * SHARE * getattr(maneuver, "ramp_s", 0.0)
    assert first * DT == pytest.approx(2.15 + slow, abs=0.2)
    assert (last - first + 1) * DT == pytest.approx(28.0, abs=0.1)


def test_inputs_of_one_manoeuvre_are_joined_across_rests():
    maneuver: Maneuver = MANEUVERS["table"]
    table = {"t_s": (0.0, 1.0, 4.0, 5.0), "delta_a_deg": (0.0,) * 4}
    maneuver = replace(
        maneuver, **table, delta_r_deg=(5.0, 0.0, 5.0, 0.0), interpolation="hold", duration_s=12.0
    )
    plan = PlannedTest(DT, LIMITS, maneuver)
    assert len(followed(lagged(plan.commands), plan)) == 1


def test_manoeuvres_in_quick_succession_stay_separate():
    at = np.array([10.0, 17.0, 24.0])
    assert onsets(doublets(700, at)) == pytest.approx(at, abs=0.15)


def test_a_step_of_a_build_up_is_detected():
    assert onsets(doublets(2000, np.array([50.0]), amplitude=0.3 * AMPLITUDE)) == [
        pytest.approx(50.1, abs=0.11)
    ]


def test_detection_continues_after_a_new_trim():
    surfaces = doublets(3000, np.array([40.0, 100.0]))
    surfaces[1200:, 1] += np.radians(2.0)
    assert onsets(surfaces) == pytest.approx([40.0, 60.0, 100.0], abs=0.11)


def test_a_manoeuvre_needs_rest_before_it():
    assert onsets(doublets(400, np.array([0.2])))[0] > 1.0
    assert onsets(doublets(400, np.array([0.9]))) == [pytest.approx(0.9, abs=0.15)]


def test_an_input_of_the_other_surface_is_detected():
    assert onsets(doublets(2000, np.array([50.0]), amplitude=4 * AMPLITUDE)[:, ::-1]) == [
        pytest.approx(50.05, abs=0.11)
    ]


@pytest.mark.parametrize("change", ["sign", "trim"])
def test_sign_and_trim_of_a_surface_do_not_matter(change: str):
    rng = np.random.default_rng(5)
    surfaces = doublets(6000, np.array([60.0, 200.0])) + 3e-4 * rng.standard_normal((6000, 2))
    other = -surfaces if change == "sign" else surfaces + np.array([0.03, -0.1])
    assert followed(other, PLAN) == followed(surfaces, PLAN)


def test_times_do_not_depend_on_the_rate():
    at = np.array([30.0, 60.0])
    fine = replace(PLAN, dt=0.01)
    assert onsets(doublets(10_000, at, dt=0.01), fine) == pytest.approx(at, abs=0.11)


@pytest.mark.parametrize(
    ("name", "onset"),
    [
        ("attas_rud1", 5.8),
        ("attas_ail1", 5.5),
        ("citation_20190312_dutchroll", 6.0),
        ("citation_20190312_dutchroll_yd", 4.8),
    ],
)
def test_the_first_manoeuvre_of_a_real_record_begins_with_its_input(name: str, onset: float):
    channels = record(name).channels
    surfaces = np.column_stack([channels["delta_a"].values, channels["delta_r"].values])
    t = channels["delta_r"].t
    plan = PlannedTest(float(np.median(np.diff(t))), LIMITS, Doublet(amplitude_deg=-3.7))
    assert 0.0 <= onsets(surfaces, plan)[0] - onset <= 0.25 + 3.0 * plan.dt


def test_a_response_that_moves_has_no_trim_until_it_rests():
    t = np.arange(400) * DT
    y = np.zeros((400, 6))
    y[:200, 3] = 0.5 * np.sin(2.0 * np.pi * t[:200] / 4.0)
    moving = np.full(6, np.inf)
    moving[3] = 0.1
    trim = CausalTrim(PLAN, moving)
    level = []
    for each in y:
        trim.update(each)
        level.append(trim.level[3])
    assert np.isnan(level[20:200]).all()
    assert level[-1] == pytest.approx(0.0, abs=1e-12)
    trim.follow(y[:200])
    assert trim.level[3] == pytest.approx(0.0, abs=0.05)  # that of the rest before


def test_the_next_manoeuvre_after_an_unknown_trim_is_told_apart():
    y = np.zeros((80, 6))
    y[:, 3] = np.where(np.arange(80) % 10 < 5, 0.3, -0.3)
    trim = CausalTrim(PLAN, np.array([np.inf, np.inf, np.inf, 0.1, np.inf, np.inf]))
    trim.follow(y)
    reason, cause = trim.waits
    assert (reason, cause) == (
        "the aircraft moves: the trim of Ny is unknown until it rests",
        "moving",
    )
    assert trim.begin()
    assert np.isnan(trim.level[3])


BETA, NY = LATERAL.index("beta"), LATERAL.index("Ny")
REST, STEADY = 60, 200
"""Samples at rest, and of a steady value."""


def levels(*parts: tuple[int, float], trim: CausalTrim | None = None) -> np.ndarray:
    """Trim of Ny after each sample at rest. parts: samples, and their Ny."""
    trim, level = trim or CausalTrim(PLAN), []
    for ny in np.repeat([value for _, value in parts], [n for n, _ in parts]).tolist():
        trim.update(np.where(np.arange(6) == NY, ny, 0.0))
        level.append(trim.level[NY])
    return np.array(level)


def test_a_steady_exceedance_does_not_become_trim() -> None:
    level = levels((REST, 0.1), (STEADY, 0.7), (REST, 0.1))
    assert level[REST:] == pytest.approx(np.full(STEADY + REST, 0.1))


def test_a_new_trim_within_the_limits_of_the_old_one_is_measured() -> None:
    assert levels((REST, -0.4), (STEADY, 0.05), (STEADY, 0.4))[-1] == pytest.approx(0.4)


def test_trim_is_measured_from_the_rest_after_an_exceedance() -> None:
    level = levels((REST, 0.1), (STEADY, 0.7), (REST, 0.2))
    assert level[-1] == pytest.approx(0.2)
    assert {*np.round(level[REST:], 6)} == {0.1, 0.2}


def test_the_trim_of_a_rest_beyond_the_limit_is_unknown_until_a_manoeuvre_begins_from_it() -> None:
    trim = CausalTrim(PLAN)
    assert np.isnan(levels((STEADY, 0.6), trim=trim)).all()
    assert trim.waits[0] == BEYOND
    assert levels((STEADY, 0.1), trim=trim)[-1] == pytest.approx(0.1)
    assert trim.waits[0] == RESTING
    again = CausalTrim(PLAN)
    levels((STEADY, 0.6), trim=again)
    assert again.begin()
    assert again.level[NY] == pytest.approx(0.6)


def after_a_manoeuvre() -> CausalTrim:
    trim = CausalTrim(PLAN)
    levels((REST, 0.0), trim=trim)
    trim.begin()
    while trim.manoeuvre:
        trim.update(np.zeros(6))
    return trim


def test_a_person_may_take_a_rest_beyond_the_limit_for_trim() -> None:
    trim = after_a_manoeuvre()
    assert {*levels((STEADY, 0.6), trim=trim)} == {0.0}
    assert trim.waits[0] == EXCEEDED
    assert trim.begin()
    assert trim.level[NY] == pytest.approx(0.6)


def test_an_exceedance_that_has_ended_is_no_part_of_the_trim_of_a_manoeuvre_begun_by_hand() -> None:
    trim = after_a_manoeuvre()
    levels((10, 0.6), (10, 0.1), trim=trim)
    assert trim.waits[0] != EXCEEDED
    assert trim.begin()
    assert trim.level[NY] == pytest.approx(0.1)


@pytest.mark.parametrize(("reference", "expected"), [("absolute", 0.0), ("trim", 0.02)])
def test_the_value_itself_of_an_absolute_channel_exceeds(
    reference: Literal["trim", "absolute"], expected: float
) -> None:
    channels = [*LATERAL.channels]
    channels[NY] = replace(channels[NY], reference=reference)
    y = np.zeros((REST + STEADY, 6))
    y[:REST, NY], y[REST:, NY], y[REST:, BETA] = 0.4, 0.6, 0.02
    y[-30:, CONTROLS[1]] = AMPLITUDE
    plan = replace(PLAN, dictionary=Dictionary("lateral", tuple(channels)))
    ((_, _, trim),) = CausalTrim(plan).follow(y)
    assert trim[BETA] == pytest.approx(expected)


def test_limits_in_force_replace_those_of_the_test() -> None:
    y = np.zeros((REST + STEADY, 6))
    y[REST:, NY] = 0.4
    y[-30:, CONTROLS[1]] = AMPLITUDE
    narrow = Limits(Ny=0.3).envelope
    for in_force, expected in (
        ({}, 0.4),
        ({REST: narrow}, 0.0),
        ({REST: narrow, REST + 50: None}, 0.0),
    ):
        ((_, _, trim),) = CausalTrim(PLAN).follow(y, in_force=in_force)
        assert trim[NY] == pytest.approx(expected)
