"""Servers on one PostgreSQL: one serves; what the other and the database do changes nothing."""

import random
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.serving import alone
from app.settings import Settings, SettingsError
from app.store.database import address
from app.store.ownership import OWNER_KEY, owned
from app.store.store import open_store
from tests.app.flights.test_flights import monitor
from tests.app.routes.test_limit_sets import SLOW
from tests.app.routes.test_live_samples import batch
from tests.faults.server import Running, running
from tests.support.api import problem
from tests.support.patience import until
from tests.support.postgresql import PostgreSQL

pytestmark = pytest.mark.services
N_KILLS = 20
HOLDER = f"SELECT pid FROM pg_locks WHERE locktype = 'advisory' AND objid = {OWNER_KEY}"


@pytest.fixture
def url(postgresql: PostgreSQL) -> str:
    return postgresql.new_database()


@pytest.fixture
def server(tmp_path: Path, url: str) -> Iterator[tuple[Running, str]]:
    """A server with a live flight; and the flight's address."""
    store = open_store(url)
    identity = store.monitors.add(monitor(), "m").id
    store.close()
    with running(tmp_path / "one", database_url=url) as server:
        order = {"source": {"kind": "live", "trim": "none"}, "monitor": identity}
        started = server.client.post("/api/v1/flights", json=order)
        assert started.status_code == 201, started.text
        yield server, f"/api/v1/flights/{started.json()['id']}"


def send(server: Running, flight: str, sequence: int) -> None:
    """Send ten samples, which follow those of the sequence before."""
    samples = batch(sequence, 10 * (sequence - 1), 10)
    answer = server.client.post(f"{flight}/samples", json=samples)
    assert answer.status_code == 200, answer.text
    assert answer.json()["accepted"] == 10


def test_a_second_server_is_refused_and_changes_nothing(
    server: tuple[Running, str], url: str, tmp_path: Path
) -> None:
    first, flight = server
    send(first, flight, 1)
    other = Settings(data_dir=tmp_path / "two", database_url=url)
    with pytest.raises(SettingsError, match="another forewarn serves postgresql") as refused:
        alone(other).__enter__()
    assert "\n" not in str(refused.value)
    open_store(url).close()  # as a program that does not ask
    send(first, flight, 2)
    assert first.client.get(flight).json()["progress"] == "running"


def test_a_lost_lock_is_taken_again_or_reported(
    server: tuple[Running, str], postgresql: PostgreSQL, url: str
) -> None:
    (_, client), flight = server
    ((holder,),) = postgresql.run(HOLDER, url)
    postgresql.run(f"SELECT pg_terminate_backend({holder})", url)
    until(lambda: not postgresql.run(HOLDER, url))
    assert client.get("/readyz").status_code == 200
    ((again,),) = postgresql.run(HOLDER, url)
    assert again != holder
    postgresql.run(f"SELECT pg_terminate_backend({again})", url)
    until(lambda: not postgresql.run(HOLDER, url))
    with owned(address(url)):
        assert "lost its database" in problem(client.get("/readyz"), 503)
        assert problem(client.post("/api/v1/limit-sets", json={"name": "n", "cases": [SLOW]}), 503)
        assert client.get(flight).json()["progress"] == "running"
    assert client.get("/readyz").status_code == 200


def test_no_sample_is_lost_while_the_database_is_killed_again_and_again(
    server: tuple[Running, str], postgresql: PostgreSQL
) -> None:
    (_, client), flight = server
    chance, sent = random.Random(4), 0

    def send_some() -> None:
        nonlocal sent
        for _ in range(chance.randint(1, 10)):
            sent += 1
            send(server[0], flight, sent)

    for _ in range(N_KILLS):
        send_some()
        killing = threading.Timer(chance.uniform(0.0, 0.05), postgresql.kill)
        killing.start()
        send_some()
        killing.join()
        send_some()
        postgresql.start()
    until(lambda: client.get("/readyz").status_code == 200)
    ended = client.post(f"{flight}/end")
    assert (ended.status_code, ended.json()["lost"]) == (200, 0)
    shown = client.get(f"{flight}/assessments").json()
    assert [frame["seq"] for frame in shown["frames"]] == [*range(10 * sent)]


def test_a_database_that_starts_again_is_served_again(
    server: tuple[Running, str], postgresql: PostgreSQL
) -> None:
    first, flight = server
    send(first, flight, 1)
    postgresql.stop()
    assert problem(first.client.get("/readyz"), 503)
    postgresql.start()
    until(lambda: first.client.get("/readyz").status_code == 200)
    send(first, flight, 2)
    stored = first.client.post(f"{flight}/end")
    assert stored.status_code == 200, stored.text
    shown = first.client.get(f"{flight}/assessments").json()
    assert len(shown["frames"]) == 20
