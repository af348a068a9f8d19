from dataclasses import replace

import numpy as np
import pytest

from core.dataset import Dataset
from core.evaluation.baselines import BASELINES
from core.evaluation.rates import EPSILONS, evaluate
from core.evaluation.study import METHODS, StudyRecipe, StudyResult, study
from core.monitor import MonitorRecipe, train
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from core.planned_test.collection import DatasetRecipe, Rollouts, collect
from core.planned_test.planned_test import LateralSimulator
from tests.support import plain_twin as twin

TWINS = dict(zip(METHODS, twin.METHODS, strict=True))


SMALL = StudyRecipe(n_monitors=3, n_test=80)


@pytest.fixture(scope="module")
def small() -> StudyResult:
    return study(SMALL)


@pytest.fixture(scope="module")
def rollouts() -> tuple[Dataset, Rollouts]:
    """Rollouts to train on, and sixty fresh ones."""
    recipe = replace(DatasetRecipe(), n_unsafe=20, seed=4)
    return collect(recipe), LateralSimulator(recipe).rollouts(60, np.random.default_rng(8))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("calibration", ["pointwise", "trajectory"])
def test_each_method_equals_the_plain_twin_on_the_same_rollouts(
    rollouts: tuple[Dataset, Rollouts], method: str, calibration: str
):
    dataset, flights = rollouts
    predictor, score = METHODS[method]
    monitor = train(
        dataset,
        MonitorRecipe(
            predictor=PREDICTORS[predictor],
            score=SCORES[score],
            calibration=calibration,  # pyright: ignore[reportArgumentType]
            scaling="raw",
        ),
    )
    alphas, p = twin.monitor_p_values(
        [y[: fail + 1] for y, fail in zip(dataset.unsafe, dataset.fail_index, strict=True)],
        list(dataset.safe),
        list(dataset.safe_times),
        flights.y,
        TWINS[method],
        monitor.h,
        level=calibration,
    )
    np.testing.assert_allclose(monitor.alphas, np.sort(alphas), rtol=1e-6, atol=1e-9)
    ours = np.array([monitor.p_values(y) for y in flights.y])
    assert np.mean(np.abs(ours - p) > 1e-12) < 1e-3  # samples within rounding of an alpha

    epsilons = EPSILONS[EPSILONS > 1 / 21]
    result = evaluate(monitor, flights.y, flights.fail_index, epsilons)
    miss, power = twin.evaluate(list(p), flights.fail_index.tolist(), monitor.h, epsilons)
    np.testing.assert_allclose(result.miss_rate, miss, atol=1.01 / result.n_unsafe)
    np.testing.assert_allclose(result.power, power, atol=1.01 / result.n_safe)


def test_a_study_depends_only_on_its_seed(small: StudyResult):
    same, other = study(SMALL), study(replace(SMALL, dataset=replace(SMALL.dataset, seed=1)))
    for name in METHODS:
        np.testing.assert_array_equal(small.methods[name].misses, same.methods[name].misses)
    assert any((small.methods[name].misses != other.methods[name].misses).any() for name in METHODS)


def test_study_counts_every_test_flight_once(small: StudyResult):
    assert small.methods.keys() == {*METHODS, *BASELINES}
    for method in small.methods.values():
        np.testing.assert_array_equal(method.n_unsafe + method.n_safe, 80)
        assert (method.misses <= method.n_unsafe).all()
        assert (method.false_alerts <= method.n_safe).all()
        assert (np.diff(method.misses, axis=1) >= 0).all()
        assert (np.diff(method.false_alerts, axis=1) <= 0).all()


def test_the_default_experiment_is_not_trivial():
    many = LateralSimulator(DatasetRecipe()).rollouts(4000, np.random.default_rng(0))
    assert 0.1 < many.is_unsafe.mean() < 0.4


def test_progress_counts_monitors_and_cancels():
    seen = []
    study(StudyRecipe(n_monitors=3, n_test=20), progress=lambda *counts: seen.append(counts))
    assert seen == [(1, 3), (2, 3), (3, 3)]

    def cancel(done: int, total: int) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        study(StudyRecipe(n_monitors=50, n_test=20), progress=cancel)
