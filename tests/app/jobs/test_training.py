"""Validity calibrated in training: on flights of its own until they suffice, or with the reason."""

from dataclasses import replace

import numpy as np
import pytest

from app.commands.train import report
from app.jobs import supporting
from app.jobs.training import fresh_flights, train_and_test
from core.collection import DatasetRecipe, Simulator, collect
from core.dataset import Dataset
from core.monitor import MonitorRecipe, train

RECIPE = DatasetRecipe(n_unsafe=30, seed=4)


def nothing(*_: object) -> None:
    pass


@pytest.fixture(scope="module")
def simulated() -> Dataset:
    from app.jobs.training import simulate

    return simulate(RECIPE, nothing)


def test_training_calibrates_validity_even_without_a_test(simulated: Dataset) -> None:
    training = train_and_test(simulated, MonitorRecipe(), 0, nothing)
    support = training.monitor.support
    assert support is not None
    assert len(support.safe) + len(support.unsafe) == 1_000
    assert min(len(support.safe), len(support.unsafe)) >= 99
    assert support.level == 0.02
    line = f"validity calibrated on {len(support.safe)} safe and {len(support.unsafe)} failing"
    assert line in report(training)
    assert training.evaluation is None


def test_the_same_order_gives_the_same_monitor_file(simulated: Dataset) -> None:
    twice = [train_and_test(simulated, MonitorRecipe(), n, nothing).monitor for n in (0, 50)]
    assert replace(twice[1], evaluation=None).to_bytes() == twice[0].to_bytes()


def test_its_flights_neither_train_nor_test(simulated: Dataset) -> None:
    y, _ = next(supporting.fresh_batches(RECIPE, 5, nothing))
    others = [simulated.safe, simulated.unsafe, fresh_flights(RECIPE, 5).y]
    for others_y in others:
        assert not (y[:, None, 40:50] == others_y[None, :, 40:50]).all(axis=(2, 3)).any()


def test_flights_that_never_fail_leave_the_reason(
    simulated: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many are flown as the dataset took; then the monitor is not calibrated, and says why."""
    said = []
    recipe = replace(RECIPE, maneuver=replace(RECIPE.maneuver, amplitude_deg=0.1))
    monkeypatch.setattr(supporting, "MOST_FLIGHTS", 3_000)
    trained = train(simulated)
    monitor, why = supporting.supported(trained, simulated, recipe, said.append)
    assert monitor is trained
    assert why.startswith("validity is not calibrated: of 3000 fresh flights 3000 stayed safe and")
    assert said[-1] == "calibrating validity on fresh flights: 2000 so far"


def test_a_dataset_without_a_recipe_leaves_validity_uncalibrated(dataset: Dataset) -> None:
    training = train_and_test(dataset, MonitorRecipe(), 100, nothing)
    assert training.monitor.support is None
    assert training.unsupported.startswith("validity is not calibrated: the dataset has no recipe")


def test_what_progress_raises_cancels_the_calibration(simulated: Dataset) -> None:
    def cancel(words: str, *_: object) -> None:
        if "validity" in words:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        train_and_test(simulated, MonitorRecipe(), 0, cancel)


def test_long_rollouts_come_in_small_batches() -> None:
    recipe = replace(RECIPE, dt=0.001)
    y, _ = next(supporting.fresh_batches(recipe, 20_000, nothing))
    assert len(y) == 2_000_000 // recipe.maneuver.n_samples(0.001)
    assert np.isfinite(y).all()


def test_the_library_collects_and_calibrates_by_itself() -> None:
    from core.monitor.support import calibrate

    dataset, rng = collect(RECIPE), np.random.default_rng(5)
    fresh = Simulator(RECIPE).rollouts(1_000, rng)
    support = calibrate(train(dataset), dataset, [(fresh.y, fresh.fail_index)])
    assert len(support.safe) + len(support.unsafe) == 1_000
