"""What the tests share: how Hypothesis runs, and one small dataset."""

import app  # noqa: F401  # isort: skip  # before numpy, which then reads how many threads to use

import gc
import os
import shutil
import ssl
from collections.abc import Generator, Iterator
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from app.jobs import requests, training
from app.store import disk
from app.telemetry.readers import isolation, worker
from core.dataset import Dataset
from core.evaluation import lead_sweep, robustness
from core.monitor import Monitor, peak_ridge
from core.monitor.validity import support
from core.planned_test import amplitude, collection
from tests.support import oscillator
from tests.support.attas import trained
from tests.support.patience import PATIENCE
from tests.support.postgresql import PostgreSQL, running
from tests.support.repetition import IS_CAMPAIGN, examples

CARRY_OUT, WARM_UP = isolation.carry_out, isolation.warm_up
LONG = (
    "fuzzing/test_readers.py",
    "core/clearance/",
    "core/test_every_promise.py",
    "studies/",
    "app/assessment/test_hostile_messages.py",
    "core/evaluation/test_robustness.py",
    "core/test_guarantee.py",
    "fuzzing/",
    "test_guide.py",
    "app/test_openapi.py",
    "app/routes/test_campaigns.py",
    "app/commands/",
    "core/monitor/",
)
"""Files and folders that take longest, in the campaign or in the tests."""
MOVED = [name for name in LONG if not (Path(__file__).parent / name).exists()]
assert not MOVED, f"{MOVED} are not there: correct LONG"

settings.register_profile(
    "forewarn",
    deadline=None,
    max_examples=examples(100),
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],  # no test fails by the clock
)
settings.load_profile("forewarn")

NO_CERTIFICATES = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
"""A call by itself would read all of the machine's: 26 ms. No test speaks TLS."""
for verb in ("get", "post", "put", "delete", "request"):
    call = partial(getattr(httpx2, verb), timeout=PATIENCE, verify=NO_CERTIFICATES)
    setattr(httpx2, verb, call)


MEMORY, ROOM = Path("/dev/shm"), 8 * 2**30
"""Where Linux keeps files in memory; the tests write up to 2 GB."""


def pytest_configure() -> None:
    """Keep the tests' files in memory, where programs may be started from there.

    A durable write takes 5 ms on a disk, and the tests make tens of thousands.
    """
    if (
        MEMORY.is_dir()
        and shutil.disk_usage(MEMORY).free > ROOM
        and not os.statvfs(MEMORY).f_flag & os.ST_NOEXEC
    ):
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep the garbage collector off the modules and tests that are there to the end.

    Going through what is kept each time something is added is a third of a collection's time.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the browser tests: those of one worker share a browser. Then come long files.

    At the end no worker is to wait for another that has a long file left. Tests of faults wait for
    other processes most of the time: each of their files comes just before one that computes. The
    campaign's longest file takes about as long as all others, and comes first.
    """
    first = ("browser/", "faults/", *LONG)
    files: dict[str, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.nodeid.partition("::")[0].partition("/")[2], []).append(item)

    def place(file: str) -> int:
        return next((i for i, name in enumerate(first) if file.startswith(name)), len(first))

    browser, waiting, computing = [], [], []
    campaign = [file for file in files if IS_CAMPAIGN and file.startswith(LONG[0])]
    for file in sorted((file for file in files if file not in campaign), key=place):
        {0: browser, 1: waiting}.get(place(file), computing).append(file)
    mixed = [file for pair in zip_longest(waiting, computing) for file in pair if file]
    items[:] = [item for file in campaign + browser + mixed for item in files[file]]


@pytest.fixture(scope="session")
def dataset() -> "Dataset":
    """Twelve failures of the oscillator, and the safe flights met on the way."""

    return oscillator.collect(np.random.default_rng(11), n_unsafe=12)


@pytest.fixture(scope="session")
def flights() -> np.ndarray:
    """Twenty fresh flights (20, 61, 6), failed and safe."""

    return oscillator.fly(np.random.default_rng(12), 20)[1]


@pytest.fixture(scope="session")
def attas() -> "Monitor":
    """A transport's monitor for a rudder doublet, its validity calibrated."""

    return trained()


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The application in process, with a data directory that the tests of a file share."""
    from tests.support.api import api

    with api(tmp_path_factory.mktemp("data")) as client:
        yield client


@pytest.fixture(scope="session")
def dask_cluster() -> Iterator[Any]:
    """Two processes with one thread each."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: forewarn[dask]")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster:
        yield cluster


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """A server of this machine's PostgreSQL, with nothing in it."""
    with running() as server:
        yield server


@pytest.fixture(scope="session", autouse=True)
def hold_little() -> Iterator[None]:
    """A server here holds the least reserve: writing the full one is a third of its start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(disk, "RESERVE_BYTES", disk.LEAST_BYTES)
        yield


@pytest.fixture(scope="module")
def few_flights() -> Iterator[None]:
    """In a module that shows how training goes, not how well, fewer flights than a user's."""
    fewer = partial(collection.training_rollouts, n=400)
    with pytest.MonkeyPatch.context() as patch:
        for module in (training, lead_sweep):
            patch.setattr(module, "training_rollouts", fewer)
        patch.setattr(training, "CHOICE_FLIGHTS", 300)
        patch.setattr(requests, "N_TEST", 300)
        patch.setattr(collection, "FIRST_CHUNK", 64)
        patch.setattr(collection, "CHUNKS_AHEAD", 1)
        patch.setattr(collection, "FRESH_BATCH", 200)
        patch.setattr(support, "LEAST", 50)
        patch.setattr(support, "LEVEL", support.WORST_LEVEL)
        patch.setattr(robustness, "N_NEAR", 15)
        patch.setattr(amplitude, "PILOT_STEPS", 0)
        patch.setattr(peak_ridge, "MOST_FLIGHTS", 400)
        yield


@pytest.fixture(scope="session")
def apart() -> dict[str, Any]:
    """How the program has files read: each in a separate process."""
    from app.telemetry.readers import isolation

    return {name: getattr(isolation, name) for name in ("carry_out", "warm_up")}


@pytest.fixture(scope="session", autouse=True)
def read_here(apart: dict[str, Any]) -> Iterator[None]:
    """Files are read in the tests' own process: by the same code, and sooner."""
    from app.telemetry.readers import isolation

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(isolation, "carry_out", worker.read)
        patch.setattr(isolation, "warm_up", lambda: None)
        yield


@pytest.fixture(scope="module")
def read_apart(apart: dict[str, Any]) -> Iterator[None]:
    """From here to the end of a module, each file is read in a separate process, as a user's."""
    from app.telemetry.readers import isolation

    with pytest.MonkeyPatch.context() as patch:
        for name, function in apart.items():
            patch.setattr(isolation, name, function)
        yield
