"""Near and foreign aircraft, and softer inputs: what monitors miss outside their training.

Each monitor of a planned test flies aircraft drawn from its own distribution, aircraft whose
derivatives are each multiplied by a random factor, pilots with softer inputs, and another type. A
failure counts as missed unless an alert or a withdrawal came in time, and every aircraft weighs the
same.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from core.evaluation import lead_sweep
from core.evaluation.lead_sweep import TESTS
from core.evaluation.rates import clustered_interval, evaluate
from core.evaluation.robustness import MOST_FAILURES
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.calibration import Guarantee
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from core.planned_test.collection import card_of, collect, combination_failures, fresh
from core.planned_test.near import (
    FLIGHTS_EACH,
    fly_each,
    near_aircraft,
    near_failures,
    near_rollouts,
    retuned,
    softer,
)
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.seeds import Branch, stream
from core.types import Array
from tests.studies.study_command import Progress, run_study

PLANNED = "neighbors + peaks, planned"
METHODS = lead_sweep.METHODS | {PLANNED: (PREDICTORS["ensemble"], SCORES["highest_risk"])}
"""Compared methods; the default, also with the scope planned."""
SHOWN = "linear + nearest neighbor", "peaks ahead: rest", "neighbors + peaks"
"""Methods in the guide's table; the last one is the default of training."""


@dataclass(frozen=True)
class NearRecipe:
    """The monitors, and the number of aircraft of each kind."""

    tests: tuple[str, ...] = tuple(TESTS)
    """planned tests, by name"""
    methods: tuple[str, ...] = tuple(METHODS)
    """methods, by name"""
    factors: tuple[float, ...] = (1.25, 1.5, 2.0)
    """factors on the derivatives"""
    lags_s: tuple[float, ...] = (0.2, 0.3, 0.5)
    """pedal lags"""
    n_monitors: int = 1
    """monitors of each test and method, each from its own dataset"""
    n_unsafe: int = 500
    """unsafe rollouts for training each monitor"""
    n_aircraft: int = 120
    """aircraft of each kind and monitor"""
    most_failures: int = 60
    """failing flights of each aircraft that are counted, at most"""
    epsilon: float = 0.1
    """promised miss rate"""
    guarantee: Guarantee = "95%"
    """promise on the miss rate"""
    seed: int = 9
    """seed of every random draw"""

    def __post_init__(self) -> None:
        for names, among in ((self.tests, TESTS), (self.methods, METHODS)):
            if unknown := [name for name in names if name not in among]:
                raise ValueError(f"{unknown[0]!r} is unknown; there are {', '.join(among)}")
        for name in ("n_monitors", "n_unsafe", "n_aircraft", "most_failures"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}={getattr(self, name)} was given: give 1 or more")


class Flown(NamedTuple):
    """A kind of aircraft or input: its test, and the theta of its aircraft."""

    kind: str
    simulator: LateralSimulator
    theta: Array


@dataclass(frozen=True)
class Row:
    """Aircraft of one kind through all monitors of one method.

    n_aircraft: those with failures.   missed: mean over aircraft of the share of failures without
    an alert or a withdrawal in time, with its 95 % interval.   worst_misses, worst_failures: of the
    worst aircraft with at least half of the failures asked for.   quiet: share of safe flights,
    valid and without an alert.
    """

    test: str
    method: str
    kind: str
    n_aircraft: int
    n_failing: int
    missed: float
    missed_low: float
    missed_high: float
    worst_misses: int
    worst_failures: int
    withdrawn: float
    n_safe: int
    quiet: float


def study(recipe: NearRecipe, progress: Progress | None = None) -> Iterator[Row]:
    """Train the monitors of each test and fly every kind through them.

    progress: called with (monitors done, total).
    """
    total = len(recipe.tests) * recipe.n_monitors
    for at, test in enumerate(recipe.tests):
        counts: dict[tuple[str, str], list[Any]] = {}
        for number in range(recipe.n_monitors):
            if progress:
                progress(at * recipe.n_monitors + number, total)
            position = tuple(TESTS).index(test)
            seed = stream(recipe.seed, Branch.PAIRS, position, number).integers(2**32)
            planned = replace(TESTS[test].as_trained(), n_unsafe=recipe.n_unsafe, seed=int(seed))
            monitors = _monitors(recipe, planned)
            rng = stream(planned.seed, Branch.ROBUSTNESS)
            most = recipe.most_failures
            for kind, simulator, theta in _flown(recipe, planned, test, rng):
                flown = FLIGHTS_EACH * most // MOST_FAILURES, most, most // MOST_FAILURES
                flights, aircraft = fly_each(simulator, theta, rng, *flown)
                for method, monitor in monitors.items():
                    found = evaluate(
                        monitor, flights.y, flights.fail_index, np.array([recipe.epsilon]), aircraft
                    )
                    counts.setdefault((method, kind), []).append(found)
        for (method, kind), each in counts.items():
            yield _row(test, method, kind, each, recipe.most_failures)


