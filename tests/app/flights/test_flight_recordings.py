"""A live flight becomes a recording when it is over: by its mapping, with its markers, once."""

import errno
import os
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from app.flights.flight_recordings import FlightRecordings
from app.recordings import flown_journal
from app.store.flights import INTERRUPTED
from app.store.tables import flights as flight_rows
from app.telemetry.journal import Journals
from core.channels import KEYS
from core.types import Array
from tests.app.flights.test_flights import monitor
from tests.support.api import api, problem, store_of
from tests.support.patience import PATIENCE
from tests.support.recorded import HEAD, csv_of, uploaded

FLIGHTS, RECORDINGS = "/api/v1/flights", "/api/v1/recordings"
DT = 0.05
N = 200


def samples(k: int) -> dict[str, Any]:
    """Sample k under our own names."""
    return {key: [0.001 * float(np.sin(0.7 * k + i))] for i, key in enumerate(KEYS)}


class Range:
    """A server with a monitor, and live flights that are pushed and ended."""

    def __init__(self, client: TestClient, root: Path) -> None:
        self.client, self.root = client, root
        self.store = store_of(client)
        known = self.store.monitors.all()
        self.monitor = known[0].id if known else self.store.monitors.add(monitor(), "doublet").id

    def start(self, name: str | None = None, **source: Any) -> str:
        source = {"kind": "live", "trim": "none"} | source
        body = {"source": source, "monitor": self.monitor, "name": name}
        answer = self.client.post(FLIGHTS, json={k: v for k, v in body.items() if v is not None})
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def push(self, flight: str, k: int, **values: Any) -> None:
        """Send sample k, or as many from there as there are values."""
        values = values or samples(k)
        n = len(next(iter(values.values())))
        sent = {"sequence": k, "t": [i * DT for i in range(k, k + n)]} | values
        assert self.client.post(f"{FLIGHTS}/{flight}/samples", json=sent).status_code == 200

    def push_all(self, flight: str, y: Array, first: int = 0, at_once: int = 1) -> None:
        """Send the samples y (n, 6) from the first one on."""
        for k in range(first, len(y), at_once):
            batch = y[k : k + at_once].T.tolist()
            self.push(flight, k, **dict(zip(KEYS, batch, strict=True)))

    def end(self, flight: str) -> dict[str, Any]:
        return self.client.post(f"{FLIGHTS}/{flight}/end").json()

    def flown(self) -> tuple[str, str]:
        """Fly a short flight to its end; its id and that of its recording."""
        flight = self.start()
        for k in range(20):
            self.push(flight, k)
        self.end(flight)
        return flight, self.recording_of(flight)["id"]

    def recording_of(self, flight: str) -> dict[str, Any]:
        """The recording that a flight became, as soon as it is there."""
        for _ in range(int(PATIENCE / 0.02)):
            if (found := self.client.get(f"{FLIGHTS}/{flight}").json()["recording"]) is not None:
                return self.client.get(f"{RECORDINGS}/{found}").json()
            sleep(0.02)
        raise AssertionError("the flight became no recording")


@pytest.fixture
def range_(tmp_path: Path) -> Iterator[Range]:
    with api(tmp_path) as client:
        yield Range(client, tmp_path)


def test_a_flight_that_ended_is_a_recording_that_is_scored_and_reported(range_: Range) -> None:
    flight = range_.start("first flight")
    for k in range(N):
        range_.push(flight, k)
    path = f"{FLIGHTS}/{flight}/markers"
    marked = range_.client.post(path, json={"kind": "abort", "by": "Ann", "text": "flutter"})
    assert range_.end(flight)["progress"] == "ended"
    recording = range_.recording_of(flight)
    assert recording["flight_id"] == flight
    assert (recording["name"], recording["format"]) == ("first flight", "journal")
    assert (recording["mapping_state"], recording["problem"]) == ("confirmed", None)
    assert [s["name"] for s in recording["contents"]["signals"]] == ["t", *KEYS, "arrived"]
    (marker,) = range_.client.get(f"{RECORDINGS}/{recording['id']}/markers").json()
    assert marker["t"] == marked.json()["t"] == (N - 1) * DT
    assert marker["text"] == "ABORT, Ann: flutter"
    scored = range_.client.post(
        f"{RECORDINGS}/{recording['id']}/scorings",
        json={"monitor": range_.monitor, "manoeuvres": "entire"},
    )
    assert scored.status_code == 201, scored.text
    report = range_.client.get(
        f"{RECORDINGS}/{recording['id']}/scorings/{scored.json()['id']}/report"
    )
    assert "ABORT, Ann: flutter" in report.text


