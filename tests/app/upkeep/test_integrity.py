"""What is stored is checked after a server starts; damage is reported."""

import logging
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from sqlalchemy import select, update
from starlette.testclient import TestClient

from app.recordings.files import RecordingFiles
from app.settings import Settings
from app.store.assessments import DIGEST_BYTES
from app.store.flights import DAMAGED
from app.store.store import Store, open_store
from app.store.tables import assessment_chunks, dataset_blocks, monitor_parts
from app.telemetry.journal import Journals
from app.upkeep import integrity
from app.upkeep.integrity import Integrity, Pace, Stopped
from core.dataset import Dataset
from core.monitor import train
from tests.support.api import api, problem, store_of
from tests.support.oscillator import Array
from tests.support.patience import until
from tests.support.recorded import RECORDINGS, csv_of, uploaded
from tests.support.stored import append, assert_says_its_number

WHOLE = {"monitor", "dataset", "recording", "scoring", "flight"}


PARTS = {"monitor": monitor_parts, "dataset": dataset_blocks, "flight": assessment_chunks}


class Kept(NamedTuple):
    data_dir: Path
    monitor: str
    dataset: str
    recording: str
    scoring: str
    flight: str

    @property
    def folder(self) -> Path:
        return self.data_dir / "recordings" / self.recording


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, dataset: Dataset, flights: Array) -> Kept:
    """One thing of each kind at a server that has stopped."""
    data_dir = tmp_path_factory.mktemp("whole")
    with api(data_dir) as client:
        plain = replace(dataset, recipe={})
        dataset_id = store_of(client).datasets.add(plain, "d").id
        monitor = store_of(client).monitors.add(train(plain), "m").id
        recording = uploaded(client, csv_of(flights[0]))["id"]
        path = f"{RECORDINGS}/{recording}/scorings"
        scoring = client.post(path, json={"monitor": monitor}).json()["id"]
        flight = store_of(client).flights.add({"kind": "test"}, monitor, 0.1)
        append(store_of(client), flight, 0, 30)
        store_of(client).flights.end(flight)
    return Kept(data_dir, monitor, dataset_id, recording, scoring, flight)


@pytest.fixture
def kept(whole: Kept, tmp_path: Path) -> Kept:
    """A copy of it that a test may damage."""
    return whole._replace(data_dir=shutil.copytree(whole.data_dir, tmp_path, dirs_exist_ok=True))


@pytest.fixture
def store(kept: Kept) -> Iterator[Store]:
    store = open_store(Settings(data_dir=kept.data_dir).url)
    yield store
    store.close()


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[-3] ^= 1
    file.write_bytes(content)


def spoil_rows(store: Store, table: Any) -> None:
    with store.engine.begin() as connection:
        connection.execute(update(table).values(content=b"something else"))


def corrupt_pages(file: Path) -> None:
    """Overwrite the first page of each index and table of flights and jobs."""
    with closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        size = connection.execute("PRAGMA page_size").fetchone()[0]
        roots = "SELECT rootpage FROM sqlite_master WHERE tbl_name IN ('flights', 'jobs')"
        pages = [row[0] for row in connection.execute(roots)]
    with file.open("r+b") as content:
        for page in pages:
            content.seek((page - 1) * size)
            content.write(b"\xa5" * size)


def integrity_of(store: Store, data_dir: Path) -> Integrity:
    return Integrity(store, RecordingFiles(data_dir / "recordings"), Journals(data_dir / "live"))


def checked(store: Store, kept: Kept) -> Integrity:
    known = integrity_of(store, kept.data_dir)
    known.check_all()
    return known


def test_what_is_whole_is_found_whole(kept: Kept, store: Store) -> None:
    known = checked(store, kept)
    assert (known.damaged(), known.n_checked) == ([], len(WHOLE))


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("recording", "file"),
        ("recording", "columns/0.f8"),
        ("recording", "digests.json"),
        ("scoring", "scorings/*.npy"),
        ("scoring", "scorings/*.tiles.npy"),
        ("monitor", ""),
        ("dataset", ""),
        ("flight", ""),
    ],
)
def test_what_is_damaged_is_found_and_logged(
    kept: Kept, store: Store, caplog: pytest.LogCaptureFixture, kind: str, name: str
) -> None:
    if name:
        flip(min(kept.folder.glob(name), key=lambda file: len(file.name)))
    else:
        spoil_rows(store, PARTS[kind])
    with caplog.at_level(logging.ERROR, "forewarn"):
        known = checked(store, kept)
    ((damage),) = known.damaged()
    assert (damage.kind, damage.id) == (kind, getattr(kept, kind))
    assert str(damage) in caplog.text
    assert known.n_checked == len(WHOLE)


def test_what_is_missing_is_damaged(kept: Kept, store: Store) -> None:
    (kept.folder / "file").unlink()
    assert "is missing" in checked(store, kept).damaged()[0].detail


