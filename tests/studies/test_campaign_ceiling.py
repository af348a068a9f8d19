"""Ceiling of the campaign study: exact without scatter, and above every calibrated rule."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from core.evaluation.lead_sweep import TESTS
from core.planned_test.planned_test import DatasetRecipe, Simulator
from core.seeds import Branch, stream
from core.simulation.maneuver import Step
from tests.studies.campaign_ceiling import (
    CeilingRecipe,
    best,
    ceiling_study,
    in_words,
    plain,
    reached,
    ruled,
)
from tests.studies.campaign_study import WITHOUT, CampaignStudyRecipe, FlownBuildUp
from tests.studies.foresight import Foresight, Switches

SMALL = CampaignStudyRecipe(
    tests=("F-16",),
    imperfections="usual",
    steps=(0.6, 1.0),
    clearance_epsilons=(0.1, 0.4, WITHOUT),
    monitor_epsilons=(0.1, WITHOUT),
    n_flown=120,
    n_unsafe=60,
    n_exceeding=30,
    n_aircraft=100,
)


def without_scatter() -> DatasetRecipe:
    """An F-16's doublet, of which about half of the aircraft exceed a limit."""
    maneuver = replace(
        TESTS["F-16"].maneuver.with_peak(11.0), timing_jitter_s=0.0, amplitude_jitter=0.0
    )
    return replace(TESTS["F-16"], maneuver=maneuver)


@pytest.mark.parametrize("test", [TESTS["ATTAS"].as_flown(), without_scatter()])
def test_a_fork_that_flies_on_as_flown_ends_as_flown(test: DatasetRecipe) -> None:
    theta = Simulator(test).plant.sample(30, stream(5, Branch.TEST))
    flown, _ = Simulator(test).fly(theta, stream(6, Branch.TEST))
    foresight = Foresight(test, theta, stream(6, Branch.TEST))
    ends = foresight._ends(np.arange(30), foresight._inputs[:, np.newaxis])
    assert flown.is_unsafe.any()
    np.testing.assert_array_equal(ends[:, 0], flown.fail_index)


def test_forks_keep_the_input_flown_and_scatter_about_the_planned_one() -> None:
    test = replace(TESTS["F-16"].as_flown(), noise=TESTS["F-16"].noise)
    theta = Simulator(test).plant.sample(200, stream(5, Branch.TEST))
    foresight = Foresight(test, theta, stream(6, Branch.TEST))
    first, second, neutral = foresight._switches
    late = np.flatnonzero(second > first + 12)
    forks = foresight._forked(late, int(first[late].max()) + 1)
    now = int(first[late].max()) + 1
    flown = foresight._inputs[late][:, np.newaxis, :now]
    np.testing.assert_array_equal(
        forks[:, :, :now], np.broadcast_to(flown, forks[:, :, :now].shape)
    )
    peak = np.deg2rad(test.maneuver.peak_deg)
    other = forks.min(axis=2)
    assert abs(-other.mean() / peak - 1.0) < 0.05
    switch = (forks < 0).argmax(axis=2) - first[late, np.newaxis]
    assert abs(switch.mean() * test.dt - 1.0) < 0.05
    lasting = (forks < 0).sum(axis=2)
    assert abs(lasting.mean() * test.dt - 1.0) < 0.05
    assert 0.05 < lasting.std() * test.dt < 0.15
    assert (neutral > second).all()


def test_switches_of_a_flown_doublet() -> None:
    planned = np.array([[0.0, 2, 2, -2, 0], [0, 0, 0, 0, 0], [0, 0, 3, 3, 3]])
    switches = Switches.of(planned, 1.0)
    assert np.stack(switches).tolist() == [[1, 5, 2], [3, 5, 5], [4, 5, 5]]


def test_who_knows_the_aircraft_errs_never_without_scatter() -> None:
    """Chances are 0 or 1: every exceedance is foreseen and no safe point is lost."""
    build_up = FlownBuildUp(without_scatter(), replace(SMALL, imperfections="none"), 0)
    row = reached("F-16", "known", "avoided", ruled(build_up, "known"), build_up.flown[0].is_unsafe)
    assert row.n_exceeding > 20
    assert (row.avoided, row.lost, row.caused) == (row.n_exceeding, 0, 0)


def test_the_ceiling_is_above_every_calibrated_rule_on_the_same_flights() -> None:
    build_up = FlownBuildUp(TESTS["F-16"].as_flown(), SMALL, 0)
    over, everyone = build_up.flown[0].is_unsafe, np.ones(SMALL.n_flown, bool)
    known = [c for variant in ruled(build_up, "known") for _, c in variant.counts(over, everyone)]
    (calibrated,) = ruled(build_up, "calibrated")
    for _, pair in calibrated.counts(over, everyone):
        as_good = [c for c in known if c.avoided_share >= pair.avoided_share]
        assert min(c.lost_share for c in as_good) <= pair.lost_share
    _, levels = best([calibrated], over, everyone, "lost")
    assert calibrated.points[0].cleared.keys() >= {levels[0]}


def test_a_small_study_has_a_row_for_each_rule_and_goal() -> None:
    recipe = CeilingRecipe(tests=("ATTAS",), rules=("known", "identified"), n_flown=40)
    rows = ceiling_study(recipe)
    assert [(row.rule, row.goal) for row in rows] == [
        (rule, goal) for rule in recipe.rules for goal in ("avoided", "lost")
    ]
    for row in rows:
        assert 0 <= row.avoided <= row.n_exceeding
        assert plain(row)["lost_low"] <= row.lost / row.n_safe <= plain(row)["lost_high"]
    assert len(in_words(rows, recipe).splitlines()) == 5


@pytest.mark.parametrize(
    ("given", "words"),
    [({"tests": ("B-52",)}, "'B-52' was given"), ({"rules": ("magic",)}, "'magic' was given")],
)
def test_impossible_studies_are_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        CeilingRecipe(**given)


def test_foresight_needs_a_doublet() -> None:
    test = replace(TESTS["F-16"], maneuver=Step(amplitude_deg=5.0))
    theta = Simulator(test).plant.sample(2, stream(5, Branch.TEST))
    with pytest.raises(ValueError, match="Step was given"):
        Foresight(test, theta, stream(6, Branch.TEST))
