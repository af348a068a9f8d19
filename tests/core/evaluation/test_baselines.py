"""Rules of others: each equals a plain twin, and none sees what comes later."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import beta

from core.channels import KEYS, LONGITUDINAL
from core.dataset import Dataset
from core.evaluation.baselines import (
    BASELINES,
    LEAST_WIDTH,
    REACH,
    TOLERANCE,
    BoundedDerivatives,
    CurrentShare,
    evaluate_baseline,
    recursive_estimates,
)
from core.evaluation.rates import evaluate
from core.evaluation.study import methods
from core.kernels.reductions import box_distances, grow_boxes
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, Rollouts, collect, evaluation_flights
from core.types import Array

EPSILONS = np.array([0.1, 0.2, 0.5, 0.9])
RECIPE = MonitorRecipe()


@pytest.fixture(scope="module")
def rollouts() -> tuple[Dataset, Rollouts]:
    """Rollouts as flown to learn from, and sixty fresh ones."""
    recipe = replace(DatasetRecipe().as_flown(), n_unsafe=20, max_safe=40, seed=5)
    return collect(recipe), evaluation_flights(recipe, 60)


def envelope_twin(dataset: Dataset) -> Callable[[Array], Array]:
    _, n_samples, n_channels = dataset.safe.shape
    widest = [
        max(np.ptp(dataset.safe[:, k, c]) / 2 for k in range(n_samples)) for c in range(n_channels)
    ]

    def scores(y: Array) -> Array:
        result = np.empty(y.shape[:2])
        for i, k in np.ndindex(*y.shape[:2]):
            out = []
            for c in range(n_channels):
                band = [float(flight[k, c]) for flight in dataset.safe]
                half = max((max(band) - min(band)) / 2, LEAST_WIDTH * widest[c])
                out.append(abs(y[i, k, c] - (max(band) + min(band)) / 2) / half)
            result[i, k] = -max(out)
        return result

    return scores


def least_squares_twin(x: Array, y: Array, usual: Array) -> Array:
    """The textbook's recursion with gain and covariance, for one flight and each output."""
    result = np.empty((len(x), x.shape[1], y.shape[1]))
    for output in range(y.shape[1]):
        estimate, covariance = usual[:, output].copy(), np.eye(x.shape[1])
        for k, row in enumerate(x):
            gain = covariance @ row / (1 + row @ covariance @ row)
            estimate = estimate + gain * (y[k, output] - row @ estimate)
            covariance = covariance - np.outer(gain, row @ covariance)
            result[k, :, output] = estimate
    return result


def derivatives_twin(dataset: Dataset) -> Callable[[Array], Array]:
    sideslip, p, r, n_y, *surfaces = (KEYS.index(key) for key in KEYS)

    def equations(flight: Array) -> tuple[Array, Array]:
        x, out = [np.zeros(5)], [np.zeros(3)]
        for before, now in pairwise(flight):
            middle = (before + now) / 2
            x.append(middle[[sideslip, p, r, *surfaces]])
            rates = (now - before)[[p, r]] / dataset.dt
            out.append(np.array([*rates, middle[n_y]]))
        return np.array(x), np.array(out)

    known = [equations(flight) for flight in dataset.safe]
    x, out = (np.concatenate(parts) for parts in zip(*known, strict=True))
    scale = x.std(axis=0)
    usual = np.linalg.pinv(x / scale) @ out

    def estimates(flight: Array) -> Array:
        x, out = equations(flight)
        return least_squares_twin(x / scale, out, usual)

    final = np.array([estimates(flight)[-1] for flight in dataset.safe])
    low, high = final.min(axis=0), final.max(axis=0)

    def scores(y: Array) -> Array:
        out = [np.abs(2 * estimates(flight) - low - high) / (high - low) for flight in y]
        return -np.array(out).max(axis=(2, 3))

    return scores


def boxes_twin(x: Array, tolerance: float, reach: float) -> list[tuple[Array, Array]]:
    boxes: list[tuple[Array, Array]] = []
    for row in x:
        away = [distance_twin(row, [box]) for box in boxes]
        if away and min(away) <= tolerance:
            nearest = int(np.argmin(away))
            low, high = boxes[nearest]
            boxes[nearest] = np.minimum(low, row), np.maximum(high, row)
        else:
            boxes.append((row - reach, row + reach))
    return boxes


def distance_twin(row: Array, boxes: list[tuple[Array, Array]]) -> float:
    return min(float(np.linalg.norm(row - np.clip(row, low, high))) for low, high in boxes)


def monitoring_twin(dataset: Dataset) -> Callable[[Array], Array]:
    samples = dataset.safe.reshape(-1, dataset.safe.shape[2])
    scale = samples.std(axis=0)
    low, high = grow_boxes(samples / scale, TOLERANCE, REACH)
    boxes = list(zip(low, high, strict=True))
    return lambda y: np.array(
        [[-distance_twin(row / scale, boxes) for row in flight] for flight in y]
    )


def share_twin(dataset: Dataset) -> Callable[[Array], Array]:
    n_y = KEYS.index("Ny")
    return lambda y: -np.abs(y[..., n_y]) / dataset.specification.Ny  # type: ignore[union-attr]


TWINS = {
    "safe envelope": envelope_twin,
    "derivatives in bounds": derivatives_twin,
    "inductive monitoring": monitoring_twin,
    "current share of limit": share_twin,
}


