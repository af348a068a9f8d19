"""Live samples over REST and WebSocket: accepted once, durable when answered, or refused."""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from starlette.testclient import TestClient, WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from app.routes.flight_sockets import MOST_MALFORMED
from app.telemetry.journal import lines_of
from core.channels import KEYS
from tests.app.flights.test_flights import monitor
from tests.support.api import ADDRESS, api, problem, store_of

URL = "/api/v1/flights"
HEADERS = {"host": "127.0.0.1:8000", "origin": "http://127.0.0.1:8000"}
DT = 0.05


def batch(sequence: int | None, first: int = 0, n: int = 1, **more: Any) -> dict[str, Any]:
    t = DT * (first + np.arange(n))
    channels = {key: (0.001 * np.sin(5.0 * t)).tolist() for key in KEYS}
    numbered = {} if sequence is None else {"sequence": sequence}
    return {**numbered, "t": t.tolist(), **channels, **more}


class Range:
    """A server with a live flight, and the folder of its data."""

    def __init__(self, client: TestClient, root: Path) -> None:
        self.client, self.root = client, root
        self.monitor_id = store_of(client).monitors.add(monitor(), "F-16 doublet").id
        self.id = self.start().json()["id"]

    def start(self, **source: Any) -> Any:
        source = {"kind": "live", "trim": "none"} | source
        return self.client.post(URL, json={"source": source, "monitor": self.monitor_id})

    def push(self, body: Any) -> Any:
        return self.client.post(f"{URL}/{self.id}/samples", json=body)

    def uplink(self, flight: str = "") -> Any:
        path = f"{URL}/{flight or self.id}/uplink"
        return self.client.websocket_connect(path, headers=HEADERS)

    def lines(self) -> list[dict[str, Any]]:
        return [*lines_of(self.root / "live" / f"{self.id}.jsonl")]


@pytest.fixture
def range_(tmp_path: Path) -> Iterator[Range]:
    with api(tmp_path) as client:
        yield Range(client, tmp_path)


def test_an_answered_batch_is_durable_and_used_once(range_: Range) -> None:
    taken = {"sequence": 1, "accepted": 5, "repeated": False, "unread": []}
    assert range_.push(batch(1, n=5)).json() == taken
    assert [line["s"] for line in range_.lines() if "b" in line] == [1]
    assert range_.push(batch(1, n=5)).json() == taken | {"accepted": 0, "repeated": True}
    assert "sequence 1 was used" in problem(range_.push(batch(1, n=4)), 409)
    frames = range_.client.get(f"{URL}/{range_.id}/assessments").json()["frames"]
    assert [frame["t"] for frame in frames] == [k * DT for k in range(5)]
    now = range_.client.get(f"{URL}/{range_.id}/samples").json()
    assert (now["last_sequence"], now["counts"]["accepted"]) == (1, 5)


def test_unread_names_are_in_the_answer_and_the_flights_status(range_: Range) -> None:
    odd: dict[str, Any] = {"aoa": [0.1], "Nz": [1.0], "mach": [0.5], "phi": [0.0]}
    assert range_.push(batch(1, n=1, **odd)).json()["unread"] == ["aoa", "Nz"]
    assert range_.push(batch(2, n=1, first=1)).json()["unread"] == []
    with range_.uplink() as uplink:
        uplink.receive_json()
        uplink.send_json(batch(3, n=1, first=2, aoa=[0.1], G=[0.0]))
        assert uplink.receive_json()["unread"] == ["aoa", "G"]
    live = range_.client.get(f"{URL}/{range_.id}/samples").json()
    assert live["unread"] == ["aoa", "Nz", "G"]


def test_a_malformed_batch_is_refused_and_the_flight_continues(range_: Range) -> None:
    assert "missing channels: Ny" in problem(range_.push(batch(1, Ny=None)), 422)
    assert "not a JSON object" in problem(range_.push([1, 2]), 422)
    assert range_.push(batch(1)).status_code == 200


