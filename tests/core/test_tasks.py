"""Long computations give the same bits on threads, processes and a cluster."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import astuple, replace
from functools import cache
from multiprocessing import get_context
from threading import Event
from typing import Any

import numpy as np
import pytest

from core.clearance import with_monitor as with_monitor_module
from core.clearance.clearance import Clearance, ClearanceRecipe, calibrate
from core.evaluation.lead_sweep import TESTS, SweepRecipe, sweep
from core.evaluation.study import StudyRecipe, study
from core.planned_test.collection import (
    DatasetRecipe,
    collect,
    combination_failures,
    evaluation_flights,
    fresh,
    training_rollouts,
)
from core.tasks import Tasks, stop_if_cancelled
from tests.support.build_up import build_up
from tests.support.own_pitch import pitch, small_test

DATASET = replace(DatasetRecipe(), n_unsafe=30, n_obs=30, max_safe=50)
SWEEP = SweepRecipe(
    tests=("F-16",),
    leads_s=(0.25, 0.5),
    methods=("linear + nearest neighbor", "test card: rest"),
    epsilon=0.1,
    n_unsafe=30,
    n_monitors=2,
    n_test=80,
)
CLEARANCE = ClearanceRecipe(epsilon=0.1, n_exceeding=20, n_aircraft=100, n_draws=8, seed=3)


def _clearance(executor: Executor | None) -> Clearance:
    points = build_up(TESTS["ATTAS"], (0.6,))
    return calibrate(points, CLEARANCE, executor=executor)


@cache
def _calibrated() -> Clearance:
    return _clearance(None)


def _studied(executor: Executor | None) -> Any:
    recipe = StudyRecipe(dataset=DATASET, n_monitors=2, n_test=60)
    result = study(recipe, executor=executor)
    counted = {name: vars(method) for name, method in result.methods.items()}
    return counted, result.unsafe_rate, result.monitor.alphas, result.flights


def _swept(executor: Executor | None) -> Any:
    return {
        name: (each.cells, each.unsafe_share)
        for name, each in sweep(SWEEP, executor=executor).items()
    }


def _own(executor: Executor | None) -> Any:
    """Every batch of flights of an own simulator."""
    test = small_test(pitch)
    failures, n_made = combination_failures(test, 15, executor=executor)
    tested, learned = (
        fly(test, 600, executor=executor) for fly in (evaluation_flights, training_rollouts)
    )
    checked = [*fresh(test, 600, executor)]
    return collect(test, executor=executor).digest(), failures, n_made, tested, learned, checked


JOBS: dict[str, Callable[[Executor | None], Any]] = {
    "collection": lambda executor: collect(DATASET, executor=executor).digest(),
    "own simulator": _own,
    "study": _studied,
    "sweep": _swept,
    "clearance": lambda executor: astuple(_clearance(executor))[2:],
    "clearance with a monitor": lambda executor: (
        with_monitor_module.with_monitor(_calibrated(), executor=executor).risks
    ),
}


def bits(result: Any) -> Any:
    """A result with its arrays as bytes, to compare."""
    if isinstance(result, np.ndarray):
        return result.shape, result.tobytes()
    if isinstance(result, dict):
        return {key: bits(value) for key, value in result.items()}
    if isinstance(result, tuple | list):
        return [bits(each) for each in result]
    if hasattr(result, "__dataclass_fields__"):
        return bits(vars(result))
    return result


@cache
def here(job: str) -> Any:
    return bits(JOBS[job](None))


@pytest.fixture(scope="module")
def one_thread() -> Iterator[Executor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.fixture(scope="module")
def two_processes() -> Iterator[Executor]:
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        yield executor


@pytest.fixture(scope="module")
def cluster(dask_cluster: Any) -> Iterator[Executor]:
    with dask_cluster.get_client() as client:
        yield client.get_executor(pure=False)


@pytest.mark.parametrize(
    "executor",
    ["one_thread", "two_processes", pytest.param("cluster", marks=pytest.mark.services)],
)
@pytest.mark.parametrize("job", JOBS)
def test_every_executor_gives_the_same_bits(
    job: str, executor: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(with_monitor_module, "N_POINTS", 1)
    assert bits(JOBS[job](request.getfixturevalue(executor))) == here(job)


def test_tasks_that_have_not_begun_are_cancelled_at_the_end(one_thread: Executor) -> None:
    gate = Event()
    with Tasks(one_thread) as tasks:
        futures = [tasks.submit(gate.wait) for _ in range(5)]
    gate.set()
    assert [future.cancelled() for future in futures[1:]] == [True] * 4


def test_a_task_on_this_machine_stops_when_its_computation_is_cancelled() -> None:
    begun = Event()

    def endless() -> None:
        begun.set()
        while True:
            stop_if_cancelled()

    with Tasks() as tasks:
        future = tasks.submit(endless)
        begun.wait()
    assert isinstance(future.exception(), InterruptedError)


def test_results_come_in_order_and_few_are_computed_ahead() -> None:
    asked = iter(range(1_000_000))
    with Tasks() as tasks:
        results = tasks.results(int, ((k,) for k in asked), ahead=3)
        assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
    assert next(asked) <= 9
