"""A process killed with -9 while it writes: the store opens clean, nothing it said is missing."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from app.store.store import open_store
from app.store.tables import (
    datasets,
)
from core.dataset import Dataset
from core.monitor import Monitor, train
from tests.support.places import ROOT
from tests.support.stored import assert_says_its_number, count


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "kept here" / "50 %" / "forewarn.db"


@pytest.fixture(scope="module")
def trained(dataset: Dataset) -> Monitor:
    return train(dataset)


WRITER = """
import os, signal, sys
from concurrent.futures import ThreadPoolExecutor
import numpy as np
from sqlalchemy import event
from app.store import repository
from app.store import arrays as stored_arrays
from app.store.store import open_store
from tests.support import oscillator
from tests.support.stored import append

path, last_statement = sys.argv[1], int(sys.argv[2])
stored_arrays.BLOCK_BYTES, repository.TRANSACTION_BYTES = 10_000, 50_000
store = open_store(path)
n_statements = 0

@event.listens_for(store.engine, "after_cursor_execute")
def die(*_):
    global n_statements
    n_statements += 1
    if n_statements == last_statement:
        os.kill(os.getpid(), signal.SIGKILL)

def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\\n")
    sys.stdout.flush()

def collect(job):
    store.jobs.update(job, "running")
    for k in range(2 if last_statement else 1_000_000):
        say("dataset", store.datasets.add(dataset, f"d{k}").id)

def fly(flight):
    for first in range(0, 150 if last_statement else 10**9, 50):
        append(store, flight, first, 50)
        say("stored", flight, first + 49)

dataset = oscillator.collect(np.random.default_rng(11), 12)
job = store.jobs.add("collect", {})
flights = [store.flights.add({}, store.monitors.all()[0].id, 0.1) for _ in range(2)]
say("ids", job, *flights)
if last_statement:
    collect(job)
    for flight in flights:
        fly(flight)
    say("statements", n_statements)
else:
    with ThreadPoolExecutor(3) as pool:
        for work in [pool.submit(collect, job), *(pool.submit(fly, f) for f in flights)]:
            work.result()
"""


def writer(path: Path, last_statement: int) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), str(last_statement)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )


def assert_clean(path: Path, said: list[list[str]], dataset: Dataset) -> None:
    """All that the writer said was stored is there, and what is half stored is not."""
    store = open_store(path)
    assert store.damage() == []
    known = {info.id for info in store.datasets.all()}
    assert {words[1] for words in said if words[0] == "dataset"} <= known
    assert count(store, datasets) == len(known)
    for dataset_id in list(known)[:3]:
        assert store.datasets.get(dataset_id).digest() == dataset.digest()
    for job in store.jobs.all():
        assert job.status == "interrupted"
    heads = {words[1]: int(words[2]) for words in said if words[0] == "stored"}
    for flight in store.flights.all():
        assert flight.status == "interrupted"
        n = len(store.flights.assessments(flight.id))
        assert n % 50 == 0
        assert n > heads.get(flight.id, -1)
        assert_says_its_number(store.flights.assessments(flight.id), np.arange(n))
    store.datasets.add(dataset, "after")
    store.close()


def test_a_writer_killed_at_any_statement_leaves_a_clean_store(
    path: Path, dataset: Dataset, trained: Monitor
) -> None:
    first = open_store(path)
    first.monitors.add(trained, "m")
    first.close()
    with writer(path, 10**9) as unhurt:
        said = [line.split() for line in unhurt.stdout or ()]
    assert unhurt.returncode == 0
    assert said[-1][0] == "statements"
    assert_clean(path, said, dataset)
    for last_statement in np.linspace(2, int(said[-1][1]), 5).astype(int):
        with writer(path, last_statement) as killed:
            said = [line.split() for line in killed.stdout or ()]
        assert killed.returncode == -signal.SIGKILL
        assert_clean(path, said, dataset)


@pytest.mark.parametrize("n_lines", [10, 41])
def test_threads_killed_at_any_moment_leave_a_clean_store(
    path: Path, dataset: Dataset, trained: Monitor, n_lines: int
) -> None:
    first = open_store(path)
    first.monitors.add(trained, "m")
    first.close()
    with writer(path, 0) as killed:
        assert killed.stdout is not None
        said = [killed.stdout.readline().split() for _ in range(n_lines)]
        killed.kill()
        said += [line.split() for line in killed.stdout if line.endswith("\n")]
    assert killed.returncode == -signal.SIGKILL
    assert_clean(path, said, dataset)