def test_only_a_live_flight_in_progress_accepts_samples(range_: Range) -> None:
    body = {"source": {"kind": "simulated"}, "monitor": range_.monitor_id}
    other = range_.client.post(URL, json=body).json()["id"]
    refused = range_.client.post(f"{URL}/{other}/samples", json=batch(1))
    assert "is not live" in problem(refused, 409)
    problem(range_.client.post(f"{URL}/nowhere/samples", json=batch(1)), 404)
    assert range_.client.post(f"{URL}/{range_.id}/end").status_code == 200
    assert "accepts no samples" in problem(range_.push(batch(1)), 409)
    assert range_.lines()[-1]["e"] == "end"
    over = range_.client.get(f"{URL}/{range_.id}").json()
    assert over["live"]["counts"]["accepted"] == 0
    assert range_.client.get(f"{URL}/{other}").json()["live"] is None


def test_an_impossible_source_is_refused_before_the_flight(range_: Range) -> None:
    assert "UDP port 80" in problem(range_.start(udp=80), 422)
    flight = range_.start(udp=0).json()["id"]
    port = range_.client.get(f"{URL}/{flight}/samples").json()["udp"].split(":")[1]
    assert f"UDP port {port} of 127.0.0.1 is not available" in problem(
        range_.start(udp=int(port)), 422
    )
    assert "subtracted from the lead" in problem(range_.start(delay=10.0), 422)
    problem(range_.start(recording="nothing"), 404)


@pytest.mark.parametrize("guard", [{"udp_key": 20 * "k"}, {"udp_senders": ("127.0.0.1",)}, {}])
def test_a_server_with_tokens_needs_a_guard_of_datagrams(
    tmp_path: Path, guard: dict[str, Any]
) -> None:
    token = 20 * "t"
    with api(tmp_path, token=token, **guard) as client:
        client.headers["Authorization"] = f"Bearer {token}"
        client.headers["Origin"] = ADDRESS
        started = Range(client, tmp_path).start(udp=0)
    if guard:
        assert started.status_code == 201
    else:
        assert "FOREWARN_UDP_KEY" in problem(started, 422)


def test_a_person_accepts_another_sender_of_datagrams(range_: Range) -> None:
    assert "listen for datagrams" in problem(change_sender(range_, range_.id), 409)
    flight = range_.start(udp=0).json()["id"]
    assert change_sender(range_, flight).status_code == 204
    assert range_.client.get(f"{URL}/{flight}/samples").json()["sender"] == "10.0.0.7:4000"


def change_sender(range_: Range, flight: str) -> Any:
    body = {"sender": "10.0.0.7:4000", "by": "FTE"}
    return range_.client.post(f"{URL}/{flight}/sender", json=body)


def test_a_database_that_another_program_locks_delays_no_acknowledgement(range_: Range) -> None:
    with closing(sqlite3.connect(range_.root / "forewarn.db")) as other:
        other.execute("BEGIN EXCLUSIVE")
        assert range_.push(batch(1, n=5)).status_code == 200
        other.rollback()
    assert len(range_.client.get(f"{URL}/{range_.id}/assessments").json()["frames"]) == 5


def test_a_live_flight_continues_after_a_restart_of_the_server(tmp_path: Path) -> None:
    with api(tmp_path) as client:
        before = Range(client, tmp_path)
        before.push(batch(0, n=5))
    with api(tmp_path) as client:
        flight = client.get(f"{URL}/{before.id}").json()
        assert (flight["progress"], flight["head"], flight["state"]) == ("running", 4, "stale")
        answer = client.post(f"{URL}/{before.id}/samples", json=batch(1, first=5))
        assert answer.json()["accepted"] == 1