@pytest.mark.parametrize("name", BASELINES)
def test_a_rule_of_others_equals_its_plain_twin(rollouts: tuple[Dataset, Rollouts], name: str):
    dataset, flights = rollouts
    y = flights.y[:3]
    ours, plain = BASELINES[name].fit(dataset)(y), TWINS[name](dataset)(y)
    np.testing.assert_allclose(ours, plain, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("name", BASELINES)
def test_a_rule_of_others_does_not_see_what_comes_later(
    rollouts: tuple[Dataset, Rollouts], name: str
):
    dataset, flights = rollouts
    scores = BASELINES[name].fit(dataset)
    changed = flights.y.copy()
    changed[:, 61:] = 9.0
    np.testing.assert_array_equal(scores(flights.y)[:, :61], scores(changed)[:, :61])
    changed[:, 61:] = np.nan  # as after a failure in a dataset
    np.testing.assert_array_equal(scores(flights.y)[:, :61], scores(changed)[:, :61])


def test_boxes_equal_a_plain_search():
    rng = np.random.default_rng(1)
    x = np.cumsum(0.3 * rng.standard_normal((300, 3)), axis=0)
    boxes = boxes_twin(x, 0.5, 0.1)
    low, high = grow_boxes(x, 0.5, 0.1)
    assert 1 < len(low) < 200
    np.testing.assert_array_equal(low, [box[0] for box in boxes])
    np.testing.assert_array_equal(high, [box[1] for box in boxes])
    others = 4 * rng.standard_normal((50, 3))
    others[7, 1] = np.nan
    distances = box_distances(others, low, high)
    plain = [np.nan if k == 7 else distance_twin(row, boxes) for k, row in enumerate(others)]
    np.testing.assert_allclose(distances, plain, rtol=1e-12)
    assert (box_distances(x, low, high) == 0).all()


def test_least_squares_in_closed_form_equal_the_recursion():
    rng = np.random.default_rng(2)
    x, y, usual = (rng.standard_normal(shape) for shape in ((40, 5), (40, 3), (5, 3)))
    ours = recursive_estimates(x[np.newaxis], y[np.newaxis], usual)[0]
    np.testing.assert_allclose(ours, least_squares_twin(x, y, usual), rtol=1e-9, atol=1e-12)


def test_estimates_end_at_the_true_derivatives():
    rng = np.random.default_rng(3)
    x, true = rng.standard_normal((1, 4000, 5)), rng.standard_normal((5, 3))
    last = recursive_estimates(x, x @ true, np.zeros((5, 3)))[0, -1]
    np.testing.assert_allclose(last, true, atol=2e-3)


@pytest.mark.parametrize("name", BASELINES)
@pytest.mark.parametrize("guarantee", ["average", "95%"])
def test_a_rule_of_others_is_calibrated_as_it_is_flown(
    rollouts: tuple[Dataset, Rollouts], name: str, guarantee
):
    dataset, flights = rollouts
    scores, h, epsilons = BASELINES[name].fit(dataset), 5, EPSILONS[1 + (guarantee == "95%") :]

    def lowest(y: Array, last: int) -> float:
        return min((float(s) for s in scores(y[np.newaxis])[0, : last + 1]), default=np.inf)

    alphas = [
        lowest(y, int(f) - h) for y, f in zip(dataset.unsafe, dataset.fail_index, strict=True)
    ]
    above = {epsilon: epsilon for epsilon in epsilons}
    if guarantee == "95%":
        sure = {e: [j for j in range(1, 21) if beta.sf(e, j, 21 - j) <= 0.05] for e in epsilons}
        above = {epsilon: max(ranks) / 21 for epsilon, ranks in sure.items()}
    missed, false = np.zeros(len(epsilons)), np.zeros(len(epsilons))
    for y, fails in zip(flights.y, flights.fail_index, strict=True):
        is_unsafe = fails < len(y)
        s = lowest(y, int(fails) - h if is_unsafe else len(y) - 1)
        p = (1 + sum(alpha >= s for alpha in alphas)) / 21
        for k, epsilon in enumerate(epsilons):
            alert = p > above[epsilon] and s < np.inf
            missed[k] += is_unsafe and not alert
            false[k] += alert and not is_unsafe
    counts = evaluate_baseline(
        BASELINES[name], dataset, flights, replace(RECIPE, guarantee=guarantee), epsilons
    )
    np.testing.assert_array_equal(counts.misses, missed)
    np.testing.assert_array_equal(counts.false_alerts, false)
    assert counts.n_unsafe + counts.n_safe == 60


def test_the_safe_flights_lie_within_the_envelope_and_the_boxes(
    rollouts: tuple[Dataset, Rollouts],
):
    dataset = rollouts[0]
    for name in ("safe envelope", "inductive monitoring"):
        scores = BASELINES[name].fit(dataset)(dataset.safe)
        assert scores.min() >= -1.0 - 1e-12, name


def test_the_share_of_one_limit_is_the_papers_current_value(rollouts: tuple[Dataset, Rollouts]):
    dataset, flights = rollouts
    predictor, score = methods(DatasetRecipe())["current |Ny|"]
    monitor = train(dataset, replace(RECIPE, predictor=predictor, score=score))
    theirs = evaluate(monitor, flights.y, flights.fail_index, EPSILONS)
    ours = evaluate_baseline(CurrentShare(), dataset, flights, RECIPE, EPSILONS)
    np.testing.assert_array_equal(ours.misses, theirs.misses)
    np.testing.assert_array_equal(ours.false_alerts, theirs.false_alerts)


def test_a_dataset_that_a_rule_cannot_use_is_refused(rollouts: tuple[Dataset, Rollouts]):
    with pytest.raises(ValueError, match="beta, p, r, Ny"):
        BoundedDerivatives().fit(replace(rollouts[0], dictionary=LONGITUDINAL))
    with pytest.raises(ValueError, match="needs limits"):
        CurrentShare().fit(replace(rollouts[0], specification="labels"))
