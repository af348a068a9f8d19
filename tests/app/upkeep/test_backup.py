"""Backups: of one moment, whole or refused, and put back whole or not at all."""

import hashlib
import json
import os
import signal
import sqlite3
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from app.settings import Settings
from app.store.store import Store, StoreError, open_store
from app.telemetry.journal import Journals
from app.upkeep import restore as module
from app.upkeep.archive import TRAILER_BYTES, WORD, open_archive
from app.upkeep.backup import back_up
from app.upkeep.restore import MOVES, finish, restore
from core.dataset import Dataset
from core.monitor import MonitorRecipe, train
from tests.support.api import api
from tests.support.forked_processes import PROCESSES
from tests.support.recorded import csv_of, kept_files, uploaded
from tests.support.stored import EVALUATION, append, assert_says_its_number, flown


class Kept:
    """A data directory, its backup, and what its database and files say."""

    def __init__(self, root: Path) -> None:
        self.root, self.data, self.backup = root, root / "data", root / "b.fwbackup"

    @property
    def url(self) -> str:
        return Settings(data_dir=self.data).url

    def back_up(self, name: str = "b.fwbackup") -> Path:
        return back_up(self.url, self.data, self.root / name).path


def content_of(data_dir: Path) -> tuple[list[str], dict[str, str]]:
    """Every row of the database but of the audit log, which is written a moment later than it is
    answered, and the digest of every file of the recordings and journals.
    """
    with sqlite3.connect(data_dir / "forewarn.db") as database:
        dumped = database.iterdump()
        rows = [row for row in dumped if not row.startswith('INSERT INTO "audit')]
    database.close()
    files = {
        str(path.relative_to(data_dir)): hashlib.sha256(path.read_bytes()).hexdigest()
        for root in ("recordings", "live")
        for path in (data_dir / root).rglob("*")
        if path.is_file()
    }
    return rows, files


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory, dataset: Dataset, flights: np.ndarray) -> Kept:
    """A flight, a recording and a scoring, backed up; nobody changes it."""
    kept = Kept(tmp_path_factory.mktemp("kept"))
    with api(kept.data) as client:
        store: Store = client.app.state.store  # pyright: ignore
        monitor = train(replace(dataset, recipe={}), MonitorRecipe(epsilon=0.2))
        tested = replace(monitor, evaluation=EVALUATION)
        monitor_id = store.monitors.add(tested, "oscillator").id
        flight = store.flights.add({"kind": "live"}, monitor_id, 0.3)
        journals: Journals = client.app.state.journals  # pyright: ignore
        journals.root.mkdir()
        journals.path(flight).write_bytes(b'{"format":1}\n{"b":')
        os.utime(journals.path(flight), (1e9, 1e9))
        append(store, flight, 0, 100)
        store.flights.end(flight)
        recording = uploaded(client, csv_of(flights[0]))["id"]
        path = f"/api/v1/recordings/{recording}/scorings"
        assert client.post(path, json={"monitor": monitor_id}).is_success
        kept.back_up()  # the server runs
    return kept


@pytest.fixture
def target(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "target")


def restored(kept: Kept, target: Settings, **how: bool) -> Path | None:
    return restore(kept.backup, target.data_dir, target.url, **how).aside


def test_what_is_restored_equals_what_was_backed_up(kept: Kept, target: Settings) -> None:
    assert restored(kept, target) is None
    assert content_of(target.data_dir) == content_of(kept.data)
    there = sorted(path.name for path in target.data_dir.iterdir())
    assert there == ["forewarn.db", "live", "recordings"]
    (journal,) = (target.data_dir / "live").iterdir()
    assert journal.stat().st_mtime == 1e9
    with api(target.data_dir) as client:
        (recording,) = client.get("/api/v1/recordings").json()
        path = f"/api/v1/recordings/{recording['id']}/scorings"
        assert len(client.get(path).json()) == 1
        assert client.app.state.integrity.damaged() == []  # pyright: ignore


def test_a_backup_is_of_one_moment_while_a_writer_writes(
    tmp_path: Path, target: Settings, dataset: Dataset
) -> None:
    kept = Kept(tmp_path)
    store = open_store(kept.url)
    flight, over, begun = flown(store, train(dataset)), threading.Event(), threading.Event()

    def write() -> None:
        first = 0
        while not over.is_set():
            append(store, flight, first, 50)
            first += 50
            begun.set()

    writer = threading.Thread(target=write)
    writer.start()
    assert begun.wait(30)
    backups = [kept.back_up(f"{k}.fwbackup") for k in range(3)]
    over.set()
    writer.join()
    store.close()
    heads = []
    for backup in backups:
        restore(backup, target.data_dir, target.url, replace=True)
        again = open_store(target.url, recover=False)
        stored = again.flights.assessments(flight)
        assert_says_its_number(stored, np.arange(len(stored.seq)))
        assert len(stored.seq) % 50 == 0
        assert again.damage() == []
        heads.append(len(stored.seq))
        again.close()
    assert heads == sorted(heads)
    assert heads[0] >= 50


