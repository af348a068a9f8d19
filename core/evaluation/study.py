"""The paper's experiment: miss rate and power of five methods, and of others, over epsilon."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import KEYS
from core.evaluation.baselines import baselines_for, evaluate_baseline
from core.evaluation.rates import EPSILONS, Evaluation, PooledCounts, evaluate
from core.monitor.calibration import smallest_epsilon
from core.monitor.monitor import Monitor
from core.monitor.predictor import PREDICTORS, Predictor
from core.monitor.recipe import MonitorRecipe
from core.monitor.score import SCORES, NegativeMagnitude, Score
from core.monitor.training import SafeObservations, train
from core.planned_test.collection import DatasetRecipe, Rollouts, collect
from core.planned_test.planned_test import ManeuverTest, needs_limits
from core.seeds import monitor_seeds
from core.tasks import Tasks
from core.types import Array

METHODS: dict[str, tuple[str, str]] = {
    "linear + nearest neighbor": ("linear", "nearest_neighbor"),
    "no prediction": ("identity", "nearest_neighbor"),
    "PCA": ("pca", "nearest_neighbor"),
    "current |Ny|": ("last_output", "negative_magnitude"),
    "predicted |Ny|": ("linear", "negative_magnitude"),
}
"""The paper's five methods as pairs of predictor and score."""


def methods(test: ManeuverTest) -> dict[str, tuple[Predictor, Score]]:
    """The five methods for a test; magnitudes use the channel of its first limit. Those of a
    nonlinear aircraft may have no limit on a lateral channel, so it has the three by neighbours."""
    if not isinstance(test, DatasetRecipe):
        pairs = {name: (PREDICTORS[of], SCORES[score]) for name, (of, score) in METHODS.items()}
        return {name: pair for name, pair in pairs.items() if pair[1].looks_up_neighbors}
    key = KEYS[int(np.isfinite(test.specification.magnitudes).argmax())]
    scores = SCORES | {"negative_magnitude": NegativeMagnitude(key)}  # type: ignore[arg-type]
    return {
        name.replace("Ny", key): (PREDICTORS[predictor], scores[score])
        for name, (predictor, score) in METHODS.items()
    }


@dataclass(frozen=True)
class StudyRecipe:
    """Size of the experiment."""

    dataset: ManeuverTest = DatasetRecipe()  # noqa: RUF009
    """planned test: its seed starts the whole study."""
    monitor: MonitorRecipe = MonitorRecipe(calibration="pointwise", scaling="raw")  # noqa: RUF009
    """settings of the monitors: everything except predictor and score. The defaults are the
    paper's."""
    n_monitors: Annotated[int, Bounds(least=1)] = 10
    """monitors of each method: each from its own dataset."""
    n_test: Annotated[int, Bounds(least=1)] = 500
    """fresh test flights of each monitor."""

    def __post_init__(self) -> None:
        check_bounds(self)
        needs_limits(self.dataset, "a study")


@dataclass(frozen=True, eq=False)
class MethodResult(PooledCounts):
    """One method's counts at each of epsilons (n_eps,); counts of flights are (n_monitors, 1)."""

    epsilons: Array

    @classmethod
    def pool(cls, evaluations: list[Evaluation]) -> "MethodResult":
        """Pool evaluations of several monitors, each on its own fresh flights."""
        return cls(
            epsilons=evaluations[0].epsilons,
            misses=np.array([e.misses for e in evaluations]),
            n_unsafe=np.array([[e.n_unsafe] for e in evaluations]),
            false_alerts=np.array([e.false_alerts for e in evaluations]),
            n_safe=np.array([[e.n_safe] for e in evaluations]),
        )

    @property
    def mean_power(self) -> float:
        """Power averaged over the epsilon grid: one number to rank methods by."""
        return float(self.power.mean())


@dataclass(frozen=True, eq=False)
class StudyResult:
    """Every method's counts, and an example.

    methods: by name, those of BASELINES too.   unsafe_rate: unbiased estimate from all collections.
    monitor, flights: the example: first monitor of the first method and its test flights.
    """

    recipe: StudyRecipe
    methods: dict[str, MethodResult]
    unsafe_rate: float
    monitor: Monitor
    flights: Rollouts

    @property
    def ranking(self) -> list[str]:
        """Methods by mean power, best first."""
        return sorted(self.methods, key=lambda name: -self.methods[name].mean_power)


Evaluations = dict[str, Evaluation]
Part = tuple[float, Evaluations, tuple[Monitor, Rollouts] | None]
"""Share of unsafe rollouts, evaluations by method, and of the first part the example."""


def study(
    recipe: StudyRecipe | None = None,
    *,
    executor: Executor | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> StudyResult:
    """Train n_monitors monitors of every method and fly fresh test flights through each.

    Published rules learn from the same rollouts and judge the same flights.

    executor: see Tasks.   progress: called with (monitors done, total); an exception cancels.
    """
    recipe = recipe or StudyRecipe()
    n_monitors = recipe.n_monitors
    seeds = monitor_seeds(recipe.dataset.seed, n_monitors)
    rates, example = [], None
    calibrated = list[Evaluations]()
    with Tasks(executor) as tasks:
        parts = tasks.results(_part, [(recipe, number, *each) for number, each in enumerate(seeds)])
        for number, (unsafe_rate, evaluated, shown) in enumerate(parts):
            rates.append(unsafe_rate)
            example = example or shown
            calibrated.append(evaluated)
            if progress:
                progress(number + 1, n_monitors)
    assert example
    return StudyResult(
        recipe=recipe,
        methods=_pooled(calibrated),
        unsafe_rate=float(np.mean(rates)),
        monitor=example[0],
        flights=example[1],
    )


def _pooled(evaluations: list[Evaluations]) -> dict[str, MethodResult]:
    return {
        name: MethodResult.pool([each[name] for each in evaluations]) for name in evaluations[0]
    }


def _part(recipe: StudyRecipe, number: int, seed: int, test_seed: int) -> Part:
    """One dataset, its monitors by every method, and all evaluated on the same flights."""
    dataset = collect(replace(recipe.dataset, seed=seed))
    rng = np.random.default_rng(test_seed)
    flights = recipe.dataset.simulator().rollouts(recipe.n_test, rng)
    epsilons = EPSILONS[
        smallest_epsilon(recipe.dataset.n_unsafe, recipe.monitor.guarantee) - 1e-9 <= EPSILONS
    ]
    safe = SafeObservations(dataset, recipe.monitor)
    compared = methods(recipe.dataset)
    monitors = [
        train(dataset, replace(recipe.monitor, predictor=predictor, score=score), safe=safe)
        for predictor, score in compared.values()
    ]
    evaluated = {
        name: evaluate(monitor, flights.y, flights.fail_index, epsilons)
        for name, monitor in zip(compared, monitors, strict=True)
    }
    for name, baseline in baselines_for(dataset.dictionary).items():
        evaluated[name] = evaluate_baseline(baseline, dataset, flights, recipe.monitor, epsilons)
    example = None if number else (monitors[0], flights)
    return dataset.unsafe_rate, evaluated, example
