"""Which method warns best: each is tried on flights that chose nothing else."""

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from core.evaluation.method_choice import (
    OF_THE_CARD,
    MethodCounts,
    best_of,
    kept_in_words,
    most_missed,
    try_methods,
)
from core.monitor import MonitorRecipe
from core.monitor.group import GROUPINGS
from core.monitor.recipe import METHODS
from core.planned_test.collection import (
    collect,
    combination_failures,
    evaluation_flights,
    training_rollouts,
)
from core.seeds import Branch
from tests.studies.roll_ceiling import TESTS as ROLLS
from tests.support import oscillator


def test_a_method_keeps_epsilon_within_two_standard_errors() -> None:
    counts = [MethodCounts("sure", m, 15, q, 100) for m, q in ((3, 50), (4, 90), (0, 30))]
    assert most_missed(0.1, 15) == 3
    assert best_of(counts, 0.1) == counts[0]
    assert "at most 3 of 15" in kept_in_words(0.1, 15)


def test_methods_are_tried_by_groups_too() -> None:
    whole = oscillator.collect(np.random.default_rng(51), n_unsafe=80).flights()
    learning, trying = whole.split((0.5, 0.5), 0)
    recipe = MonitorRecipe(epsilon=0.3, groups=GROUPINGS["largest_deflection"])
    dataset = oscillator.collect(np.random.default_rng(52), n_unsafe=60)
    tried = try_methods(dataset, trying, recipe, (learning.y, learning.fail_index))
    assert tried.keys() == METHODS.keys() - {OF_THE_CARD}
    assert all(not monitor.recipe.is_near for monitor, _ in tried.values())


def test_a_roll_that_switches_several_times_is_warned_of_by_its_next_peak() -> None:
    """The forecast of the whole rest cannot know early how the roll across will go."""
    test = replace(ROLLS["bank to bank, p"], n_unsafe=150, seed=3)
    dataset, learning = collect(test), training_rollouts(test)
    failures, _ = combination_failures(test, 150, branch=Branch.ENSEMBLE)
    trying = evaluation_flights(test, 6000)
    flights = replace(dataset.flights(), **trying._asdict())
    recipe = MonitorRecipe(epsilon=0.1)
    with threadpool_limits(1):
        tried = try_methods(dataset, flights, recipe, learning, failures)
    counts = {name: each for name, (_, each) in tried.items()}
    soon, error = counts["peak_soon"], (0.09 / 150) ** 0.5
    assert soon.miss_rate < 0.1 + 3 * error
    assert soon.power > max(0.88, counts["peak_ahead"].power + 0.02)
    assert best_of([*counts.values()], 0.1).name == "peak_soon"
