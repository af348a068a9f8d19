"""A process killed with -9 as it writes: the store opens clean, with all that it reported."""

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.store.store import open_store
from app.store.tables import datasets
from core.dataset import Dataset
from core.monitor import Monitor
from tests.support.store_writer import remaining, start, write_at_once, write_in_turn
from tests.support.stored import assert_says_its_number, count

N_KILLS = 8


def assert_clean(path: Path, received: list[tuple[Any, ...]], dataset: Dataset) -> None:
    """All that the writer reported as stored is there, and what is half stored is not."""
    store = open_store(path)
    assert store.damage() == []
    known = {info.id for info in store.datasets.all()}
    assert {words[1] for words in received if words[0] == "dataset"} <= known
    assert count(store, datasets) == len(known)
    for dataset_id in list(known)[:3]:
        assert store.datasets.get(dataset_id).digest() == dataset.digest()
    for job in store.jobs.all():
        assert job.status == "interrupted"
    heads = {words[1]: words[2] for words in received if words[0] == "stored"}
    for flight in store.flights.all():
        assert flight.status == "interrupted"
        n = len(store.flights.assessments(flight.id))
        assert n % 50 == 0
        assert n > heads.get(flight.id, -1)
        assert_says_its_number(store.flights.assessments(flight.id), np.arange(n))
    store.datasets.add(dataset, "after")
    store.close()


@pytest.fixture
def path(tmp_path: Path, trained: Monitor) -> Path:
    """A store that holds a monitor."""
    path = tmp_path / "forewarn.db"
    store = open_store(path)
    store.monitors.add(trained, "m")
    store.close()
    return path


def test_a_writer_killed_at_any_statement_leaves_a_clean_store(
    path: Path, dataset: Dataset
) -> None:
    unhurt, reports = start(write_in_turn, path, None)
    received = remaining(unhurt, reports)
    assert unhurt.exitcode == 0
    (_, n_statements) = received[-1]
    assert_clean(path, received, dataset)
    for last_statement in np.linspace(2, n_statements, N_KILLS).astype(int):
        killed, reports = start(write_in_turn, path, int(last_statement))
        received = remaining(killed, reports)
        assert killed.exitcode == -signal.SIGKILL
        assert_clean(path, received, dataset)


@pytest.mark.parametrize("n_reports", [9, 40])
def test_threads_killed_at_any_moment_leave_a_clean_store(
    path: Path, dataset: Dataset, n_reports: int
) -> None:
    killed, reports = start(write_at_once, path)
    received = [reports.recv() for _ in range(n_reports)]
    killed.kill()
    received += remaining(killed, reports)
    assert killed.exitcode == -signal.SIGKILL
    assert_clean(path, received, dataset)
