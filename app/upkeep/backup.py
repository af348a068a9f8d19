"""A backup: database, recordings and journals of one moment in one file, while the server runs.

The database is copied first, as it is at one moment. What it knows of recordings does not change
after that but by deletion, and a journal only grows: it holds all that the database knows of its
flight. What was deleted before it was copied is told by the database, and the backup begins anew.
"""

import os
import sqlite3
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.live.journal import Journals
from app.recordings.files import RecordingFiles, sync
from app.store.database import Damaged, StoreError, address, copy_database, file_of
from app.store.flights import FlightInfo
from app.store.recordings import RecordingInfo
from app.store.schema import current_revision, needs_upgrade
from app.store.store import NotFound, Store, open_store
from app.store.tables import now
from app.upkeep.archive import (
    DATABASE,
    FORMAT,
    JOURNALS,
    RECORDINGS,
    ArchivePart,
    ArchiveWriter,
    Manifest,
    open_archive,
)
from core import __version__

ATTEMPTS = 5
ENDING = ".fwbackup"


class Changed(Exception):
    """Something was deleted after the database was copied."""


@dataclass(frozen=True)
class Backup:
    """A backup that was written and read again. damaged: what it holds as damaged as it was."""

    path: Path
    size: int
    manifest: Manifest
    damaged: list[str]


def destination(path: Path) -> Path:
    """The file to write: path itself, or one with the time in its name in the directory path.

    StoreError where it is there already.
    """
    if path.is_dir():
        time = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%fZ")
        path = path / f"forewarn-{time}{ENDING}"
    if path.exists():
        raise StoreError(f"{path} is there already: give another name, or a directory")
    if not path.parent.is_dir():
        raise StoreError(f"{path.parent} is no directory: make it first")
    return path


def back_up(url: str, data_dir: Path, path: Path) -> Backup:
    """Write a backup of a database and of what lies in the data directory.

    path: see `destination`.

    It comes into its place once it was read again and is as it was written. StoreError.
    """
    path, database = destination(path), file_of(address(url))
    if database is None:
        raise StoreError("only SQLite's database is backed up: use the tools of your database")
    if current_revision(address(url)) is None:
        raise StoreError(f"{database} is no database yet: give --data-dir of what is to be kept")
    if needs_upgrade(address(url)):
        raise StoreError(f"{database} is of an older program: start `forewarn serve` once")
    part, copy = (path.with_name(f"{path.name}.{ending}") for ending in ("part", "part.db"))
    try:
        for _ in range(ATTEMPTS):
            with suppress(Changed):
                manifest, damaged = _write(url, data_dir, copy, part)
                with open_archive(part) as archive:
                    archive.check()
                os.replace(part, path)
                sync(path.parent)
                return Backup(path, path.stat().st_size, manifest, damaged)
    except OSError as error:
        if isinstance(error, StoreError):
            raise
        raise StoreError(f"{path} cannot be written ({error}): nothing was kept of it") from error
    finally:
        for left in (part, copy, *(copy.with_name(copy.name + end) for end in ("-wal", "-shm"))):
            left.unlink(missing_ok=True)
    raise StoreError(
        f"recordings or flights were deleted during each of {ATTEMPTS} attempts: try again when "
        "that is over"
    )


def _write(url: str, data_dir: Path, copy: Path, part: Path) -> tuple[Manifest, list[str]]:
    files, journals = RecordingFiles(data_dir / RECORDINGS), Journals(data_dir / JOURNALS)
    copy_database(address(url), copy, "choose a place with space for twice the database")
    check_pages(copy)
    damaged: list[str] = []
    with part.open("wb") as file:
        os.chmod(part, 0o600)
        writer = ArchiveWriter(file)
        writer.add(DATABASE, copy)  # before it is opened to be read
        with (
            closing(open_store(copy, recover=False)) as snapshot,
            closing(open_store(url, recover=False)) as live,
        ):
            for recording in snapshot.recordings.all():
                damaged += _add_recording(writer, files, snapshot, live, recording)
            for flight in snapshot.flights.all():
                damaged += _add_journal(writer, journals, live, flight)
            counts = {
                "flights": len(snapshot.flights.all()),
                "recordings": len(snapshot.recordings.all()),
                "monitors": len(snapshot.monitors.all()),
                "datasets": len(snapshot.datasets.all()),
            }
            schema = snapshot.revision()
        manifest = Manifest(FORMAT, __version__, schema, now(), counts, writer.parts)
        writer.close(manifest)
        file.flush()
        os.fsync(file.fileno())
    return manifest, damaged


def _add_recording(
    writer: ArchiveWriter,
    files: RecordingFiles,
    snapshot: Store,
    live: Store,
    info: RecordingInfo,
) -> list[str]:
    """Add the folder of a recording; say what of it is damaged or missing. Changed."""
    scorings = snapshot.scorings.ids(info.id)
    folder = files.root / info.id
    added: set[Path] = set()
    damaged: list[str] = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        inside = path.relative_to(folder)
        if inside.parts[0] == "scorings" and path.name.partition(".")[0] not in scorings:
            continue
        part = _add(writer, f"{RECORDINGS}/{info.id}/{inside.as_posix()}", path)
        if part is not None:
            added.add(path)
        if part is not None and inside.name == "file" and part.sha256 != info.digest:
            damaged.append(f"recording {info.name}: its file's digest does not match")
    wanted = {files.file(info.id): "file"} | {
        files.scorings(info.id) / f"{one}.npy": f"scoring {one}" for one in scorings
    }
    for path, what in wanted.items():
        if path not in added:
            _see_that_it_is_there(live, info.id, scorings)
            damaged.append(f"recording {info.name}: its {what} is missing")
    return damaged


def _add_journal(
    writer: ArchiveWriter, journals: Journals, live: Store, info: FlightInfo
) -> list[str]:
    """Add the journal of a live flight; say that it is missing. Changed."""
    path = journals.path(info.id)
    if info.source.get("kind") != "live" or _add(writer, f"{JOURNALS}/{path.name}", path):
        return []
    try:
        live.flights.info(info.id)
    except NotFound:
        raise Changed from None
    return [f"flight {info.id}: its journal is missing"]


def _add(writer: ArchiveWriter, name: str, path: Path) -> ArchivePart | None:
    """Add a file; None where it is gone meanwhile."""
    try:
        return writer.add(name, path)
    except FileNotFoundError:
        return None


def _see_that_it_is_there(live: Store, recording_id: str, scorings: set[str]) -> None:
    """Changed, where the recording or one of its scorings was deleted since."""
    try:
        live.recordings.info(recording_id)
    except NotFound:
        raise Changed from None
    if scorings - live.scorings.ids(recording_id):
        raise Changed


def check_pages(copy: Path) -> None:
    """See that a database that nobody writes to is sound. Damaged."""
    uri = f"{copy.resolve().as_uri()}?immutable=1"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as database:
            lines = [str(row[0]) for row in database.execute("PRAGMA integrity_check")]
    except sqlite3.Error as error:
        lines = [str(error)]
    if lines != ["ok"]:
        raise Damaged(f"the database is damaged ({lines[0]}): restore a backup of it")
