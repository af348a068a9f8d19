"""Markers of a flight: shown at once, stored before they are answered, and nothing else."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest

from app.flights.flight import MARKERS_KEPT
from app.messages import Hello
from app.store.store import StoreError, open_store
from core.flight_events import FLIGHT_MARKERS
from tests.app.routes.test_flight_stream import URL, Server, until
from tests.support.api import api, problem
from tests.support.flying import Flown, exact_monitor, failing_flight


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with api(tmp_path) as client:
        yield Server(client)


def markers_of(messages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [message["marker"] for message in messages if message["type"] == "marker"]


def test_markers_are_told_stored_kept_and_repeated_and_the_flight_goes_on(
    server: Server, tmp_path: Path
) -> None:
    flight = server.start()["id"]
    path = f"{URL}/{flight}/markers"
    server.advance(1.0)
    with server.watch(flight) as socket:
        assert Hello.model_validate_json(socket.receive_text()).markers == []
        body = {"kind": "abort", "by": "test conductor", "text": "bang"}
        answer = server.client.post(path, json=body)
        told = markers_of(until(socket, lambda m: bool(m.get("marker", {}).get("stored"))))
        until(socket, lambda m: m["type"] == "status" and m["call"]["stored"])
    assert answer.status_code == 201
    marker = answer.json()
    assert [one["stored"] for one in told] == [False, True]
    assert told[1] == marker
    asked = {key: marker[key] for key in ("kind", "by", "text", "word", "seq", "t", "level")}
    assert asked == {**body, "word": "ABORT", "seq": 20, "t": 1.0, "level": "warning"}
    server.client.post(path, json={"kind": "knock_it_off"})
    listed = server.client.get(path).json()
    assert [(one["number"], one["word"]) for one in listed] == [(1, "ABORT"), (2, "KNOCK IT OFF")]
    assert listed[1]["by"] == "local"
    status = server.client.get(f"{URL}/{flight}").json()
    assert (status["progress"], status["transport"]["playing"]) == ("running", True)
    with server.watch(flight) as socket:
        hello = msgspec.json.decode(socket.receive_text())
    assert hello["markers"] == listed
    assert (hello["call"], status["call"]) == (listed[0], listed[0])  # the more urgent one
    assert [kind["kind"] for kind in hello["marker_kinds"]] == list(FLIGHT_MARKERS)
    server.client.post(f"{URL}/{flight}/end")
    assert server.client.get(path).json() == listed
    problem(server.client.post(path, json={"kind": "abort"}), 404)
    again = open_store(tmp_path / "forewarn.db", recover=False)
    assert [one.kind for one in again.flight_markers.of(flight)] == ["abort", "knock_it_off"]
    again.close()
    assert server.client.delete(f"{URL}/{flight}").status_code == 204
    problem(server.client.get(path), 404)


def test_an_event_has_words_and_the_time_it_is_about(server: Server) -> None:
    flight = server.start()["id"]
    path = f"{URL}/{flight}/markers"
    server.advance(1.0)
    body = {"kind": "event", "text": "chase saw vapour", "t": 0.6}
    marker = server.client.post(path, json=body).json()
    assert (marker["t"], marker["seq"], marker["text"]) == (0.6, 20, "chase saw vapour")
    assert marker["level"] == "none"
    assert "1 s" in problem(server.client.post(path, json=body | {"t": 9.0}), 409)
    assert len(server.client.get(path).json()) == 1


def test_a_marker_that_the_store_refuses_is_shown_and_stored_later(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = server.start()["id"]
    path = f"{URL}/{flight}/markers"

    def refuse(*_: Any) -> None:
        raise StoreError("the disk is full")

    with server.watch(flight) as socket, monkeypatch.context() as broken:
        broken.setattr(server.flights.store.flight_markers, "add", refuse)
        detail = problem(server.client.post(path, json={"kind": "abort"}), 503)
        assert "ABORT is on every screen but not stored yet (the disk is full)" in detail
        (told,) = markers_of(until(socket, lambda m: m["type"] == "marker"))
        assert (told["word"], told["stored"]) == ("ABORT", False)
        assert [one["stored"] for one in server.client.get(path).json()] == [False]
        assert server.flights.flying(flight).recorder.waiting_words.endswith("1 marker")
    assert server.client.post(f"{URL}/{flight}/end").status_code == 200
    assert [one["stored"] for one in server.client.get(path).json()] == [True]


def test_a_marker_never_waits_for_a_locked_database(server: Server, tmp_path: Path) -> None:
    flight = server.start()["id"]
    path = f"{URL}/{flight}/markers"
    with (
        server.watch(flight) as socket,
        closing(sqlite3.connect(tmp_path / "forewarn.db")) as other,
    ):
        other.execute("BEGIN EXCLUSIVE")
        answer = server.client.post(path, json={"kind": "abort"})
        assert (answer.status_code, answer.json()["stored"]) == (201, False)
        (told,) = markers_of(until(socket, lambda m: m["type"] == "marker"))
        assert (told["word"], told["stored"]) == ("ABORT", False)
        with server.watch(flight) as late:
            assert not msgspec.json.decode(late.receive_text())["markers"][0]["stored"]
        other.rollback()
        (told,) = markers_of(until(socket, lambda m: m["type"] == "marker"))
    assert told["stored"]
    assert [one["stored"] for one in server.client.get(path).json()] == [True]


@pytest.mark.parametrize(
    "body",
    [
        {"kind": "terminate"},
        {"kind": "abort", "by": ""},
        {"kind": "abort", "t": 1.0},
        {"kind": "event"},
        {"kind": "event", "text": " "},
        {},
    ],
)
def test_what_is_no_marker_is_refused(server: Server, body: dict[str, Any]) -> None:
    flight = server.start()["id"]
    problem(server.client.post(f"{URL}/{flight}/markers", json=body), 422)
    assert server.client.get(f"{URL}/{flight}/markers").json() == []


def test_markers_that_wait_for_the_store_are_never_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flown = Flown(exact_monitor(), failing_flight())
    with monkeypatch.context() as patch:
        patch.setattr(flown.recorder, "_store_alarms_soon", lambda _: None)
        first = flown.flight.mark("abort", "crew", None)
    stored = [flown.flight.mark("abort", "crew", None) for _ in range(2 * MARKERS_KEPT)]
    newest = [marker.number for marker in stored[-MARKERS_KEPT:]]
    assert list(flown.flight.markers) == [first.number, *newest]
    assert newest[-1] == 2 * MARKERS_KEPT + 1


def test_words_and_keys_tell_the_kinds_apart_and_none_says_terminate() -> None:
    kinds = FLIGHT_MARKERS.values()
    assert len({kind.word for kind in kinds}) == len({kind.shortcut for kind in kinds}) == 4
    assert "terminate" not in " ".join(f"{kind.word} {kind.meaning}" for kind in kinds).lower()
