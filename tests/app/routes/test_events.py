"""The stream of changes of the lists."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest

from app.http.events import LISTS, Changes
from tests.app.routes.test_campaigns import PLAN
from tests.app.routes.test_flight_stream import URL, Server
from tests.support.api import api, served
from tests.support.patience import PATIENCE


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with api(tmp_path) as client:
        yield Server(client)


def test_a_list_has_another_number_exactly_when_it_changed(server: Server) -> None:
    changes: Changes = server.client.app.state.changes  # pyright: ignore
    before = dict(changes.revisions)

    def changed() -> list[str]:
        nonlocal before
        names = [name for name in LISTS if changes.revisions[name] != before[name]]
        before = dict(changes.revisions)
        return names

    flight = server.start()["id"]
    assert changed() == ["flights_in_progress", "flights"]
    server.steer(flight, "pause")
    changed()
    server.steer(flight, "speed", 2)
    assert changed() == []
    server.steer(flight, "next_alert")
    server.advance(0.5)
    assert changed() == ["flights_in_progress"]
    server.client.post(f"{URL}/{flight}/end")
    assert changed() == ["flights_in_progress", "flights"]
    (alarm,) = server.client.get(f"{URL}/{flight}/alarms").json()
    server.client.post(f"{URL}/{flight}/alarms/{alarm['number']}/acknowledge")
    assert changed() == ["flights"]
    server.client.delete(f"{URL}/{flight}")
    assert changed() == ["flights"]
    campaign = server.client.post("/api/v1/campaigns", json=PLAN).json()["id"]
    assert changed() == ["campaigns"]
    server.client.delete(f"/api/v1/campaigns/{campaign}")
    assert changed() == ["campaigns"]


def test_a_stream_tells_of_changes_and_ends_with_its_server(tmp_path: Path) -> None:
    with served(tmp_path) as (address, server):
        changes: Changes = server.app.state.changes
        with httpx2.stream("GET", f"{address}/api/v1/events", timeout=PATIENCE) as stream:
            assert stream.headers["content-type"].startswith("text/event-stream")
            lines = (line[6:] for line in stream.iter_lines() if line.startswith("data: "))
            first: dict[str, Any] = json.loads(next(lines))
            assert sorted(first) == sorted(LISTS)
            changes.note("campaigns")
            assert json.loads(next(lines)) == first | {"campaigns": first["campaigns"] + 1}
            assert json.loads(next(lines))  # a quiet stream repeats them
            server.should_exit = True
            assert [*lines] == []  # ended, not dropped


def test_a_server_that_starts_again_has_other_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    before = Changes().revisions
    monkeypatch.setattr(time, "time_ns", lambda: 2 * 10**6 * before["flights"])
    assert not set(Changes().revisions.values()) & set(before.values())
