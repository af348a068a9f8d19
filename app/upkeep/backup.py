"""A backup: database, recordings and journals of one moment in one file, made while serving.

The database is copied first, in one consistent state. After that, its recordings can only be
deleted and its journals can only grow, so both hold everything the copy refers to. If something
was deleted before it was copied, the backup starts again.
"""

import os
import sqlite3
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.recordings.files import RecordingFiles, sync
from app.recordings.flown_journal import journal_damage
from app.store.database import Damaged, StoreError, address, copy_database, file_of
from app.store.flights import FlightInfo
from app.store.recordings import RecordingInfo
from app.store.schema import current_revision, needs_upgrade
from app.store.store import NotFound, Store, open_store
from app.store.tables import now
from app.telemetry.journal import Journals
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
    """Something was deleted, or a flight resumed, after the database was copied."""


@dataclass(frozen=True)
class Backup:
    """A backup, written and verified."""

    path: Path
    size: int
    manifest: Manifest


def destination(path: Path) -> Path:
    """The file to write: `path`, or a file named by the time if `path` is a directory.

    A name without a suffix is a directory, made if it is missing. StoreError if the file exists.
    """
    if not path.suffix and path.parent.is_dir() and not path.exists():
        path.mkdir()
    if path.is_dir():
        time = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%fZ")
        path = path / f"forewarn-{time}{ENDING}"
    if path.exists():
        raise StoreError(f"{path} exists: give another name, or a directory")
    if not path.parent.is_dir():
        raise StoreError(f"{path.parent} is not a directory: create it first")
    return path


POSTGRESQL_WAY = "pg_dump first, then a copy of the data directory, which holds the recordings"


def back_up(url: str, data_dir: Path, path: Path) -> Backup:
    """Write a backup of a database and its data directory.

    path: see `destination`.

    The file appears only after it was read back and verified. StoreError.
    """
    path, database = destination(path), file_of(address(url))
    if database is None:
        raise StoreError(
            f"only SQLite databases are backed up: use the tools of your database, {POSTGRESQL_WAY}"
        )
    if current_revision(address(url)) is None:
        raise StoreError(f"{database} does not exist: give the --data-dir to back up")
    if needs_upgrade(address(url)):
        raise StoreError(f"{database} is from an older program: start `forewarn serve` once")
    part, copy = (path.with_name(f"{path.name}.{ending}") for ending in ("part", "part.db"))
    try:
        for _ in range(ATTEMPTS):
            with suppress(Changed):
                manifest = _write(url, data_dir, copy, part)
                with open_archive(part):  # reads and verifies every byte
                    pass
                os.replace(part, path)
                sync(path.parent)
                return Backup(path, path.stat().st_size, manifest)
    except OSError as error:
        if isinstance(error, StoreError):
            raise
        raise StoreError(f"{path} cannot be written ({error}): no backup was made") from error
    finally:
        for leftover in (
            part,
            copy,
            *(copy.with_name(copy.name + end) for end in ("-wal", "-shm")),
        ):
            leftover.unlink(missing_ok=True)
    raise StoreError(
        f"recordings or flights were deleted during each of {ATTEMPTS} attempts: try again after "
        "the deletions"
    )


def _write(url: str, data_dir: Path, copy: Path, part: Path) -> Manifest:
    files, journals = RecordingFiles(data_dir / RECORDINGS), Journals(data_dir / JOURNALS)
    copy_database(address(url), copy, "choose a place with space for twice the database")
    check_copy(copy)
    damaged: list[str] = []
    with part.open("wb") as file:
        os.chmod(part, 0o600)
        writer = ArchiveWriter(file)
        writer.add(DATABASE, copy)  # before opening it below
        with (
            closing(open_store(copy, recover=False)) as snapshot,
            closing(open_store(url, recover=False)) as live,
        ):
            for recording in snapshot.recordings.all():
                damaged += _add_recording(writer, files, snapshot, live, recording)
            for flight in snapshot.flights.all():
                damaged += _add_journal(writer, journals, live, flight)
            kinds = ("flights", "recordings", "monitors", "datasets")
            counts = {kind: len(getattr(snapshot, kind).all()) for kind in kinds}
            schema = snapshot.revision()
        about = __version__, schema, now(), counts
        manifest = Manifest(FORMAT, *about, writer.parts, damaged)
        writer.close(manifest)
        file.flush()
        os.fsync(file.fileno())
    return manifest


def _add_recording(
    writer: ArchiveWriter,
    files: RecordingFiles,
    snapshot: Store,
    live: Store,
    info: RecordingInfo,
) -> list[str]:
    """Add the folder of a recording; return the damaged or missing files. Changed."""
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
            damaged.append(f"recording {info.name}: the digest of its file does not match")
    required = {files.file(info.id): "file"} | {
        files.scorings(info.id) / f"{scoring}.npy": f"scoring {scoring}" for scoring in scorings
    }
    for path, part_name in required.items():
        if path not in added:
            _check_not_deleted(live, info.id, scorings)
            damaged.append(f"recording {info.name}: its {part_name} is missing")
    return damaged


def _add_journal(
    writer: ArchiveWriter, journals: Journals, live: Store, info: FlightInfo
) -> list[str]:
    """Add the journal of a live flight; return its damage. Changed."""
    if info.source.get("kind") != "live":
        return []
    path = journals.path(info.id)
    part = _add(writer, f"{JOURNALS}/{path.name}", path)
    damage = journal_damage(info, None if part is None else part.sha256)
    if not damage:
        return []
    try:
        is_resumed = live.flights.info(info.id).journal_digest != info.journal_digest
    except NotFound:
        raise Changed from None
    if is_resumed:
        raise Changed
    return [f"flight {info.id}: {damage}"]


def _add(writer: ArchiveWriter, name: str, path: Path) -> ArchivePart | None:
    """Add a file; None if it has been deleted."""
    try:
        return writer.add(name, path)
    except FileNotFoundError:
        return None


def _check_not_deleted(live: Store, recording_id: str, scorings: set[str]) -> None:
    """Raise Changed if the recording or one of its scorings was deleted since."""
    try:
        live.recordings.info(recording_id)
    except NotFound:
        raise Changed from None
    if scorings - live.scorings.ids(recording_id):
        raise Changed


def check_copy(copy: Path) -> None:
    """Check a database that no program is writing. Damaged."""
    uri = f"{copy.resolve().as_uri()}?immutable=1"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as database:
            lines = [str(row[0]) for row in database.execute("PRAGMA integrity_check")]
    except sqlite3.Error as error:
        lines = [str(error)]
    if lines != ["ok"]:
        raise Damaged(f"the database is damaged ({lines[0]}): restore a backup of it")
