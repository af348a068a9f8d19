"""A database with overwritten pages: the server starts, reports the damage and keeps running."""

import signal
from pathlib import Path

from core.monitor import Monitor
from tests.app.upkeep.test_integrity import corrupt_pages
from tests.faults.conftest import keep_monitor
from tests.faults.server import running
from tests.faults.test_full_disk import FLIGHTS, fly
from tests.support.api import problem
from tests.support.patience import until


def test_a_server_of_a_corrupted_database_starts_and_says_what_is_damaged(
    tmp_path: Path, flyable: Monitor
) -> None:
    monitor = keep_monitor(tmp_path, flyable)
    with running(tmp_path) as (_, client):
        path = fly(client, monitor)
        assert client.post(f"{path}/end").status_code == 200
    corrupt_pages(tmp_path / "forewarn.db")
    with running(tmp_path) as (process, client):
        assert client.get("/").status_code == 200
        until(lambda: problem(client.get("/readyz"), 503).startswith("the database is damaged"))
        (item,) = client.get("/api/v1/integrity").json()["damaged"]
        assert item["kind"] == "database"
        for refused in (
            client.get(path),
            client.get(FLIGHTS),
            client.post(FLIGHTS, json={"source": {"kind": "simulated"}, "monitor": monitor}),
        ):
            assert "restore a backup" in problem(refused, 500)
            assert refused.json()["type"] == "urn:forewarn:damaged"
        assert client.get(f"/api/v1/monitors/{monitor}/file").status_code == 200
        assert process.is_alive()
        process.terminate()
        process.join(30)
        assert process.exitcode == -signal.SIGTERM
