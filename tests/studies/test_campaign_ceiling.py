"""Ceiling of the campaign study: exact without scatter, and above every calibrated rule."""

import csv
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from core.clearance import with_monitor
from core.evaluation.lead_sweep import TESTS
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.seeds import Branch, stream
from core.simulation.maneuver import Step
from tests.studies import retraining
from tests.studies.campaign_ceiling import (
    BY,
    CEILING,
    GOAL,
    GOALS,
    RULES,
    CeilingRecipe,
    Reached,
    best,
    ceiling_study,
    counts_of,
    counts_of_promises,
    in_words,
    reached,
    ruled,
)
from tests.studies.campaign_study import WITHOUT, CampaignStudyRecipe, FlownBuildUp
from tests.studies.foresight import Foresight, Switches
from tests.studies.retraining import retrained
from tests.support.places import DATA, ROOT

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


def kept(name: str = "campaign_ceiling") -> dict[tuple[str, str, str], Reached]:
    """The table written by `make studies`, or another one of the study."""
    with (DATA / f"{name}.csv").open() as file:
        rows = TypeAdapter(list[Reached]).validate_python(list(csv.DictReader(file)))
    return {(row.test, row.rule, row.goal): row for row in rows}


def test_no_rule_of_the_table_is_above_the_ceiling() -> None:
    rows = kept()
    assert rows.keys() == set(product(TESTS, (CEILING, *RULES), GOALS))
    for test, rule in product(TESTS, RULES):
        lost, most = (rows[test, rule, goal] for goal in GOALS)
        least, ceiling = (rows[test, CEILING, goal] for goal in GOALS)
        assert lost.avoided < GOAL * lost.n_exceeding or lost.share >= least.share
        assert most.share <= ceiling.share


@pytest.mark.parametrize(
    ("name", "rules"),
    [
        ("campaign_ceiling", (CEILING, *RULES[1:])),
        ("campaign_retrained", (CEILING, "identified", *BY[:2])),
    ],
)
def test_the_guide_gives_the_figures_of_the_table(name: str, rules: tuple[str, ...]) -> None:
    text = (ROOT / "static" / "guide" / "campaigns.md").read_text(encoding="utf-8")
    rows = kept(name)
    for goal, rule in product(GOALS, rules):
        each = [rows[test, rule, goal] for test in TESTS]
        cells = [f"{row.share:.2f} ({row.low:.2f} to {row.high:.2f})" for row in each]
        line = " | ".join(cells).replace("0.", ".")
        assert f"| {line} |" in text, (goal, rule)


def without_scatter() -> DatasetRecipe:
    """An F-16's doublet, of which about half of the aircraft exceed a limit."""
    maneuver = replace(
        TESTS["F-16"].maneuver.with_peak(11.0), timing_jitter_s=0.0, amplitude_jitter=0.0
    )
    return replace(TESTS["F-16"], maneuver=maneuver)


@pytest.mark.parametrize("test", [TESTS["ATTAS"].as_flown(), without_scatter()])
def test_a_fork_that_flies_on_as_flown_ends_as_flown(test: DatasetRecipe) -> None:
    theta = LateralSimulator(test).plant.sample(30, stream(5, Branch.TEST))
    flown, _ = LateralSimulator(test).fly(theta, stream(6, Branch.TEST))
    foresight = Foresight(test, theta, stream(6, Branch.TEST))
    ends = foresight._ends(np.arange(30), foresight._inputs[:, np.newaxis])
    assert flown.is_unsafe.any()
    np.testing.assert_array_equal(ends[:, 0], flown.fail_index)


def test_forks_keep_the_input_flown_and_scatter_about_the_planned_one() -> None:
    test = replace(TESTS["F-16"].as_flown(), noise=TESTS["F-16"].noise)
    theta = LateralSimulator(test).plant.sample(200, stream(5, Branch.TEST))
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
    counts = counts_of(ruled(build_up, "known"), build_up.flown[0].is_unsafe)
    row = reached("F-16", "known", "avoided", counts, stream(1, Branch.TEST))
    assert row.n_exceeding > 20
    assert (row.avoided, row.lost, row.caused) == (row.n_exceeding, 0, 0)
    assert (row.low, row.high) == (0.0, 0.0)


def test_the_best_choice_is_found_among_three() -> None:
    """By hand: of 200 exceedances and 100 safe points."""
    total = np.array([[[200, 199, 100, 40, 0], [200, 198, 100, 30, 0], [200, 190, 100, 20, 0]]])
    for goal, choice, share in (("avoided", 1, 0.3), ("lost", 2, 0.95)):
        chosen, shares = best(total, goal)
        assert (chosen[0], shares[0]) == (choice, share)


def test_the_ceiling_is_above_every_calibrated_rule_on_the_same_flights() -> None:
    build_up = FlownBuildUp(TESTS["F-16"].as_flown(), replace(SMALL, n_flown=60), 0)
    over = build_up.flown[0].is_unsafe
    known, calibrated = (
        counts_of(ruled(build_up, rule), over).sum(axis=1) for rule in ("known", "calibrated")
    )
    assert len(known) > len(calibrated) == 6
    avoided, lost = known[:, 1] / known[:, 0], known[:, 3] / known[:, 2]
    for pair in calibrated:
        assert lost[avoided >= pair[1] / pair[0]].min() <= pair[3] / pair[2]


def test_a_retrained_monitor_avoids_more_with_a_lower_threshold_of_each_kind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(with_monitor, "N_POINTS", 6)
    monkeypatch.setattr(retraining, "PROMISES", (0.1, 0.3))
    build_up = FlownBuildUp(TESTS["F-16"].as_flown(), replace(SMALL, n_flown=20), 0)
    by_epsilon, by_chance, by_promise = retrained(build_up, 1, (0.1, 0.5, WITHOUT))
    for point in (by_epsilon, by_chance, by_promise):
        aborted = [np.count_nonzero(flags) for flags in point.aborted.values()]
        assert aborted == sorted(aborted, reverse=True)
        assert aborted[0] > 0
    for point in (by_epsilon, by_chance):
        assert not point.aborted[WITHOUT].any()
        cleared = [np.count_nonzero(flags) for flags in point.cleared.values()]
        assert cleared == sorted(cleared)
        assert cleared[0] < cleared[-1] == 20
    counts = counts_of_promises([(by_promise,)], build_up.flown[0].is_unsafe)
    assert counts.shape == (2, 20, 5)


def test_a_small_study_has_a_row_for_each_rule_and_goal() -> None:
    recipe = CeilingRecipe(tests=("ATTAS",), rules=("known", "identified"), n_flown=20)
    rows = ceiling_study(recipe)
    assert [(row.rule, row.goal) for row in rows] == list(product((CEILING, *recipe.rules), GOALS))
    for row in rows:
        assert 0 <= row.avoided <= row.n_exceeding
        assert 0.0 <= row.low <= row.high <= 1.0
    assert len(in_words(rows, recipe).splitlines()) == 7


@pytest.mark.parametrize(
    ("given", "words"),
    [({"tests": ("B-52",)}, "'B-52' was given"), ({"rules": ("magic",)}, "'magic' was given")],
)
def test_impossible_studies_are_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        CeilingRecipe(**given)


def test_foresight_needs_a_doublet() -> None:
    test = replace(TESTS["F-16"], maneuver=Step(amplitude_deg=5.0))
    theta = LateralSimulator(test).plant.sample(2, stream(5, Branch.TEST))
    with pytest.raises(ValueError, match="Step was given"):
        Foresight(test, theta, stream(6, Branch.TEST))
