"""Work on a cluster: the same bits as here, also where a worker is killed, and clear refusals."""

import os
import signal
import threading
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from app.cli import main
from app.jobs import cluster
from app.jobs.cluster import ClusterError, executor_at
from app.jobs.jobs import Jobs
from app.jobs.training import train_and_test
from app.store.store import open_store
from core.monitor import MonitorRecipe
from core.planned_test.collection import DatasetRecipe, SimulatedTest, collect
from core.planned_test.nonlinear_test import NonlinearTest
from tests.support.own_pitch import pitch, small_test
from tests.support.patience import until

RECIPE = replace(DatasetRecipe(), n_unsafe=200, n_obs=30)


@pytest.fixture
def nobody(monkeypatch: pytest.MonkeyPatch) -> str:
    """Where no scheduler answers."""
    pytest.importorskip("distributed", reason="Dask is not installed: forewarn[dask]")
    monkeypatch.setattr(cluster, "ANSWERS_S", 0.5)
    return "tcp://127.0.0.1:9"


def test_no_scheduler_is_this_machine() -> None:
    with executor_at(None) as executor:
        assert executor is None


def test_a_scheduler_that_does_not_answer_is_refused(
    nobody: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", "--scheduler", nobody]) == 1
    assert nobody in capsys.readouterr().err


def test_a_job_fails_with_the_reason_where_no_scheduler_answers(
    nobody: str, tmp_path: Path
) -> None:
    store = open_store(tmp_path / "forewarn.db")
    jobs = Jobs(store, scheduler=nobody)
    job = jobs.submit("test", {}, lambda _: {})
    until(lambda: jobs.info(job).status == "failed")
    assert nobody in (jobs.info(job).error or "")
    jobs.close()
    store.close()


@pytest.mark.services
def test_workers_of_another_version_are_refused(
    dask_cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "__version__", "0.0.1")
    with pytest.raises(ClusterError, match=r"has forewarn .*, this machine 0\.0\.1"):
        cluster.words_of(dask_cluster.scheduler_address)


@pytest.mark.services
def test_a_command_gives_the_same_table_as_here(dask_cluster: Any, tmp_path: Path) -> None:
    sizes = "--tests F-16 --leads 0.25 --n-unsafe 30 --n-monitors 2 --n-test 80 --epsilon 0.1"
    here, there = tmp_path / "here.csv", tmp_path / "there.csv"
    assert main(["sweep", *sizes.split(), "-o", str(here)]) == 0
    options = ["-o", str(there), "--scheduler", dask_cluster.scheduler_address]
    assert main(["sweep", *sizes.split(), *options]) == 0
    assert there.read_bytes() == here.read_bytes()


@pytest.mark.services
def test_a_killed_worker_changes_nothing(dask_cluster: Any) -> None:
    with executor_at(dask_cluster.scheduler_address) as executor:
        assert executor is not None
        victims = [executor.submit(os.getpid).result()]

        def kill(*_: int) -> None:
            if victims:
                os.kill(victims.pop(), signal.SIGKILL)

        digest = collect(RECIPE, executor=executor, progress=kill).digest()
        assert not victims
        assert digest == collect(RECIPE).digest()


@pytest.mark.services
def test_a_cancelled_job_leaves_the_cluster_to_others(dask_cluster: Any, tmp_path: Path) -> None:
    store = open_store(tmp_path / "forewarn.db")
    jobs = Jobs(store, scheduler=dask_cluster.scheduler_address)
    started = threading.Event()
    cancel = threading.Event()

    def work(task: Any) -> dict[str, Any]:
        executor: Executor = task.executor

        def reported(n_unsafe: int, n_made: int) -> None:
            started.set()
            cancel.wait()
            task.progress("simulating", n_unsafe, n_made)

        collect(replace(RECIPE, n_unsafe=5_000), executor=executor, progress=reported)
        return {}

    job = jobs.submit("test", {}, work)
    started.wait()
    jobs.cancel(job)
    cancel.set()
    until(lambda: jobs.info(job).status == "cancelled")
    jobs.close()
    store.close()
    with executor_at(dask_cluster.scheduler_address) as executor:
        assert executor is not None
        assert executor.submit(int, "7").result() == 7


@pytest.mark.services
@pytest.mark.parametrize("test", [small_test(pitch, n_unsafe=40), NonlinearTest(n_unsafe=40)])
def test_a_monitor_is_trained_on_a_cluster_as_here(dask_cluster: Any, test: SimulatedTest) -> None:
    plan = MonitorRecipe(epsilon=0.2), 100, lambda *_: None
    here = train_and_test(collect(test), *plan, test=test, choose=True).monitor
    with executor_at(dask_cluster.scheduler_address) as executor:
        dataset = collect(test, executor=executor)
        there = train_and_test(dataset, *plan, executor, test=test, choose=True).monitor
    assert there.to_bytes() == here.to_bytes()
