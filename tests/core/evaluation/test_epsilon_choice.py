"""Choosing epsilon: certified on flights that did not choose, refused where they are too few."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from core.collection import DatasetRecipe, card_of, collect, evaluation_flights
from core.evaluation.epsilon_choice import (
    ChoiceError,
    ChoiceRecipe,
    candidates,
    choose,
    upper_bound,
)
from core.evaluation.rates import evaluate
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from core.planned_test import Rollouts

RECIPE = DatasetRecipe(n_unsafe=100, seed=3)
AHEAD = MonitorRecipe(
    predictor=PREDICTORS["response_filter"], score=SCORES["rest_of_card"], t_early=0.25
)


@pytest.fixture(scope="module")
def monitor() -> Monitor:
    return train(collect(RECIPE), AHEAD, card=card_of(RECIPE))


@pytest.fixture(scope="module")
def flights() -> Rollouts:
    return evaluation_flights(RECIPE, 1200)


def test_two_targets_are_certified_by_flights_that_did_not_choose(
    monitor: Monitor, flights: Rollouts
) -> None:
    found = choose(monitor, flights, ChoiceRecipe(0.15, 0.15))
    assert found.most_missed <= 0.15
    assert found.most_false <= 0.15
    second = flights.some(np.arange(len(flights.y)) % 2 == 1)
    counts = evaluate(monitor, second.y, second.fail_index, np.array([found.epsilon]))
    assert (found.misses, found.n_unsafe) == (counts.misses[0], counts.n_unsafe)
    assert (found.false_alerts, found.n_safe) == (counts.false_alerts[0], counts.n_safe)
    assert (found.withdrawn, found.safe_withdrawn) == (
        counts.withdrawn[0],
        counts.safe_withdrawn[0],
    )
    assert found.alert_above == monitor.alert_above(found.epsilon)


def test_an_upper_bound_is_that_of_half_of_five_per_cent() -> None:
    expected = stats.binomtest(9, 300).proportion_ci(0.95, "exact").high
    assert upper_bound(9, 300) == pytest.approx(expected)
    assert upper_bound(4, 4) == 1.0


def test_targets_that_too_few_flights_can_certify_name_how_many_could(
    monitor: Monitor, flights: Rollouts
) -> None:
    few = flights.some(slice(160))
    with pytest.raises(
        ChoiceError, match=r"160 fresh flights cannot certify.*about [\d,]+00 fresh"
    ):
        choose(monitor, few, ChoiceRecipe(0.12, 0.12))


def test_targets_that_no_epsilon_keeps_are_refused(monitor: Monitor, flights: Rollouts) -> None:
    with pytest.raises(ChoiceError, match="no epsilon keeps both targets"):
        choose(monitor, flights, ChoiceRecipe(0.004, 0.004))


def test_a_dearer_miss_makes_a_smaller_epsilon(monitor: Monitor, flights: Rollouts) -> None:
    cheap, dear = (
        choose(monitor, flights, ChoiceRecipe(cost_of_miss=cost)) for cost in (0.1, 1000.0)
    )
    assert dear.epsilon < cheap.epsilon
    assert dear.misses <= cheap.misses


@pytest.mark.parametrize("guarantee", ["average", "95%"])
def test_candidates_are_all_served(monitor: Monitor, guarantee: str) -> None:
    asked = replace(monitor, recipe=replace(AHEAD, guarantee=guarantee))  # pyright: ignore
    found = candidates(asked)
    assert len(found) > 50
    for epsilon in found.tolist():
        asked.alert_above(epsilon)


@pytest.mark.parametrize("wrong", [0.0, 1.0, float("nan")])
def test_what_is_no_target_or_cost_is_refused(
    monitor: Monitor, flights: Rollouts, wrong: float
) -> None:
    with pytest.raises(ChoiceError, match="give a share between 0 and 1"):
        choose(monitor, flights, ChoiceRecipe(wrong, 0.1))
    with pytest.raises(ChoiceError, match="give a number above 0"):
        choose(monitor, flights, ChoiceRecipe(cost_of_miss=wrong - 1.0))
    with pytest.raises(ChoiceError, match="too few of which failed or stayed safe"):
        choose(monitor, flights.some(slice(2)), ChoiceRecipe(cost_of_miss=1.0))