def test_a_flight_without_a_sample_has_no_data_running_and_ended(range_: Range) -> None:
    flight = range_.start(trim="detected")
    running = range_.client.get(f"{FLIGHTS}/{flight}").json()
    assert (running["state"], running["status"]) == ("no_data", "no_data")
    ended = range_.end(flight)
    assert (ended["progress"], ended["status"], ended["level"]) == ("ended", "no_data", "advisory")


def test_it_is_read_by_the_mapping_that_the_flight_was_started_with(range_: Range) -> None:
    rows = np.array([[samples(k)[key][0] for key in KEYS] for k in range(N)])
    head = HEAD.replace("beta_rad", "AOS_deg").replace("t_s", "clock_s")
    first = uploaded(range_.client, csv_of(rows, DT, head), aircraft="PH-LAB")
    mapping = first["mapping"]
    mapping["channels"]["beta"] |= {"signal": "AOS_deg", "unit": "deg", "sign": -1}
    url = f"{RECORDINGS}/{first['id']}/mapping"
    assert range_.client.put(url, json={"mapping": mapping}).is_success
    names = dict(zip(KEYS, head.split(",")[1:], strict=True))
    flight = range_.start(recording=first["id"])
    for k in range(20):
        values = {names[key]: values for key, values in samples(k).items()}
        range_.push(flight, k, clock_s=[k * DT], **values)
    assert range_.client.delete(f"{RECORDINGS}/{first['id']}").status_code == 409
    range_.end(flight)
    recording = range_.recording_of(flight)
    assert recording["aircraft"] == "PH-LAB"
    assert recording["mapping"]["channels"]["beta"] == mapping["channels"]["beta"]
    assert recording["mapping"]["times"] == {"": {"signal": "clock_s", "unit": "s"} | {
        "rate": 0.0, "start": 0.0,
    }}  # fmt: skip
    assert recording["problem"] is None


def test_a_manoeuvre_that_was_marked_and_limits_that_were_put_in_force_are_markers(
    range_: Range,
) -> None:
    case = {"name": "all", "limits": {"Ny": 0.4}}
    limits = range_.client.post("/api/v1/limit-sets", json={"name": "envelope", "cases": [case]})
    flight = range_.start(trim="detected")
    for k in range(3):
        range_.push(flight, k)
    range_.client.post(f"{FLIGHTS}/{flight}/manoeuvre", json={"by": "FTE"})
    range_.push(flight, 3)
    asked = {"limit_set": limits.json()["limit_set"], "by": "Ben"}
    assert range_.client.put(f"{FLIGHTS}/{flight}/limits", json=asked).status_code == 200
    range_.push(flight, 4)
    range_.end(flight)
    recording = range_.recording_of(flight)["id"]
    markers = range_.client.get(f"{RECORDINGS}/{recording}/markers").json()
    assert [(marker["t"], marker["text"]) for marker in markers] == [
        (2 * DT, "manoeuvre begins, FTE"),
        (3 * DT, "limits in force, Ben: envelope version 1"),
    ]


def test_what_a_full_disk_refuses_is_made_at_the_next_start_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched, api(tmp_path) as client:  # until the server is down
        range_ = Range(client, tmp_path)
        patched.setattr(flown_journal.os, "link", full)
        patched.setattr(flown_journal.shutil, "copyfile", full)
        flight = range_.start()
        for k in range(5):
            range_.push(flight, k)
        range_.end(flight)
    assert "disk of the data directory is full" in caplog.text
    with api(tmp_path) as client:
        range_ = Range(client, tmp_path)
        recording = range_.recording_of(flight)["id"]
    with api(tmp_path) as client:
        range_ = Range(client, tmp_path)
        assert [one["id"] for one in client.get(RECORDINGS).json()] == [recording]
        assert client.delete(f"{RECORDINGS}/{recording}").status_code == 204
        assert client.get(f"{FLIGHTS}/{flight}").json()["recording"] is None
    with api(tmp_path) as client:
        assert client.get(RECORDINGS).json() == []


