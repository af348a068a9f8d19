"""A full disk: confirmed data is stored, refusals are reported, deleting makes space."""

from pathlib import Path
from typing import Any

from core.monitor import Monitor
from tests.faults.conftest import MIB, keep_monitor
from tests.faults.server import running
from tests.support.api import problem
from tests.support.patience import until

FLIGHTS = "/api/v1/flights"


def fill(disk: Path) -> Path:
    """Leave no byte of a disk; the file that takes it."""
    filler = disk / "filler"
    with filler.open("ab", buffering=0) as file:
        for size in (MIB, 4096, 1):
            try:
                while True:
                    file.write(bytes(size))
            except OSError:
                continue
    return filler


def fly(client: Any, monitor: str) -> str:
    source = {"kind": "simulated", "outcome": "unsafe", "seed": 1}
    answer = client.post(FLIGHTS, json={"source": source, "monitor": monitor})
    assert answer.status_code == 201, answer.text
    path = f"{FLIGHTS}/{answer.json()['id']}"
    client.post(f"{path}/transport", json={"action": "loop", "value": True})
    client.post(f"{path}/transport", json={"action": "speed", "value": 10})
    return path


def test_only_stored_data_is_confirmed_and_the_flight_continues(
    disk: Path, flyable: Monitor
) -> None:
    monitor = keep_monitor(disk, flyable)
    with running(disk) as (_, client):
        path = fly(client, monitor)
        until(lambda: client.get(f"{path}/alarms").json())
        filler = fill(disk)
        until(lambda: client.get("/readyz").status_code == 503)
        until(lambda: client.post(f"{path}/alarms/1/acknowledge").status_code == 503)
        (alarm, *_) = client.get(f"{path}/alarms").json()
        assert alarm["acknowledged"] is None
        until(lambda: client.get("/readyz").json().get("unwritten", 0) > 100)
        assert "forewarn_samples_unwritten" in client.get("/metrics").text
        problem(client.post(f"{path}/end"), 503)
        assert client.get(path).json()["progress"] == "ending"
        problem(client.delete(path), 409)
        filler.unlink()
        until(lambda: client.get(path).json()["progress"] == "ended")
        record = client.get(path).json()
        assert record["lost"] == 0
        frames = client.get(f"{path}/assessments").json()["frames"]
        assert [frame["seq"] for frame in frames] == list(range(len(frames)))
        assert client.get("/readyz").status_code == 200
        assert client.post(f"{path}/alarms/1/acknowledge").json()["acknowledged"]


def test_a_server_starts_on_a_full_disk_and_deletes(disk: Path, flyable: Monitor) -> None:
    monitor = keep_monitor(disk, flyable)
    with running(disk) as (process, client):
        path = fly(client, monitor)
        until(lambda: client.get(path).json()["head"] > 500)
        assert client.post(f"{path}/end").status_code == 200
        fill(disk)
        process.kill()
        process.join()
    with running(disk) as (_, client):
        assert client.get(path).json()["progress"] == "ended"
        for _ in range(2):
            assert client.delete(path).status_code == 204
        problem(client.get(path), 404)
