"""A long sweep on two Dask workers, against the same on two processes."""

from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from itertools import count
from multiprocessing import get_context
from typing import Any

import pytest

from core.evaluation.lead_sweep import SweepRecipe, sweep
from tests.benchmarks.pairs import in_turns

pytestmark = [pytest.mark.benchmark, pytest.mark.services]
RECIPE = SweepRecipe(tests=("F-16",), leads_s=(0.25, 0.5), n_monitors=2, n_test=500)
"""About five seconds on two cores; it is swept ten times."""


@pytest.fixture
def two_processes() -> Iterator[Executor]:
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        yield executor


def test_two_workers_are_as_fast_as_two_processes(
    dask_cluster: Any, two_processes: Executor
) -> None:
    seeds = count()
    with dask_cluster.get_client() as client:
        workers = client.get_executor(pure=False)

        def there() -> None:
            sweep(replace(RECIPE, seed=next(seeds)), executor=workers)

        def here() -> None:
            sweep(replace(RECIPE, seed=next(seeds)), executor=two_processes)

        pair = in_turns(here, there, warm=False)
    print(f"\nsweep on two processes {pair.ours.min():.1f} s, on two Dask workers {pair}")
