"""A server killed with -9 at any moment: no alarm shown as stored is missing."""

import json
import random
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

from app.settings import Settings
from app.store.store import open_store
from core.monitor import Monitor
from tests.app.routes.test_limit_sets import SLOW
from tests.faults.conftest import keep_monitor
from tests.faults.server import running
from tests.support.patience import PATIENCE

N_KILLS, N_LONG = 2, 10
FOREWARN = sys.executable, "-c", "from app.cli import main; raise SystemExit(main())"
MOST_ALARMS = 2
"""Those of the flight: the predicted and the measured exceedance."""


def alarms_until_killed(data_dir: Path, monitor: str, n_alarms: int) -> tuple[str, list[Any]]:
    """Fly, acknowledge each alarm, kill at the n-th; what was shown as stored or acknowledged."""
    shown = []
    with running(data_dir) as (process, client):
        source = {"kind": "simulated", "outcome": "unsafe", "seed": 1}
        order = {"source": source, "monitor": monitor}
        answer = client.post("/api/v1/flights", json=order)
        assert answer.status_code == 201, answer.text
        path = f"/api/v1/flights/{answer.json()['id']}"
        url = str(client.base_url).rstrip("/").replace("http", "ws", 1) + f"{path}/stream"
        with connect(url, proxy=None) as socket:
            client.post(f"{path}/transport", json={"action": "speed", "value": 10})
            while (n_shown := len({alarm["number"] for alarm in shown})) < n_alarms:
                message = json.loads(socket.recv(PATIENCE))
                if message["type"] == "frames":
                    socket.send('{"type":"credit","n":1}')
                if message["type"] != "alarm" or not message["alarm"]["stored"]:
                    continue
                shown.append(message["alarm"])
                # one that is not acknowledged takes in those that follow it
                if message["alarm"]["acknowledged"] is None and n_shown < n_alarms - 1:
                    acknowledge = f"{path}/alarms/{message['alarm']['id']}/acknowledge"
                    told = client.post(acknowledge, json={"by": "FTE"})
                    assert told.status_code == 200, told.text
                    shown.append(told.json())
            process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL
    return answer.json()["id"], shown


def assert_kept(data_dir: Path, flight: str, shown: list[Any]) -> None:
    """Every alarm and acknowledgement that was shown is stored, and the store is sound."""
    store = open_store(Settings(data_dir=data_dir).url)
    try:
        assert store.damage() == []
        assert store.flights.info(flight).status == "interrupted"
        stored = {alarm.number: alarm for alarm in store.alarms.of(flight)}
        for alarm in shown:
            kept = stored[alarm["number"]]
            assert (kept.seq, kept.t, kept.kind) == (alarm["seq"], alarm["t"], alarm["kind"])
            if alarm["acknowledged"]:
                assert (kept.by, kept.acknowledged) == (alarm["by"], alarm["acknowledged"])
    finally:
        store.close()


def kill_so_often(data_dir: Path, monitor: Monitor, n: int) -> None:
    monitor_id, chance = keep_monitor(data_dir, monitor), random.Random(1)
    for _ in range(n):
        n_alarms = chance.randint(1, MOST_ALARMS)
        assert_kept(data_dir, *alarms_until_killed(data_dir, monitor_id, n_alarms))


def test_no_shown_alarm_is_missing_after_a_kill(tmp_path: Path, flyable: Monitor) -> None:
    kill_so_often(tmp_path, flyable, N_KILLS)


@pytest.mark.fuzz
def test_no_shown_alarm_is_missing_after_many_kills(tmp_path: Path, flyable: Monitor) -> None:
    kill_so_often(tmp_path, flyable, N_LONG)


def test_what_a_command_reads_beside_the_server_deletes_nothing_that_it_writes_later(
    tmp_path: Path,
) -> None:
    """Another process must see the server's locks: else it deletes the write-ahead log."""
    with running(tmp_path):  # the next start compares the database with this one's
        pass
    with running(tmp_path) as (process, client):
        assert (
            subprocess.run([*FOREWARN, "audit", "--data-dir", tmp_path], check=False).returncode
            == 0
        )
        assert (tmp_path / "forewarn.db-wal").exists()
        made = client.post("/api/v1/limit-sets", json={"name": "doublets", "cases": [SLOW]})
        assert made.status_code == 201, made.text
        process.kill()
        process.join()
    store = open_store(Settings(data_dir=tmp_path).url)
    try:
        assert [limit_set.name for limit_set in store.limit_sets.all()] == ["doublets"]
        assert store.last_stop.finding() == ""
    finally:
        store.close()