def test_an_interrupted_flight_without_its_journal_is_over(tmp_path: Path) -> None:
    with api(tmp_path) as client:
        before = Range(client, tmp_path)
        before.push(batch(0, n=5))
    (tmp_path / "live" / f"{before.id}.jsonl").unlink()
    with api(tmp_path) as client:
        refused = client.post(f"{URL}/{before.id}/samples", json=batch(1, first=5))
        assert "its journal is missing" in problem(refused, 409)
        assert client.post(f"{URL}/{before.id}/end").json()["progress"] == "interrupted"


def test_a_manoeuvre_is_started_manually_once(range_: Range) -> None:
    range_.id = range_.start(trim="detected").json()["id"]
    range_.push(batch(0, n=20))
    begin = f"{URL}/{range_.id}/manoeuvre"
    assert range_.client.post(begin, json={"by": "FTE"}).status_code == 204
    assert "manoeuvre 1 is in progress" in problem(range_.client.post(begin), 409)
    range_.push(batch(1, first=20))
    live = range_.client.get(f"{URL}/{range_.id}/samples").json()
    assert (live["manoeuvre"], live["begun"]) == (1, [{"number": 1, "t": 20 * DT}])
    assert [line["by"] for line in range_.lines() if line.get("e") == "manoeuvre"] == ["FTE"]


def test_a_deleted_flight_leaves_no_journal(range_: Range) -> None:
    range_.push(batch(1))
    range_.client.post(f"{URL}/{range_.id}/end")
    assert range_.client.delete(f"{URL}/{range_.id}").status_code == 204
    assert not [*(range_.root / "live").iterdir()]


def test_an_uplink_gets_acknowledgements_and_its_last_sequence(range_: Range) -> None:
    range_.push(batch(7))
    with range_.uplink() as socket:
        hello = msgspec.json.decode(socket.receive_text())
        assert (hello["type"], hello["last_sequence"]) == ("welcome", 7)
        for k in range(8, 20):
            socket.send_text(json.dumps(batch(k, first=k)))
        socket.send_text(json.dumps(batch(7)))
        stored, repeated = [], []
        while len(stored) < 13:
            message = msgspec.json.decode(socket.receive_text())
            assert message["type"] == "stored"
            stored += message["sequences"]
            repeated += message["repeated"]
        assert (stored, repeated) == ([*range(8, 20), 7], [7])
        assert {line["s"] for line in range_.lines() if "b" in line} == {*range(7, 20)}
        for text, refusal in (
            ("nonsense", (None, 422)),
            (json.dumps(batch(20, first=20) | {"p": ["x"]}), (20, 422)),
            (json.dumps(batch(7, first=20)), (7, 409)),
        ):
            socket.send_text(text)
            refused = msgspec.json.decode(socket.receive_text())
            assert refused["type"] == "refused"
            assert (refused["sequence"], refused["status"]) == refusal


def closed_with(socket: WebSocketTestSession) -> int:
    """Code by which the server closes, after what it still says."""
    try:
        while True:
            socket.receive_text()
    except WebSocketDisconnect as closed:
        return closed.code


def test_a_source_that_floods_with_nonsense_is_disconnected(range_: Range) -> None:
    with range_.uplink() as socket:
        for _ in range(MOST_MALFORMED):
            socket.send_text("nonsense")
        assert closed_with(socket) == 1008


def test_an_uplink_without_a_live_flight_is_closed_with_a_reason(range_: Range) -> None:
    with range_.uplink("nowhere") as socket:
        assert msgspec.json.decode(socket.receive_text())["type"] == "end"
        assert closed_with(socket) == 4404


def test_watchers_see_the_state_of_a_live_source(range_: Range) -> None:
    range_.push(batch(1, n=3))
    path = f"{URL}/{range_.id}/stream"
    with range_.client.websocket_connect(path, headers=HEADERS) as socket:
        hello = msgspec.json.decode(socket.receive_text())
    assert hello["live"]["last_sequence"] == 1
    assert hello["lead"] == pytest.approx(monitor().lead - hello["live"]["delay"])
    assert hello["mode"] == "live"