def test_a_folder_that_lies_elsewhere_is_no_damage(kept: Kept, store: Store) -> None:
    other = Integrity(store, RecordingFiles(kept.data_dir / "another"), Journals(kept.data_dir))
    other.check_all()
    assert (other.damaged(), other.n_elsewhere(), other.n_checked) == ([], 1, len(WHOLE))
    kept.folder.rename(kept.data_dir / "moved")
    with api(kept.data_dir) as client:
        detail = problem(client.get(f"{RECORDINGS}/{kept.recording}"), 503)
        assert "another data directory" in detail
        assert "delete" not in detail
        assert client.delete(f"{RECORDINGS}/{kept.recording}").status_code == 204
    assert other.n_elsewhere() == 0


def test_files_that_the_database_does_not_list_are_counted(kept: Kept, store: Store) -> None:
    journals = Journals(kept.data_dir / "live")
    known = Integrity(store, RecordingFiles(kept.folder.parent), journals)
    known.check_all()
    assert known.n_unlisted() == 0
    newer = kept.folder.with_name("0123456789ab")
    newer.mkdir()
    journal = journals.path("ba9876543210")
    journal.parent.mkdir(exist_ok=True)
    journal.touch()
    known.check_all()
    assert (known.n_unlisted(), known.damaged()) == (2, [])
    newer.rmdir()
    journal.unlink()
    assert known.n_unlisted() == 0


def test_what_was_deleted_since_is_damaged_no_more(kept: Kept, store: Store) -> None:
    spoil_rows(store, dataset_blocks)
    known = checked(store, kept)
    assert known.n_damaged == 1
    store.datasets.delete(kept.dataset)
    assert (known.damaged(), known.n_damaged) == ([], 0)


def test_damaged_pages_are_found(kept: Kept) -> None:
    corrupt_pages(kept.data_dir / "forewarn.db")
    store = open_store(Settings(data_dir=kept.data_dir).url, recover=False)
    assert {damage.kind for damage in checked(store, kept).damaged()} == {"database"}
    store.close()


def test_a_check_that_is_told_to_stop_ends_at_its_next_rest() -> None:
    pace = Pace()
    pace.rest()
    pace.stopped.set()
    with pytest.raises(Stopped):
        pace.rest()


def test_a_server_that_stops_does_not_wait_for_the_check(kept: Kept) -> None:
    with api(kept.data_dir) as client:
        known = client.app.state.integrity  # pyright: ignore
        assert known.state == "begun"
    assert known.state == "stopped"
    assert known.n_checked < len(WHOLE)


def ended(client: TestClient) -> dict[str, Any]:
    def find() -> dict[str, Any]:
        answer = client.get("/api/v1/integrity").json()
        return {} if answer["state"] in ("begun", "checking") else answer

    return until(find)


def test_a_server_says_what_it_finds_damaged(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integrity, "BEGIN_AFTER_S", 0.0)
    flip(kept.folder / "file")
    with api(kept.data_dir) as client:
        answer = ended(client)
        (item,) = answer["damaged"]
        assert answer["elsewhere"] == 0
        assert (item["kind"], item["id"]) == ("recording", kept.recording)
        ready = client.get("/readyz")
        assert (ready.status_code, len(ready.json()["damaged"])) == (200, 1)
        assert "forewarn_damaged 1.0" in client.get("/metrics").text
        assert client.delete(f"{RECORDINGS}/{kept.recording}").status_code == 204
        assert client.get("/api/v1/integrity").json()["damaged"] == []


def test_a_damaged_monitor_is_not_served(kept: Kept, store: Store) -> None:
    spoil_rows(store, monitor_parts)
    with api(kept.data_dir) as client:
        problem(client.get(f"/api/v1/monitors/{kept.monitor}/file"), 500)


def test_a_server_with_damaged_pages_starts_and_is_not_ready(
    kept: Kept, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(integrity, "BEGIN_AFTER_S", 0.0)
    corrupt_pages(kept.data_dir / "forewarn.db")
    with api(kept.data_dir) as client:
        assert client.get("/healthz").status_code == 200
        assert problem(client.get("/readyz"), 503)
        ended(client)
        answer = client.get("/readyz")
        assert problem(answer, 503).startswith("the database is damaged")
        assert answer.json()["damaged"]
        assert problem(client.get("/api/v1/flights"), 500).startswith("the database")
        assert client.get("/api/v1/monitors").status_code == 200


def test_a_damaged_flight_is_refused_alone_and_can_be_deleted(kept: Kept, store: Store) -> None:
    spoil_rows(store, assessment_chunks)
    with api(kept.data_dir) as client:
        path = f"/api/v1/flights/{kept.flight}"
        answer = client.get(f"{path}/assessments")
        assert "restore a backup" in problem(answer, 500)
        assert answer.json()["type"] == "urn:forewarn:damaged"
        (flight,) = client.get("/api/v1/flights").json()
        assert (flight["status"], flight["reason"]) == ("invalid", DAMAGED[1])
        assert client.delete(path).status_code == 204


def test_flights_stored_without_digests_are_unverified(kept: Kept, store: Store) -> None:
    with store.engine.begin() as connection:
        content = connection.execute(select(assessment_chunks.c.content)).scalar_one()
        without = content[:-DIGEST_BYTES]
        connection.execute(update(assessment_chunks).values(content=without))
    known = checked(store, kept)
    assert (known.damaged(), known.unverified) == ([], {kept.flight})
    assert_says_its_number(store.flights.assessments(kept.flight), np.arange(30))
