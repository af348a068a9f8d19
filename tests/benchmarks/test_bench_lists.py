"""The first part of long lists: 10,000 ended flights of ten minutes against 100 of them."""

import secrets
from collections.abc import Iterator
from contextlib import ExitStack
from time import perf_counter, process_time, sleep
from typing import Any

import pytest
from sqlalchemy import event, insert
from starlette.testclient import TestClient

from app.store.store import Store
from app.store.tables import alarms, assessment_chunks, flights
from core.monitor import train
from core.planned_test.collection import DatasetRecipe, collect
from tests.support.api import api, store_of
from tests.support.stored import append

pytestmark = pytest.mark.benchmark

N_FLIGHTS = (100, 10_000)
CHUNKS, ALARMS = 30, 8
"""Of ten minutes at 50 Hz; the samples of all chunks but the newest are left out."""
ROUNDS = 7
LISTS = (
    "/flights",
    "/flights?progress=running&limit=30",
    "/flights?limit=30&progress=ended&progress=failed&progress=interrupted",
    "/flights?text=flight%2077",
)


def fill(store: Store, n: int) -> None:
    """Ended flights, every second one beyond its limit."""
    monitor = store.monitors.add(train(collect(DatasetRecipe(n_unsafe=20, n_obs=3))), "doublet").id
    first = store.flights.add({"kind": "live", "name": "first"}, monitor, 0.1)
    append(store, first, 0, 1000)
    store.flights.end(first)
    with store.engine.begin() as connection:
        (chunk,) = (dict(row._mapping) for row in connection.execute(assessment_chunks.select()))
        (flight,) = (dict(row._mapping) for row in connection.execute(flights.select()))
        for k in range(1, n):
            identity, exceeded = secrets.token_hex(6), 0.6 if k % 2 else None
            about = {"source": {"kind": "live", "name": f"flight {k}"}, "exceeded_t": exceeded}
            about |= {"created": f"2026-{1 + k % 12:02d}-01T00:00:{k % 60:02d}.{k:06d}Z"}
            connection.execute(insert(flights), [flight | about | {"id": identity}])
            rows = [
                chunk
                | {"flight_id": identity, "first_seq": 1000 * c, "last_seq": 1000 * c + 999}
                | ({} if c == CHUNKS - 1 else {"content": b"left out"})
                for c in range(CHUNKS)
            ]
            connection.execute(insert(assessment_chunks), rows)
            raised = {"p_value": 0.5, "level": "warning", "raised": about["created"]}
            connection.execute(
                insert(alarms),
                [
                    {"id": secrets.token_hex(6), "flight_id": identity, "number": a, "seq": 100 * a,
                     "t": 0.1 * a, "kind": "limit" if exceeded and a == 6 else "risk"} | raised
                    for a in range(ALARMS)
                ],
            )  # fmt: skip


@pytest.fixture(scope="module")
def servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[int, TestClient]]:
    """By number of flights; each has summarized what it found at its start."""
    with ExitStack() as open_servers:
        clients = {}
        for n in N_FLIGHTS:
            data = tmp_path_factory.mktemp("lists")
            with api(data) as client:
                fill(store_of(client), n)
            clients[n] = open_servers.enter_context(api(data))
            while store_of(clients[n]).flights.without_summary():
                sleep(0.1)
        yield clients


def asked(client: TestClient, path: str) -> tuple[float, float, float, int]:
    """Least wall and processor time [ms], size [kB] and number of queries of a list."""
    queries: list[Any] = []

    def note(connection: Any, cursor: Any, statement: str, *_: Any) -> None:
        if statement != "BEGIN":
            queries.append(statement)

    event.listen(store_of(client).engine, "before_cursor_execute", note)
    times, size = [], 0
    for _ in range(ROUNDS):
        queries.clear()
        wall, cpu = perf_counter(), process_time()
        size = len(client.get(f"/api/v1{path}").raise_for_status().content)
        times.append((perf_counter() - wall, process_time() - cpu))
    wall, cpu = (1e3 * min(each) for each in zip(*times, strict=True))
    return wall, cpu, size / 1e3, len(queries)


def test_lists_of_many_flights(servers: dict[int, TestClient]) -> None:
    print()
    for path in LISTS:
        for n, client in servers.items():
            wall, cpu, size, queries = asked(client, path)
            print(
                f"{path:70} of {n:6} flights: {wall:6.1f} ms, {cpu:6.1f} ms of processor time, "
                f"{size:5.0f} kB, {queries} queries"
            )
