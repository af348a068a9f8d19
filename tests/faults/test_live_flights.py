"""Live flights under faults: acknowledged samples persist, and the flight continues."""

import json
import os
import random
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from app.assessment.batches import ChannelReader
from app.flights.sources.live import LiveSetup
from app.settings import Settings
from app.store.store import open_store
from app.telemetry.journal import Journals, lines_of
from core.channels import KEYS
from core.monitor import Monitor
from tests.faults.conftest import keep_monitor
from tests.faults.server import running
from tests.faults.test_full_disk import fill
from tests.support.api import problem
from tests.support.live_server import assessed_again
from tests.support.patience import PATIENCE, until

N_KILLS, N_LONG, KILLS_A_FLIGHT = 1, 100, 10
FLIGHTS = "/api/v1/flights"
EXCEEDING = 7
"""Every so many samples, one exceeds a limit."""


def batch(sequence: int, dt: float) -> dict[str, Any]:
    channels = dict.fromkeys(KEYS, 1e-4 * (sequence % 5))
    if sequence % 200 == EXCEEDING:
        channels["Ny"] = 0.6
    return {"sequence": sequence, "t": sequence * dt, **channels}


def page_full(sequence: int, dt: float) -> dict[str, Any]:
    """A batch that the last page of a file has no room for."""
    rows = [batch(k, dt) for k in range(1, 200)]
    columns = {key: [row[key] for row in rows] for key in ("t", *KEYS)}
    return {"sequence": sequence, **columns}


def start(client: httpx2.Client, monitor: str, **source: Any) -> str:
    body = {"source": {"kind": "live", "trim": "none"} | source, "monitor": monitor}
    answer = client.post(FLIGHTS, json=body)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


def uplink(client: httpx2.Client, flight: str) -> ClientConnection:
    url = str(client.base_url).rstrip("/").replace("http", "ws", 1)
    return connect(f"{url}{FLIGHTS}/{flight}/uplink", proxy=None)


def push_until_killed(
    data_dir: Path, monitor: str, flight: str, dt: float, after_s: float
) -> tuple[str, set[int]]:
    """Push until the server is killed: the flight, begun where it is "", and what is durable."""
    with running(data_dir) as (process, client):
        flight = flight or start(client, monitor)
        acknowledged = push_until_broken(client, flight, dt, after_s, process.kill)
        process.join()
        assert process.exitcode == -signal.SIGKILL
    return flight, acknowledged


def push_until_broken(
    client: httpx2.Client, flight: str, dt: float, after_s: float, ending: Callable[[], object]
) -> set[int]:
    """Push, call `ending` after a time, and push until the connection ends: what is durable."""
    acknowledged: set[int] = set()
    with uplink(client, flight) as socket:
        last = json.loads(socket.recv(PATIENCE))["last_sequence"]
        threading.Timer(after_s, ending).start()
        sequence = 0 if last is None else last + 1
        try:
            while True:
                socket.send(json.dumps(batch(sequence, dt)))
                sequence += 1
                try:
                    message = json.loads(socket.recv(0.002))
                except TimeoutError:
                    continue
                acknowledged |= {*message["sequences"]}
        except ConnectionClosed:
            pass
    return acknowledged


