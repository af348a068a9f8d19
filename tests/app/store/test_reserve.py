"""The reserve: space to delete with, and what waits until the disk takes writes again."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from app.store import disk as module
from app.store.disk import RESERVE_BYTES
from app.store.repository import NotFound
from app.store.store import Store, StoreError, open_store
from core.monitor import Monitor
from tests.support.stored import flown


class Usage(NamedTuple):
    total: int
    used: int
    free: int


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Let the disk be short of space from now on."""

    def now() -> None:
        monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(2**30, 2**30, 4096))

    return now


@pytest.mark.parametrize("url", ["sqlite"], indirect=True)
def test_the_reserve_is_of_a_size_and_private(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "RESERVE_BYTES", RESERVE_BYTES)  # tests hold less
    store.reserve.make()
    path = store.reserve.path
    assert path is not None
    assert path.stat().st_size == RESERVE_BYTES
    assert path.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("url", ["sqlite"], indirect=True)
def test_a_deletion_on_a_short_disk_frees_the_reserve_and_makes_it_again(
    store: Store, trained: Monitor, short: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = flown(store, trained)
    store.flights.end(flight)
    store.reserve.make()
    path = store.reserve.path
    assert path is not None
    seen: list[bool] = []
    monkeypatch.setattr(module, "checkpoint", lambda engine: seen.append(path.exists()))
    store.flights.delete(flight)
    assert seen == []
    short()
    with pytest.raises(NotFound):
        store.flights.delete("0123456789ab")
    assert seen == [False]
    assert path.exists()


def test_a_failed_clean_up_happens_before_the_next_write(
    path: Path, trained: Monitor, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    dying = open_store(path)
    flight = flown(dying, trained)
    dying.close()

    def full(*_: object) -> None:
        raise StoreError("the disk is full")

    with monkeypatch.context() as broken:
        broken.setattr("app.store.flights.FlightRepository.recover", full)
        again = open_store(path)
        assert "read-only" in caplog.text
        assert again.flights.info(flight).status == "running"
        with pytest.raises(StoreError, match="full"):
            again.jobs.add("a", {})
    again.jobs.add("a", {})
    assert again.flights.info(flight).status == "interrupted"
    assert [job.status for job in again.jobs.all()] == ["queued"]
    again.close()