def _monitors(recipe: NearRecipe, planned: DatasetRecipe) -> dict[str, Monitor]:
    dataset, flights, monitors = collect(planned), list(fresh(planned)), {}
    failures, _ = combination_failures(planned, recipe.n_unsafe, branch=Branch.ENSEMBLE)
    rollouts, populations = near_rollouts(planned), near_failures(planned, recipe.n_unsafe)
    for name in recipe.methods:
        predictor, score = METHODS[name]
        card = card_of(planned) if predictor.forecast == "card" else None
        method = MonitorRecipe(
            epsilon=recipe.epsilon, guarantee=recipe.guarantee, predictor=predictor, score=score
        )
        near = {"rollouts": rollouts, "near": populations} if method.is_near else {}
        monitors[name] = train(dataset, method, flights, card=card, failures=failures, **near)
    return monitors


def _flown(
    recipe: NearRecipe, planned: DatasetRecipe, test: str, rng: np.random.Generator
) -> Iterator[Flown]:
    simulator, n = LateralSimulator(planned), recipe.n_aircraft
    yield Flown("own", simulator, simulator.plant.sample(n, rng))
    yield Flown("nominal", simulator, near_aircraft(simulator.parameters, 1.0, n, rng))
    for factor in recipe.factors:
        theta = near_aircraft(simulator.parameters, factor, n, rng)
        yield Flown(f"factor {factor:g}", simulator, theta)
    for lag_s in recipe.lags_s:
        simulator = LateralSimulator(softer(planned, lag_s))
        yield Flown(f"lag {lag_s:g} s", simulator, simulator.plant.sample(n, rng))
    other = tuple(TESTS)[(tuple(TESTS).index(test) + 1) % len(TESTS)]
    simulator = LateralSimulator(retuned(replace(planned, aircraft=TESTS[other].aircraft)))
    yield Flown("other type", simulator, simulator.plant.sample(n, rng))


def _row(test: str, method: str, kind: str, counts: Sequence[Any], most_failures: int) -> Row:
    """Pool the aircraft of several monitors."""
    failures = np.concatenate([found.failures_of for found in counts])
    misses = np.concatenate([found.misses_of[:, 0] for found in counts])
    shares, each = misses / np.maximum(failures, 1), max(float(failures.mean()), 1.0)
    low, high = clustered_interval(each * shares, np.full(len(shares), each))
    worst = int(np.where(failures >= most_failures / 2, shares, -1.0).argmax())
    n_failing, n_safe = (
        sum(getattr(found, name) for found in counts) for name in ("n_unsafe", "n_safe")
    )
    return Row(
        test,
        method,
        kind,
        n_aircraft=len(failures),
        n_failing=n_failing,
        missed=float(shares.mean()),
        missed_low=float(low),
        missed_high=float(high),
        worst_misses=int(misses[worst]),
        worst_failures=int(failures[worst]),
        withdrawn=sum(int(found.withdrawn[0]) for found in counts) / max(n_failing, 1),
        n_safe=n_safe,
        quiet=sum(int(found.quiet[0]) for found in counts) / max(n_safe, 1),
    )


def in_words(rows: Sequence[Row], _: object = None) -> str:
    """One line a row."""
    head = (
        f"{'test':7} {'method':26} {'kind':11} {'aircraft':>8} {'failing':>7}   "
        f"{'missed in time, 95 %':22} {'worst':>7} {'invalid':>7} {'quiet':>6}"
    )
    return "\n".join([head, *map(_line, rows)])


def _line(row: Row) -> str:
    missed = f"{row.missed:.3f} [{row.missed_low:.3f}, {row.missed_high:.3f}]"
    worst = f"{row.worst_misses} of {row.worst_failures}"
    return (
        f"{row.test:7} {row.method:26} {row.kind:11} {row.n_aircraft:8} {row.n_failing:7}   "
        f"{missed:22} {worst:>7} {row.withdrawn:7.1%} {row.quiet:6.1%}"
    )


if __name__ == "__main__":
    run_study(NearRecipe, study, in_words, asdict)