def test_a_journal_that_is_missing_is_said(tmp_path: Path, dataset: Dataset) -> None:
    kept = Kept(tmp_path)
    store = open_store(kept.url)
    monitor = store.monitors.add(train(dataset), "oscillator").id
    flight = store.flights.add({"kind": "live"}, monitor, 0.3)
    store.close()
    (kept.data / "recordings").mkdir()
    told = back_up(kept.url, kept.data, tmp_path / "b.fwbackup")
    assert told.manifest.damaged == [f"flight {flight}: its journal is missing"]


def test_a_byte_changed_or_lost_anywhere_is_refused(
    kept: Kept, target: Settings, tmp_path: Path
) -> None:
    whole = kept.backup.read_bytes()
    copy = tmp_path / "copy"
    places = [*np.random.default_rng(5).integers(0, len(whole), 40), 0, len(whole) - 1]
    places += [len(whole) - TRAILER_BYTES - 1, len(whole) - TRAILER_BYTES]
    for place in map(int, places):
        damaged = bytearray(whole)
        damaged[place] ^= 1
        copy.write_bytes(damaged)
        with pytest.raises(StoreError, match=r"damaged|cut off, damaged"):
            restore(copy, target.data_dir, target.url)
    for short in (b"", whole[:-1], whole[: len(whole) // 2]):
        copy.write_bytes(short)
        with pytest.raises(StoreError, match=r"cut off, damaged"):
            restore(copy, target.data_dir, target.url)
    assert not target.data_dir.exists()


def resealed(kept: Kept, path: Path, **manifest: object) -> Path:
    """A backup whose manifest says something else, with a digest that matches."""
    content = kept.backup.read_bytes()[:-TRAILER_BYTES]
    with open_archive(kept.backup) as archive:
        known = archive.manifest
    for key, value in manifest.items():
        old, new = (f'"{key}": {json.dumps(one)}' for one in (getattr(known, key), value))
        assert len(old) == len(new)
        content = content.replace(old.encode(), new.encode())
    path.write_bytes(content + WORD + hashlib.sha256(content).hexdigest().encode())
    return path


@pytest.mark.parametrize("newer", [{"format": 9}, {"schema": "9999"}])
def test_a_backup_of_a_newer_program_is_refused(
    kept: Kept, target: Settings, tmp_path: Path, newer: dict[str, object]
) -> None:
    with pytest.raises(StoreError, match="upgrade Forewarn"):
        restore(resealed(kept, tmp_path / "newer", **newer), target.data_dir, target.url)
    assert not target.data_dir.exists()


def test_what_is_there_is_kept_aside_and_only_where_that_was_asked(
    kept: Kept, target: Settings
) -> None:
    store = open_store(target.url)
    job = store.jobs.add("a", {})
    store.close()
    with pytest.raises(StoreError, match="--replace"):
        restored(kept, target)
    aside = restored(kept, target, replace=True)
    assert aside is not None
    assert content_of(target.data_dir) == content_of(kept.data)
    old = open_store(aside / "forewarn.db", recover=False)
    assert [one.id for one in old.jobs.all()] == [job]
    old.close()


def test_a_database_that_a_server_has_open_is_not_replaced(kept: Kept, tmp_path: Path) -> None:
    with api(tmp_path / "served"):
        before = content_of(tmp_path / "served")
        settings = Settings(data_dir=tmp_path / "served")
        with pytest.raises(StoreError, match="stop the server"):
            restored(kept, settings, replace=True)
        assert content_of(tmp_path / "served") == before
    assert restored(kept, settings, replace=True) is not None


@pytest.mark.parametrize("n_moves", range(7))
def test_a_restore_that_dies_between_its_moves_is_completed_by_whoever_opens_next(
    kept: Kept, target: Settings, monkeypatch: pytest.MonkeyPatch, n_moves: int
) -> None:
    with api(target.data_dir):
        pass
    (target.data_dir / "recordings" / "mine").mkdir(parents=True)
    rename, moved = Path.rename, []

    def dies(source: Path, to: Path) -> Path:
        if len(moved) == n_moves:
            raise KeyboardInterrupt
        moved.append(source)
        return rename(source, to)

    with monkeypatch.context() as dying:
        dying.setattr(Path, "rename", dies)
        try:
            restored(kept, target, replace=True)
        except KeyboardInterrupt:
            assert n_moves < 6
            assert (target.data_dir / MOVES).exists()
    with api(target.data_dir) as client:
        assert len(client.get("/api/v1/recordings").json()) == 1
    assert not (target.data_dir / MOVES).exists()
    assert not finish(target.data_dir)
    assert kept_files(target.data_dir) >= kept_files(kept.data)
    (aside,) = target.data_dir.glob("replaced-*")
    names = {"forewarn.db", "forewarn.db.stop", "recordings"}
    assert {path.name for path in aside.iterdir()} == names


def test_what_was_made_in_the_middle_of_a_restore_is_not_lost_nor_taken_for_it(
    kept: Kept, target: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dies(source: Path, to: Path) -> Path:
        raise KeyboardInterrupt

    with monkeypatch.context() as dying:
        dying.setattr(Path, "rename", dies)
        with pytest.raises(KeyboardInterrupt):
            restored(kept, target)
    open_store(target.url).close()  # by a program that knows nothing of it
    with pytest.raises(StoreError, match="move it away"):
        finish(target.data_dir)
    (target.data_dir / "forewarn.db").unlink()
    out = target.data_dir.parent / "again"
    assert main(["backup", str(out), "--data-dir", str(target.data_dir)]) == 0
    assert content_of(target.data_dir) == content_of(kept.data)


def test_a_restore_that_fails_while_it_unpacks_changes_nothing(
    kept: Kept, target: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_store(target.url).close()
    before = content_of(target.data_dir)

    def full(path: Path) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(module, "sync", full)
    with pytest.raises(StoreError, match="nothing was changed"):
        restored(kept, target, replace=True)
    assert content_of(target.data_dir) == before
    assert not (target.data_dir / "restoring").exists()


def die_while_writing(data: Path, path: Path) -> None:
    """Back up, and be killed once the database is in the file."""
    from app.upkeep.archive import ArchiveWriter

    add = ArchiveWriter.add

    def added(writer: ArchiveWriter, name: str, source: Path) -> object:
        part = add(writer, name, source)
        os.kill(os.getpid(), signal.SIGKILL)
        return part

    ArchiveWriter.add = added  # pyright: ignore
    back_up(Settings(data_dir=data).url, data, path)


def test_a_kill_while_it_is_written_leaves_no_backup_and_the_next_one_clears_up(
    kept: Kept, tmp_path: Path
) -> None:
    path = tmp_path / "killed.fwbackup"
    process = PROCESSES.Process(target=die_while_writing, args=(kept.data, path))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert not path.exists()
    assert list(tmp_path.glob("killed.fwbackup.part*"))
    back_up(kept.url, kept.data, path)
    assert list(tmp_path.iterdir()) == [path]


def test_a_recording_deleted_meanwhile_makes_the_backup_begin_anew(
    tmp_path: Path, flights: np.ndarray, monkeypatch: pytest.MonkeyPatch, target: Settings
) -> None:
    from app.upkeep import backup as writing

    kept = Kept(tmp_path)
    with api(kept.data) as client:
        first, second = (uploaded(client, csv_of(y))["id"] for y in flights[:2])
        copy_database = writing.copy_database

        def copied(*arguments: object) -> None:
            copy_database(*arguments)  # pyright: ignore
            client.delete(f"/api/v1/recordings/{first}")

        monkeypatch.setattr(writing, "copy_database", copied)
        kept.back_up()
    restored(kept, target)
    again = open_store(target.url)
    assert [one.id for one in again.recordings.all()] == [second]
    again.close()


def test_a_damaged_recording_is_backed_up_as_it_is_and_reported(kept: Kept, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "target")
    restored(kept, settings)
    (file,) = (settings.data_dir / "recordings").glob("*/file")
    file.write_bytes(b"x")
    (samples,) = (settings.data_dir / "recordings").glob("*/scorings/*[!s].npy")
    samples.unlink()
    told = back_up(settings.url, settings.data_dir, tmp_path / "b").manifest.damaged
    assert len(told) == 2
    assert "digest" in told[0]
    assert "scoring" in told[1]


def test_backup_and_restore_on_the_command_line(
    kept: Kept, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "backups"  # made by the command
    assert main(["backup", f"{out}/", "--data-dir", str(kept.data), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    (backup,) = out.iterdir()
    assert (said["path"], said["size"]) == (str(backup), backup.stat().st_size)
    assert said["manifest"]["counts"]["recordings"] == 1
    assert main(["backup", str(backup), "--data-dir", str(kept.data)]) == 1
    assert "exists" in capsys.readouterr().err
    assert main(["backup", str(out), "--data-dir", str(tmp_path / "nothing")]) == 1
    assert "does not exist" in capsys.readouterr().err
    assert not (tmp_path / "nothing").exists()
    target = str(tmp_path / "target")
    assert main(["restore", str(backup), "--data-dir", target]) == 0
    assert "1 flights, 1 recordings" in capsys.readouterr().out
    assert main(["restore", str(out / "missing.fwbackup"), "--data-dir", target]) == 1
    assert "missing.fwbackup is not a file" in capsys.readouterr().err
    assert main(["restore", str(backup), "--data-dir", target]) == 1
    assert "--replace" in capsys.readouterr().err


def test_a_database_of_another_kind_is_left_to_its_own_tools(kept: Kept, tmp_path: Path) -> None:
    for call in (
        lambda: back_up("postgresql://host/db", tmp_path, tmp_path / "b"),
        lambda: restore(kept.backup, tmp_path, "postgresql://host/db"),
    ):
        with pytest.raises(StoreError, match="use the tools of your database"):
            call()
