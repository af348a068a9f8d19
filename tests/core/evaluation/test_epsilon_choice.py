"""Choosing epsilon: certified on flights that did not choose, refused with too few."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

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
from core.planned_test.collection import DatasetRecipe, card_of, collect, evaluation_flights
from core.simulation.simulator import Rollouts

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
    choice = choose(monitor, flights, ChoiceRecipe(0.15, 0.15))
    assert choice.most_missed <= 0.15
    assert choice.most_false <= 0.15
    second = flights.some(np.arange(len(flights.y)) % 2 == 1)
    counts = evaluate(monitor, second.y, second.fail_index, np.array([choice.epsilon]))
    assert (choice.misses, choice.n_unsafe) == (counts.misses[0], counts.n_unsafe)
    assert (choice.false_alerts, choice.n_safe) == (counts.false_alerts[0], counts.n_safe)
    assert (choice.withdrawn, choice.safe_withdrawn) == (
        counts.withdrawn[0],
        counts.safe_withdrawn[0],
    )
    assert choice.alert_above == monitor.alert_above(choice.epsilon)


def test_an_upper_bound_is_one_sided_at_two_and_a_half_percent() -> None:
    expected = stats.binomtest(9, 300).proportion_ci(0.95, "exact").high
    assert upper_bound(9, 300) == pytest.approx(expected)
    assert upper_bound(4, 4) == 1.0


def test_too_few_flights_to_certify_the_targets_name_the_number_needed(
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


def test_a_higher_cost_of_a_miss_gives_a_smaller_epsilon(
    monitor: Monitor, flights: Rollouts
) -> None:
    cheap, dear = (
        choose(monitor, flights, ChoiceRecipe(cost_of_miss=cost)) for cost in (0.1, 1000.0)
    )
    assert dear.epsilon < cheap.epsilon
    assert dear.misses <= cheap.misses


@pytest.mark.parametrize("guarantee", ["average", "95%"])
def test_all_candidates_are_possible(monitor: Monitor, guarantee: str) -> None:
    asked = replace(monitor, recipe=replace(AHEAD, guarantee=guarantee))  # pyright: ignore
    choice = candidates(asked)
    assert len(choice) > 50
    for epsilon in choice.tolist():
        asked.alert_above(epsilon)


@pytest.mark.parametrize("wrong", [0.0, 1.0, float("nan")])
def test_impossible_targets_and_costs_are_refused(
    monitor: Monitor, flights: Rollouts, wrong: float
) -> None:
    with pytest.raises(ValueError, match="give a share between 0 and 1"):
        choose(monitor, flights, ChoiceRecipe(wrong, 0.1))
    with pytest.raises(ValueError, match=r"cost_of_miss=.*must be positive"):
        choose(monitor, flights, ChoiceRecipe(cost_of_miss=wrong - 1.0))
    with pytest.raises(ChoiceError, match="too few failed or stayed safe"):
        choose(monitor, flights.some(slice(2)), ChoiceRecipe(cost_of_miss=1.0))