def assert_kept(
    data_dir: Path,
    flight: str,
    monitor: Monitor,
    acknowledged: set[int],
    url: str | None = None,
) -> None:
    """What was acknowledged is in the journal once, and was scored and recorded to the bit."""
    with running(data_dir, database_url=url) as (_, client):
        # the server answers after a time though a long flight may not have resumed yet
        until(lambda: client.get(f"{FLIGHTS}/{flight}").json()["progress"] == "running")
        assert client.post(f"{FLIGHTS}/{flight}/end").json()["lost"] == 0
        alarms = client.get(f"{FLIGHTS}/{flight}/alarms").json()
    journals = Journals(data_dir / "live")
    sequences = [line["s"] for line in lines_of(journals.path(flight)) if "b" in line]
    assert len(sequences) == len(set(sequences))
    assert acknowledged <= {*sequences}
    again = assessed_again(
        LiveSetup(monitor, 0.3, ChannelReader(), journals, 0.0, None, "none"), flight
    )
    store = open_store(Settings(data_dir=data_dir, database_url=url).url)
    try:
        assert store.damage() == []
        stored = store.flights.assessments(flight)
    finally:
        store.close()
    assert stored.t.tolist() == [one.assessment.t for one in again]
    known = [None if p != p else p for p in stored.p_value.tolist()]
    assert known == [one.assessment.p_value for one in again]
    exceeding = {n * monitor.dt for n in acknowledged if n % 200 == EXCEEDING}
    assert exceeding <= {alarm["t"] for alarm in alarms if alarm["kind"] == "limit"}


def kill_so_often(data_dir: Path, monitor: Monitor, n: int) -> None:
    monitor_id, chance = keep_monitor(data_dir, monitor), random.Random(2)
    for _ in range(0, n, KILLS_A_FLIGHT):
        flight, acknowledged = "", set()
        for _ in range(min(n, KILLS_A_FLIGHT)):
            when = monitor.dt, chance.uniform(0.0, 0.4)
            flight, more = push_until_killed(data_dir, monitor_id, flight, *when)
            acknowledged |= more
        assert_kept(data_dir, flight, monitor, acknowledged)


def test_acknowledged_samples_persist_after_a_kill(tmp_path: Path, flyable: Monitor) -> None:
    kill_so_often(tmp_path, flyable, N_KILLS)


@pytest.mark.fuzz
def test_acknowledged_samples_persist_after_many_kills(tmp_path: Path, flyable: Monitor) -> None:
    kill_so_often(tmp_path, flyable, N_LONG)


@pytest.mark.skipif(not hasattr(os, "SCHED_RR"), reason="only Linux has this scheduling")
def test_what_a_sample_passes_runs_before_other_programs(tmp_path: Path, flyable: Monitor) -> None:
    monitor = keep_monitor(tmp_path, flyable)
    try:
        before = os.sched_getscheduler(0)
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
        os.sched_setscheduler(0, before, os.sched_param(0))
    except PermissionError:
        pytest.skip("real-time scheduling is not allowed here")

    with running(tmp_path, real_time=True) as (process, client):
        threads = Path(f"/proc/{process.pid}/task")

        def first() -> list[str]:
            ours = os.SCHED_RR | os.SCHED_RESET_ON_FORK
            numbers = (each.name for each in threads.iterdir())
            return [each for each in numbers if os.sched_getscheduler(int(each)) == ours]

        assert first() == [str(process.pid)]
        path = f"{FLIGHTS}/{start(client, monitor)}"
        assert client.post(f"{path}/samples", json=batch(0, flyable.dt)).status_code == 200
        until(lambda: len(first()) == 3)  # with journal and recorder
        assert len([*threads.iterdir()]) > 3


def test_on_a_full_disk_samples_are_shown_but_not_acknowledged_until_there_is_space(
    disk: Path, flyable: Monitor
) -> None:
    monitor = keep_monitor(disk, flyable)
    with running(disk) as (_, client):
        path = f"{FLIGHTS}/{start(client, monitor)}"
        assert client.post(f"{path}/samples", json=batch(0, flyable.dt)).status_code == 200
        filler = fill(disk)
        many = page_full(1, flyable.dt)
        refused = client.post(f"{path}/samples", json=many)
        assert "repeat it under the same sequence" in problem(refused, 503)
        assert client.get(path).json()["head"] == len(many["t"])
        assert "No space left" in client.get(f"{path}/samples").json()["problem"]
        filler.unlink()
        until(lambda: client.get(f"{path}/samples").json()["problem"] == "")
        again = client.post(f"{path}/samples", json=many)
        assert (again.status_code, again.json()["repeated"]) == (200, True)
