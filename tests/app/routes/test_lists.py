"""Long lists are sent in parts, filtered by the server, with a fixed number of queries."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import event, update
from starlette.testclient import TestClient

from app.flights.ended import summarize
from app.store.store import Store
from app.store.tables import flights, recordings
from core.monitor import Monitor
from core.monitor.monitor_set import MonitorCase, MonitorSet
from tests.support.api import api, problem, store_of
from tests.support.patience import until
from tests.support.stored import alarm, append, keep_recording

FLIGHTS = "/api/v1/flights"
MOST_QUERIES = 10
TIMES = "first_t", "last_t", "worst_t"


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    with api(tmp_path) as client:
        yield client


@pytest.fixture
def store(client: TestClient) -> Store:
    return store_of(client)


@contextmanager
def counted(store: Store) -> Iterator[list[str]]:
    """The queries meanwhile."""
    statements: list[str] = []

    def note(connection: Any, cursor: Any, statement: str, *_: Any) -> None:
        if statement != "BEGIN":
            statements.append(statement)

    event.listen(store.engine, "before_cursor_execute", note)
    try:
        yield statements
    finally:
        event.remove(store.engine, "before_cursor_execute", note)


def fly(store: Store, monitor: str, n: int, **source: Any) -> list[str]:
    """Ended flights with samples and alarms; every second one has exceeded its limit."""
    flown = []
    for k in range(n):
        flight = store.flights.add({"kind": "live", "name": f"flight {k}"} | source, monitor, 0.1)
        append(store, flight, 0, 40)
        store.alarms.add(flight, alarm(0, 9, 0.2))
        exceeded, channels = None, []
        if k % 2:
            exceeded = 0.6
            measured = {"worst": 0.7, "limit": 0.5}
            channels = [measured | {"channel": "Ny", "n": 1} | dict.fromkeys(TIMES, exceeded)]
            store.alarms.add(flight, alarm(1, 30, exceeded, "limit"))
        store.flights.end(flight, "ended", exceeded, channels)
        flown.append(flight)
    return flown


def all_parts(client: TestClient, address: str) -> Iterator[list[dict[str, Any]]]:
    """The parts of a list, as a client follows its links."""
    while True:
        answer = client.get(address)
        assert answer.status_code == 200, answer.text
        yield answer.json()
        if (link := answer.headers.get("link")) is None:
            return
        (address,) = re.findall('<(.+)>; rel="next"', link)


@pytest.mark.parametrize("at_one_time", [False, True])
def test_the_parts_of_a_list_hold_every_flight_once(
    client: TestClient, store: Store, trained: Monitor, at_one_time: bool
) -> None:
    flown = fly(store, store.monitors.add(trained, "m").id, 7)
    if at_one_time:
        with store.engine.begin() as connection:
            connection.execute(update(flights).values(created="2026-01-01T00:00:00.000000Z"))
        flown.sort()
    parts = list(all_parts(client, f"{FLIGHTS}?limit=3"))
    assert [len(part) for part in parts] == [3, 3, 1]
    assert [flight["id"] for part in parts for flight in part] == flown[::-1]
    assert list(all_parts(client, FLIGHTS)) == [[*parts[0], *parts[1], *parts[2]]]


def test_a_list_goes_on_where_it_was_though_its_last_flight_is_deleted(
    client: TestClient, store: Store, trained: Monitor
) -> None:
    flown = fly(store, store.monitors.add(trained, "m").id, 4)
    parts = all_parts(client, f"{FLIGHTS}?limit=2")
    assert [flight["id"] for flight in next(parts)] == [flown[3], flown[2]]
    store.flights.delete(flown[2])
    fly(store, store.monitors.add(trained, "m").id, 1)
    assert [flight["id"] for flight in next(parts)] == [flown[1], flown[0]]


def test_flights_are_found_by_progress_monitor_time_aircraft_and_text(
    client: TestClient, store: Store, trained: Monitor
) -> None:
    one, other = (store.monitors.add(trained, name).id for name in ("doublet 5 %", "steps"))
    keep_recording(store, "abc")
    mine = fly(store, one, 2)
    (steps,) = fly(store, other, 1, name="Point_12 at 40 %", recording="abc")
    running = store.flights.add({"kind": "live", "name": "now"}, other, 0.1)

    def found(**query: Any) -> list[str]:
        answer = client.get(FLIGHTS, params=query)
        assert answer.status_code == 200, answer.text
        return [flight["id"] for flight in answer.json()]

    assert found(progress=["running"]) == [running]
    assert found(progress=["ended", "failed"]) == [steps, *mine[::-1]]
    assert found(monitor=one) == mine[::-1]
    assert found(aircraft="PH-LAB") == [steps]
    assert found(text=" point_1 ") == [steps]
    assert found(text="%") == [steps, *mine[::-1]]
    assert found(text="doublet") == mine[::-1]
    assert found(text=mine[0]) == [mine[0]]
    assert found(text="pointx") == []
    since = store.flights.info(steps).created
    assert found(since=since) == [running, steps]
    assert found(until=since.replace("Z", "+00:00")) == [steps, *mine[::-1]]
    assert found(until=since.removesuffix("Z")) == [steps, *mine[::-1]]
    for wild in ("1502", "0001-01-01T00:00:00+01:00"):
        assert "is not a time" in problem(client.get(FLIGHTS, params={"since": wild}), 422)
    assert "cursor" in problem(client.get(FLIGHTS, params={"cursor": "nonsense"}), 422)


def test_the_number_of_queries_does_not_grow_with_the_flights(
    client: TestClient, store: Store, trained: Monitor
) -> None:
    monitor = store.monitors.add(trained, "m").id
    fly(store, monitor, 30)
    summarize(store, store.flights.without_summary())
    client.get(FLIGHTS)  # what is read once
    n_queries = []
    for limit in (2, 30):
        with counted(store) as statements:
            assert len(client.get(f"{FLIGHTS}?limit={limit}").json()) == limit
        n_queries.append(len(statements))
    assert n_queries[0] == n_queries[1] <= MOST_QUERIES


def test_a_list_shows_of_each_flight_what_its_record_shows(
    client: TestClient, store: Store, trained: Monitor
) -> None:
    """Before it is summarized, as after a kill, and afterwards."""
    flown = fly(store, store.monitors.add(trained, "m").id, 4)
    of_each = [client.get(f"{FLIGHTS}/{flight}").json() for flight in reversed(flown)]
    assert [each["verdict"] is not None for each in of_each] == [True, False, True, False]
    assert client.get(FLIGHTS).json() == of_each
    assert store.flights.without_summary() == flown[::-1]
    summarize(store, store.flights.without_summary())
    assert store.flights.without_summary() == []
    older = dict(store.flights.info(flown[0]).summary or {})
    del older["is_assessed"]
    store.flights.summarize({flown[0]: older})
    assert store.flights.without_summary() == [flown[0]], "of a version that did not store it"
    assert client.get(FLIGHTS).json() == of_each
    store.alarms.acknowledge(flown[3], 1, "Ann")
    shown, (record, *_) = client.get(f"{FLIGHTS}/{flown[3]}").json(), client.get(FLIGHTS).json()
    assert (record, record["open_alarms"]) == (shown, 1)


def test_a_resumed_flight_is_summarized_again(store: Store, trained: Monitor) -> None:
    flight = store.flights.add({"kind": "live"}, store.monitors.add(trained, "m").id, 0.1)
    store.flights.summarize({flight: {"of": "a flight in progress"}})
    assert store.flights.info(flight).summary is None
    store.flights.recover()
    store.flights.summarize({flight: {"of": "an interrupted one"}})
    assert store.flights.info(flight).summary == {"of": "an interrupted one"}
    store.flights.resume(flight, -1)
    assert store.flights.info(flight).summary is None


def test_recordings_come_in_parts_and_are_found_by_aircraft_and_name(
    client: TestClient, store: Store
) -> None:
    for k in range(5):
        keep_recording(store, f"r{k}", name=f"run_{k}.csv")
    with store.engine.begin() as connection:
        renamed = update(recordings).where(recordings.c.id == "r3")
        connection.execute(renamed.values(aircraft="D-ATTS"))
    path = "/api/v1/recordings"
    parts = list(all_parts(client, f"{path}?limit=2&text=RUN_"))
    assert [[each["id"] for each in part] for part in parts] == [["r4", "r3"], ["r2", "r1"], ["r0"]]
    assert [each["id"] for each in client.get(f"{path}?aircraft=D-ATTS").json()] == ["r3"]
    assert client.get(f"{path}?text=run-").json() == []


def test_jobs_come_in_parts_and_by_kind(client: TestClient, store: Store) -> None:
    jobs = [store.jobs.add(kind, {}) for kind in ("study", "monitor", "study")]
    found = list(all_parts(client, "/api/v1/jobs?limit=1&kind=study"))
    assert [[job["id"] for job in part] for part in found] == [[jobs[2]], [jobs[0]]]
    assert len(client.get("/api/v1/jobs").json()) == 3
    assert "clearance" in problem(client.get("/api/v1/jobs?kind=false"), 422)


def test_a_server_summarizes_at_its_start_what_one_before_has_not(
    tmp_path: Path, trained: Monitor
) -> None:
    with api(tmp_path) as client:
        flown = fly(store_of(client), store_of(client).monitors.add(trained, "m").id, 2)
        assert store_of(client).flights.without_summary() == flown[::-1]
    with api(tmp_path) as client:
        until(lambda: not store_of(client).flights.without_summary())


def test_flights_on_a_monitor_set_are_found_by_its_name(
    client: TestClient, store: Store, trained: Monitor
) -> None:
    monitor = store.monitors.add(trained, "m")
    cases = (MonitorCase("slow", {"mach": (None, 0.8)}, monitor),)
    made = store.monitor_sets.add("By Mach", MonitorSet(cases), "Ann")
    (other,) = fly(store, monitor.id, 1)
    flight = store.flights.add({"kind": "live"}, monitor.id, 0.1, monitor_set=(made.id, {}))
    store.flights.end(flight)
    for text, wanted in (("by mach", [flight]), ("flight 0", [other])):
        assert [each["id"] for each in client.get(f"{FLIGHTS}?text={text}").json()] == wanted
