"""Many equal requests at once, and a database that another program locks."""

import sqlite3
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from app.serving import alone
from app.settings import Settings, SettingsError
from core.monitor import Monitor
from tests.faults.conftest import keep_monitor
from tests.faults.server import running
from tests.faults.test_full_disk import FLIGHTS, fly

AT_ONCE = 10


def test_a_flight_that_is_deleted_while_it_flies_is_kept(tmp_path: Path, flyable: Monitor) -> None:
    monitor = keep_monitor(tmp_path, flyable)
    with running(tmp_path) as (_, client), ThreadPoolExecutor(AT_ONCE) as pool:
        path = fly(client, monitor)
        deleted = pool.map(lambda _: client.delete(path).status_code, range(AT_ONCE))
        assert set(deleted) == {409}
        ended = pool.map(lambda _: client.post(f"{path}/end").status_code, range(AT_ONCE))
        assert set(ended) == {200}
        assert client.get(path).json()["progress"] == "ended"
        deleted = pool.map(lambda _: client.delete(path).status_code, range(AT_ONCE))
        assert set(deleted) == {204}


def test_a_flight_requested_many_times_starts_once(tmp_path: Path, flyable: Monitor) -> None:
    monitor = keep_monitor(tmp_path, flyable)
    order = {"source": {"kind": "simulated", "seed": 1}, "monitor": monitor}
    key = {"Idempotency-Key": "one"}
    with running(tmp_path) as (_, client), ThreadPoolExecutor(AT_ONCE) as pool:
        answers = list(
            pool.map(lambda _: client.post(FLIGHTS, json=order, headers=key), range(AT_ONCE))
        )
        assert {answer.status_code for answer in answers} <= {201, 409}
        assert client.post(FLIGHTS, json=order, headers=key).status_code == 201
        assert len(client.get(FLIGHTS).json()) == 1


def test_a_database_locked_by_another_program_is_not_ready_and_loses_nothing(
    tmp_path: Path, flyable: Monitor
) -> None:
    monitor = keep_monitor(tmp_path, flyable)
    with running(tmp_path) as (_, client):
        path = fly(client, monitor)
        with (
            pytest.raises(SettingsError, match="another forewarn serves"),
            alone(Settings(data_dir=tmp_path)),
        ):
            pass
        other = sqlite3.connect(tmp_path / "forewarn.db", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        assert client.get("/readyz").status_code == 503
        assert client.get(path).json()["progress"] == "running"
        other.execute("ROLLBACK")
        other.close()
        assert client.post(f"{path}/end").json()["lost"] == 0
        assert client.get("/readyz").status_code == 200
