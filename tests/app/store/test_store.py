"""The store: what is in use stays, what is gone is gone, what was under way is interrupted."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import create_engine

from app.store.database import address, reading
from app.store.flights import FlightInProgress
from app.store.monitors import MonitorInfo
from app.store.store import InUse, NotFound, Store, StoreError, open_store
from app.store.tables import (
    dataset_blocks,
    datasets,
    metadata,
    monitor_parts,
    monitors,
)
from core.dataset import Dataset
from core.monitor import Monitor
from tests.support.stored import alarm, append, assert_says_its_number, count, flown


def test_a_dataset_in_use_stays_and_names_its_monitors(
    store: Store, dataset: Dataset, trained: Monitor
) -> None:
    dataset_id = store.datasets.add(dataset, "doublets").id
    used_by = [store.monitors.add(trained, name, dataset_id) for name in ("early", "late")]
    with pytest.raises(InUse, match=r"is used by early \(.*\), late \(") as refused:
        store.datasets.delete(dataset_id)
    assert refused.value.users == tuple((info.name, info.id) for info in used_by)
    assert store.datasets.get(dataset_id).digest() == dataset.digest()
    for info in used_by:
        store.monitors.delete(info.id)
    store.datasets.delete(dataset_id)
    assert [count(store, table) for table in (datasets, dataset_blocks, monitors)] == [0, 0, 0]
    assert count(store, monitor_parts) == 0


def test_a_monitor_that_flew_stays_and_names_its_flights(store: Store, trained: Monitor) -> None:
    flight = flown(store, trained)
    append(store, flight, 0, 10)
    store.alarms.add(flight, alarm(1, 3, 0.06))
    monitor_id = store.flights.info(flight).monitor_id
    with pytest.raises(InUse, match=f"monitor m is used by running flight .{flight}."):
        store.monitors.delete(monitor_id)
    with pytest.raises(FlightInProgress, match="in progress: end it"):
        store.flights.delete(flight)
    store.flights.end(flight)
    store.flights.delete(flight)
    store.monitors.delete(monitor_id)
    left = [count(store, table) for name, table in metadata.tables.items() if name != "answers"]
    assert left == [0] * len(left)


MISSING: dict[str, Callable[[Store], Any]] = {
    "dataset": lambda s: s.datasets.get("x"),
    "dataset_info": lambda s: s.datasets.info("x"),
    "rollout": lambda s: s.datasets.rollout("x", "safe", 0),
    "delete_dataset": lambda s: s.datasets.delete("x"),
    "monitor": lambda s: s.monitors.get("x"),
    "monitor_info": lambda s: s.monitors.info("x"),
    "monitor_file": lambda s: s.monitors.file("x"),
    "evaluation": lambda s: s.monitors.evaluation("x"),
    "delete_monitor": lambda s: s.monitors.delete("x"),
    "job": lambda s: s.jobs.info("x"),
    "update_job": lambda s: s.jobs.update("x", "running"),
    "add_flight": lambda s: s.flights.add({}, "x", 0.1),
    "flight": lambda s: s.flights.info("x"),
    "end_flight": lambda s: s.flights.end("x"),
    "delete_flight": lambda s: s.flights.delete("x"),
    "append": lambda s: append(s, "x", 0, 1),
    "assessments": lambda s: s.flights.assessments("x"),
    "add_alarm": lambda s: s.alarms.add("x", alarm(1, 0, 0.0)),
    "acknowledge_alarm": lambda s: s.alarms.acknowledge("x", 1, "me"),
    "alarms": lambda s: s.alarms.of("x"),
}


@pytest.mark.parametrize("call", MISSING.values(), ids=MISSING)
def test_what_is_not_there_is_not_found(store: Store, call: Callable[[Store], Any]) -> None:
    with pytest.raises(NotFound, match=r"there is no [a-z]+ 'x'"):
        call(store)


def test_a_job_keeps_its_progress_and_how_it_ended(store: Store) -> None:
    job_id = store.jobs.add("train", {"n_unsafe": 50})
    waiting = store.jobs.info(job_id)
    assert (waiting.status, waiting.request, waiting.started) == ("queued", {"n_unsafe": 50}, None)
    running = store.jobs.update(job_id, "running", progress=3, total=50, message="rolling out")
    again = store.jobs.update(job_id, "running", progress=4)
    assert (again.progress, again.total, again.message) == (4, 50, "rolling out")
    assert again.started == running.started is not None
    done = store.jobs.update(job_id, "done", result={"monitor": "abc"})
    assert done.ended is not None
    assert done.ended >= str(done.started)
    assert store.jobs.all() == [done]


def test_a_job_that_has_ended_stays_as_it_ended(store: Store) -> None:
    job_id = store.jobs.add("train", {})
    cancelled = store.jobs.update(job_id, "cancelled")
    assert store.jobs.update(job_id, "done", result={}) == cancelled
    assert store.jobs.info(job_id) == cancelled
    with pytest.raises(ValueError, match="job status 'finished' is unknown: choose queued"):
        store.jobs.update(job_id, "finished")  # pyright: ignore


def test_everything_is_there_after_opening_again(
    url: str, dataset: Dataset, trained: Monitor
) -> None:
    with_all = open_store(url)
    dataset_id = with_all.datasets.add(dataset, "d").id
    monitor = with_all.monitors.add(trained, "m", dataset_id)
    flight = with_all.flights.add({"kind": "replay"}, monitor.id, 0.2)
    append(with_all, flight, 0, 1500)
    with_all.close()
    again = open_store(url)
    assert again.datasets.get(dataset_id).digest() == dataset.digest()
    assert isinstance(again.monitors.info(monitor.id), MonitorInfo)
    assert_says_its_number(again.flights.assessments(flight), np.arange(1500))
    again.close()


def test_work_under_way_is_interrupted_when_the_store_opens(url: str, trained: Monitor) -> None:
    dying = open_store(url)
    running, queued, done = (dying.jobs.add(kind, {}) for kind in ("a", "b", "c"))
    dying.jobs.update(running, "running")
    finished = dying.jobs.update(done, "done")
    flight = flown(dying, trained)
    before = dying.jobs.info(running)

    looking = open_store(url, recover=False)
    assert looking.jobs.info(running).status == "running"
    assert looking.flights.info(flight).status == "running"
    assert looking.flights.info(flight).lost == 0

    again = open_store(url)
    assert [again.jobs.info(job).status for job in (running, queued)] == ["interrupted"] * 2
    assert again.jobs.info(done) == finished
    assert again.flights.info(flight).status == "interrupted"
    assert again.flights.info(flight).lost is None
    after = again.jobs.info(running)
    assert after.ended is not None
    assert after == replace(before, status="interrupted", ended=after.ended)
    for store in (dying, looking, again):
        store.close()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("sqlite://", "sqlite:///"),
        ("sqlite:///:memory:", "sqlite:///"),
        ("sqlite:///a.db?mode=ro", "sqlite:///"),
        ("nonsense://x", "unsupported"),
        ("://", "unsupported"),
    ],
)
def test_an_unsupported_database_address_is_refused(given: str, message: str) -> None:
    with pytest.raises(StoreError, match=message):
        address(given)


def test_errors_keep_a_password_to_themselves(tmp_path: Path) -> None:
    with pytest.raises(StoreError) as refused:
        open_store(tmp_path)
    assert str(tmp_path) in str(refused.value)
    assert "secret" not in str(address("postgresql://crew:secret@host/forewarn"))


@pytest.mark.parametrize("url", ["sqlite"], indirect=True)
def test_a_full_disk_is_said_and_leaves_nothing(store: Store, dataset: Dataset) -> None:
    with store.engine.connect() as connection:
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar_one()
    for held in [store.engine.raw_connection() for _ in range(8)]:
        held.execute(f"PRAGMA max_page_count = {pages + 20}")  # pyright: ignore
        held.close()
    with pytest.raises(StoreError, match="disk is full"):
        store.datasets.add(dataset, "too large")
    assert store.datasets.all() == []


def test_a_database_whose_connections_are_all_in_use_is_too_busy(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'busy.db'}"
    engine = create_engine(url, pool_size=1, max_overflow=0, pool_timeout=0.01)
    with reading(engine), pytest.raises(StoreError, match="too busy"), reading(engine):
        pass
    engine.dispose()


def test_threads_write_and_read_at_once(store: Store, dataset: Dataset, trained: Monitor) -> None:
    monitor_id = store.monitors.add(trained, "m").id
    flights = [store.flights.add({"n": i}, monitor_id, 0.1) for i in range(4)]

    def record(flight: str) -> None:
        for first in range(0, 300, 50):
            append(store, flight, first, 50)
            store.alarms.add(flight, alarm(first // 50 + 1, first, first * 0.02))

    def watch(flight: str) -> None:
        seen = 0
        while seen < 300:
            stored = store.flights.assessments(flight)
            assert len(stored) >= seen
            assert len(stored) % 50 == 0
            seen = len(stored)

    def collect(name: str) -> str:
        info = store.datasets.add(dataset, name)
        return store.datasets.get(info.id).digest()

    with ThreadPoolExecutor(10) as pool:
        work = [pool.submit(watch, flight) for flight in flights]
        work += [pool.submit(record, flight) for flight in flights]
        collected = [pool.submit(collect, name) for name in "ab"]
        for future in work:
            future.result()
        assert {future.result() for future in collected} == {dataset.digest()}
    for flight in flights:
        assert_says_its_number(store.flights.assessments(flight), np.arange(300))
        assert [alarm.number for alarm in store.alarms.of(flight)] == list(range(1, 7))