def test_the_recording_stays_when_its_flight_is_deleted(range_: Range) -> None:
    flight = range_.start()
    for k in range(5):
        range_.push(flight, k)
    range_.end(flight)
    recording = range_.recording_of(flight)["id"]
    assert range_.client.delete(f"{FLIGHTS}/{flight}").status_code == 204
    left = range_.client.get(f"{RECORDINGS}/{recording}").json()
    assert (left["flight_id"], left["problem"]) == (None, None)


def interrupted(range_: Range) -> str:
    """A flight whose server was killed, its record a little behind its journal."""
    flight = range_.start()
    for k in range(5):
        range_.push(flight, k)
    range_.end(flight)
    range_.recording_of(flight)
    with range_.store.engine.begin() as connection:
        values = {"status": INTERRUPTED, "recording_id": None}
        connection.execute(flight_rows.update().values(**values))
    return flight


def test_an_interrupted_flight_that_is_ended_is_completed_and_becomes_a_recording(
    range_: Range,
) -> None:
    flight = interrupted(range_)
    before = range_.client.get(f"{FLIGHTS}/{flight}").json()["ended"]
    ended = range_.client.post(f"{FLIGHTS}/{flight}/end", json={"by": "Ann"}).json()
    assert ended["progress"] == "ended"
    assert ended["end_reason"] == "the flight was ended by Ann"
    assert ended["ended"] > before
    assert range_.recording_of(flight)["contents"]["groups"][0]["n_rows"] == 5


def test_an_interrupted_flight_that_may_go_on_becomes_no_recording(range_: Range) -> None:
    flight = interrupted(range_)
    state: Any = range_.client.app.state  # pyright: ignore
    made = FlightRecordings(state.recordings, state.journals)
    assert made.make_now(flight) is None
    os.utime(state.journals.path(flight), (1e9, 1e9))
    assert made.make_now(flight) is not None


def test_an_interrupted_flight_of_long_ago_becomes_a_recording_and_takes_no_more(
    tmp_path: Path,
) -> None:
    with api(tmp_path) as client:
        flight = interrupted(Range(client, tmp_path))
    journal = Journals(tmp_path / "live").path(flight)
    os.utime(journal, (1e9, 1e9))
    with api(tmp_path) as client:
        range_ = Range(client, tmp_path)
        range_.recording_of(flight)
        answer = client.post(f"{FLIGHTS}/{flight}/samples", json={"t": [1.0]} | samples(9))
        assert "is a recording now" in problem(answer, 409)


def test_it_is_replayed_as_it_was_shown(range_: Range) -> None:
    flight = range_.start("first flight")
    for k in range(20):
        range_.push(flight, k)
    range_.end(flight)
    shown = range_.client.get(f"{FLIGHTS}/{flight}/assessments").json()["frames"]
    body = {"source": {"kind": "journal", "flight_id": flight}, "monitor": range_.monitor}
    replay = range_.client.post(FLIGHTS, json=body).json()
    assert (replay["name"], replay["mode"]) == ("first flight, as shown", "replay")
    frames = range_.client.get(f"{FLIGHTS}/{replay['id']}/source").json()["frames"]
    assert frames == shown


def test_a_flight_without_a_name_is_called_by_what_flew_and_when_and_says_its_beginning(
    range_: Range,
) -> None:
    flight = range_.start()
    for k in range(3):
        range_.push(flight, k)
    range_.end(flight)
    recording = range_.recording_of(flight)
    created = range_.client.get(f"{FLIGHTS}/{flight}").json()["created"]
    parts = recording["name"].split(", ")
    assert parts[-2:] == [f"flight {flight}", f"{created[:16].replace('T', ' ')} UTC"]
    assert "doublet" in parts[0]
    begins = datetime.fromisoformat(recording["contents"]["start"])
    assert abs((begins - datetime.fromisoformat(created)).total_seconds()) < PATIENCE
