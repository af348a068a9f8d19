"""Campaign study: counts as by hand, on flights that stay the same until stopped."""

import csv
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.evaluation.lead_sweep import TESTS
from core.planned_test.planned_test import LateralSimulator
from core.seeds import Branch, stream
from tests.studies.campaign_study import (
    WITHOUT,
    CampaignStudyRecipe,
    PointOutcomes,
    avoided_against_lost,
    best_of,
    campaign_study,
    counted,
    in_words,
    plain,
)
from tests.studies.study_command import run_study

SMALL = CampaignStudyRecipe(
    tests=("F-16",),
    steps=(0.6, 1.0),
    clearance_epsilons=(0.1, 0.4, WITHOUT),
    monitor_epsilons=(0.1, WITHOUT),
    n_flown=150,
    n_unsafe=60,
    n_exceeding=30,
    n_aircraft=100,
)


@pytest.mark.parametrize("imperfections", ["none", "usual"])
def test_flights_of_given_aircraft_are_the_same_if_not_stopped(
    imperfections: str,
) -> None:
    """They do not fail with neutral controls from the first sample on."""
    test = TESTS["F-16"] if imperfections == "none" else TESTS["F-16"].as_flown()
    simulator, rng = LateralSimulator(test), stream(3, Branch.TEST)
    theta = simulator.plant.sample(40, rng)
    stopped = simulator.stopping(40, deepcopy(rng), theta)
    flown, _ = simulator.fly(theta, rng)
    every, n_samples = np.arange(40), flown.y.shape[1]
    assert flown.is_unsafe.any()
    np.testing.assert_array_equal(stopped(every, np.full(40, n_samples)), flown.fail_index)
    assert (stopped(every, np.zeros(40, np.int64)) == n_samples).all()


def test_points_arecounted_along_the_build_up() -> None:
    """A refused or aborted point ends it, and so does an exceedance; later points are refused."""
    no, yes = False, True
    over = np.array([no, no, no, no, no, yes])
    #                 refused   aborted in time   in vain   exceeds   safe   over before
    first = PointOutcomes(
        np.array([yes, yes, no, yes, no, yes]),
        {0.1: np.array([no, yes, yes, yes, yes, yes])},
        {0.2: np.array([no, yes, yes, no, no, no])},
        {0.2: np.array([yes, no, no, yes, no, yes])},
    )
    second = PointOutcomes(
        np.array([yes, yes, no, yes, no, yes]),
        {0.1: np.ones(6, bool)},
        {0.2: np.zeros(6, bool)},
        {0.2: np.array([yes, yes, no, yes, no, yes])},
    )
    counts = counted("a test", [first, second], over, 0.1, 0.2)
    assert (counts.n_exceeding, counts.avoided) == (3 + 2, 2 + 2)
    assert (counts.n_safe, counts.lost) == (2 + 2, 1 + 1)
    assert counts.caused == 0
    low, high = counts.intervals[0]
    assert low < counts.avoided_share == 0.8 < high


def test_a_smaller_epsilon_avoids_more_and_loses_more() -> None:
    """Without clearance and monitor nothing is avoided or lost."""
    counts = {(c.clearance_epsilon, c.monitor_epsilon): c for c in campaign_study(SMALL)}
    nothing = counts[WITHOUT, WITHOUT]
    assert (nothing.avoided, nothing.lost, nothing.caused) == (0, 0, 0)
    assert nothing.n_exceeding > 20
    for monitor in SMALL.monitor_epsilons:
        avoided = [counts[e, monitor].avoided for e in SMALL.clearance_epsilons]
        lost = [counts[e, monitor].lost for e in SMALL.clearance_epsilons]
        assert avoided == sorted(avoided, reverse=True)
        assert lost == sorted(lost, reverse=True)
    cleared = counts[0.1, WITHOUT]
    assert cleared.avoided_share >= 1 - 0.1 - 3 * (0.09 / 30 + 0.09 / cleared.n_exceeding) ** 0.5
    both, alone = counts[0.4, 0.1], counts[0.4, WITHOUT]
    assert both.avoided > alone.avoided
    best = best_of(list(counts.values()), cleared.avoided_share)
    assert best is not None
    assert best.lost_share <= cleared.lost_share
    assert best_of([nothing], 0.5) is None


def test_the_study_prints_its_table_and_writes_it_with_a_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sizes = ["--n-flown", "60", "--n-unsafe", "40", "--n-exceeding", "30", "--n-aircraft", "100"]
    grid = ["--steps", "0.6,1", "--clearance-epsilons", "0.2,1", "--monitor-epsilons", "0.2,1"]
    arguments = ["--tests", "F-16", *sizes, *grid, "-o", str(tmp_path / "c.csv")]
    run_study(CampaignStudyRecipe, campaign_study, in_words, plain, avoided_against_lost, arguments)
    printed = capsys.readouterr().out
    assert "build-up of 60%, 100%, 60 aircraft" in printed
    assert "F-16: " in printed.splitlines()[-1]
    with (tmp_path / "c.csv").open() as file:
        rows = list(csv.DictReader(file))
    pairs = {(row["clearance_epsilon"], row["monitor_epsilon"]) for row in rows}
    assert pairs == {("0.2", "0.2"), ("0.2", "1.0"), ("1.0", "0.2"), ("1.0", "1.0")}
    assert "no monitor" in (tmp_path / "c.svg").read_text()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"tests": ("B-52",)}, "'B-52' was given: choose F-16"),
        ({"method": "magic"}, "'magic' was given"),
        ({"steps": (1.0,)}, "two or more positive, growing"),
        ({"steps": (1.0, 0.5)}, "two or more positive, growing"),
        ({"clearance_epsilons": (0.0, 0.5)}, "above 0, at most 1"),
        ({"clearance_epsilons": (0.0001,)}, "it needs at least 9999"),
    ],
)
def test_impossible_studies_are_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        CampaignStudyRecipe(**given)
