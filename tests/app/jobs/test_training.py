"""Validity calibrated in training: on separate flights until they suffice, or with the reason."""

import re
from dataclasses import replace

import numpy as np
import pytest

from app.commands.train import report
from app.jobs import training
from app.jobs.training import too_few, train_and_test
from app.recipes.recipes import USUAL_MONITOR
from core.dataset import Dataset
from core.monitor import MonitorRecipe, train
from core.monitor.predictor import Linear
from core.monitor.score import NearestNeighbor
from core.planned_test.collection import (
    DatasetRecipe,
    collect,
    combination_failures,
    evaluation_flights,
    fresh,
)
from core.planned_test.near import near_failures, near_rollouts
from core.seeds import Branch
from tests.support.own_pitch import pitch, small_test

RECIPE = DatasetRecipe(n_unsafe=30, seed=4)


def nothing(*_: object) -> None:
    pass


@pytest.fixture(scope="module")
def simulated() -> Dataset:
    from app.jobs.training import simulate

    return simulate(RECIPE, nothing)


def test_a_collection_shows_its_rate_and_the_time_left() -> None:
    from app.jobs.training import simulate

    told: list[str] = []
    simulate(RECIPE, lambda message, done, total: told.append(message))
    words = r"simulating: 30 unsafe of \d+ rollouts, [\d.]+ a second, 0 s left"
    assert re.fullmatch(words, told[-1])


def test_training_calibrates_validity_even_without_a_test(simulated: Dataset) -> None:
    result = train_and_test(simulated, MonitorRecipe(), 0, nothing)
    support = result.monitor.support
    assert support is not None
    assert len(support.safe) + len(support.unsafe) == 1_000
    assert min(len(support.safe), len(support.unsafe)) >= 99
    assert support.level == 0.02
    line = f"validity calibrated on {len(support.safe)} safe and {len(support.unsafe)} failing"
    assert line in report(result)
    assert result.monitor.evaluation is None


def test_the_same_order_gives_the_same_monitor_file(simulated: Dataset) -> None:
    twice = [train_and_test(simulated, MonitorRecipe(), n, nothing).monitor for n in (0, 50)]
    assert replace(twice[1], evaluation=None).to_bytes() == twice[0].to_bytes()


def test_flights_that_teach_the_method_nothing_are_not_flown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(training, "training_rollouts")
    test = small_test(pitch)
    recipe = MonitorRecipe(
        epsilon=0.2, guarantee="average", predictor=Linear(), score=NearestNeighbor()
    )
    assert train_and_test(collect(test), recipe, 0, nothing, test=test).monitor.n_unsafe == 20


def test_its_flights_neither_train_nor_test(simulated: Dataset) -> None:
    y = next(fresh(RECIPE, 5)).y
    others = [simulated.safe, simulated.unsafe, evaluation_flights(RECIPE, 5).y]
    for others_y in others:
        assert not (y[:, None, 40:50] == others_y[None, :, 40:50]).all(axis=(2, 3)).any()


def test_the_usual_rule_is_calibrated_on_as_many_fresh_failures(simulated: Dataset) -> None:
    result = train_and_test(simulated, replace(USUAL_MONITOR, epsilon=0.2), 0, nothing)
    failures, _ = combination_failures(RECIPE, RECIPE.n_unsafe, branch=Branch.ENSEMBLE)
    near = near_failures(RECIPE, RECIPE.n_unsafe)
    expected = train(
        simulated,
        result.monitor.recipe,
        rollouts=near_rollouts(RECIPE),
        failures=failures,
        near=near,
    )
    np.testing.assert_array_equal(result.monitor.alphas, expected.alphas)
    assert len(expected.alphas) == RECIPE.n_unsafe
    for y in (failures.y, *(flights.y for flights in near)):
        assert not (y[:, None, 40:50] == simulated.unsafe[None, :, 40:50]).all((2, 3)).any()


def test_flights_that_never_fail_leave_the_reason(
    simulated: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many are flown as the dataset took; then the monitor is not calibrated, and says why."""
    messages = []
    recipe = replace(RECIPE, maneuver=replace(RECIPE.maneuver, amplitude_deg=0.1))
    monkeypatch.setattr(training, "MOST_FRESH", 3_000)
    monkeypatch.setattr(training, "simulated_test", lambda _: recipe)
    trained = train_and_test(simulated, MonitorRecipe(), 0, lambda text, *_: messages.append(text))
    assert trained.monitor.support is None
    assert trained.not_calibrated.startswith(
        "validity is not calibrated: of 3000 fresh flights 3000 stayed safe and"
    )
    assert messages[-1] == "calibrating validity on fresh flights: 3000 so far"


def test_a_dataset_without_a_recipe_is_split_by_flight(dataset: Dataset) -> None:
    result = train_and_test(dataset, MonitorRecipe(epsilon=0.2), 100, nothing)
    assert len(result.monitor.alphas) == 6
    assert result.monitor.dataset_digest == dataset.digest()
    assert result.monitor.support is None
    assert result.not_calibrated.startswith("validity is not calibrated: of ")
    assert result.monitor.evaluation is not None
    parts = result.monitor.evaluation["flights"]
    assert sum(parts.values()) == len(dataset.unsafe) + len(dataset.safe)


@pytest.mark.parametrize(("n_unsafe", "enough"), [(57, False), (58, True)])
def test_too_few_failures_name_the_number_that_would_do(n_unsafe: int, enough: bool) -> None:
    texts = too_few(n_unsafe, USUAL_MONITOR)
    assert enough is (not texts)
    assert all("needs 58" in text for text in texts)
    assert too_few(0, USUAL_MONITOR)


def test_only_a_sensible_epsilon_is_advised() -> None:
    (few,), (many,) = too_few(6, USUAL_MONITOR), too_few(50, USUAL_MONITOR)
    assert "give 52 more" in few
    assert "accept" not in few
    assert "give 8 more, or accept epsilon 0.1" in many


def test_what_progress_raises_cancels_the_calibration(simulated: Dataset) -> None:
    def cancel(words: str, *_: object) -> None:
        if "validity" in words:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        train_and_test(simulated, MonitorRecipe(), 0, cancel)


def test_long_rollouts_come_in_small_batches() -> None:
    recipe = replace(RECIPE, dt=0.001)
    y = next(fresh(recipe, 20_000)).y
    assert len(y) == 2_000_000 // recipe.maneuver.n_samples(0.001)
    assert np.isfinite(y).all()


def test_the_library_collects_and_calibrates_by_itself(simulated: Dataset) -> None:
    """As the application does, to the bit."""
    monitor = train(collect(RECIPE), MonitorRecipe(), fresh(RECIPE))
    assert monitor.specification == RECIPE.specification
    ours = train_and_test(simulated, MonitorRecipe(), 0, nothing).monitor
    assert monitor.to_bytes() == ours.to_bytes()
