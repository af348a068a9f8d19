"""Restoring a backup: whole or not at all; existing data is moved aside, not deleted.

Everything is first unpacked and checked next to its destination. Then a list of moves is written,
the moves are made, and the list is deleted. If the program dies in between, the next one that opens
the directory finds the list and finishes the moves.
"""

import json
import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.recordings.files import sync
from app.store.database import StoreError, address, file_of
from app.store.disk import ENDING
from app.store.schema import migrations, revisions
from app.upkeep.archive import DATABASE, JOURNALS, RECORDINGS, Archive, Manifest, open_archive
from app.upkeep.backup import check_copy
from core.whole_file import write_whole

MOVES, UNPACKED = "restore.json", "restoring"
BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


@dataclass(frozen=True)
class Restored:
    """Result of a restore. aside: where the earlier data was moved; None if there was none."""

    manifest: Manifest
    aside: Path | None


def restore(backup: Path, data_dir: Path, url: str, *, replace: bool = False) -> Restored:
    """Put database, recordings and journals of a backup into a data directory.

    replace: move existing data aside. StoreError, with nothing changed, if the backup is damaged
    or from a newer program, if a server has the database open, or if data exists without `replace`.
    """
    database = file_of(address(url))
    if database is None:
        raise StoreError("only SQLite databases are restored: use the tools of your database")
    data_dir = data_dir.absolute()
    with open_archive(backup) as archive:
        _check_schema(backup, archive.manifest)
        finish(data_dir)
        folders = [data_dir / RECORDINGS, data_dir / JOURNALS]
        ends = "", "-wal", "-shm", ENDING
        files = [database.with_name(database.name + end) for end in ends]
        existing = [path for path in (*files, *folders) if _has_content(path)]
        if existing and not replace:
            raise StoreError(
                f"{existing[0]} exists: give --replace to move it aside, or another --data-dir"
            )
        for directory in (data_dir, database.parent):
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        with _locked(database):
            unpacked = _unpack(archive, data_dir, database)
        aside = f"replaced-{datetime.now(UTC):%Y%m%dT%H%M%S%fZ}"
        with _locked(database):
            moves = [(path, path.parent / aside / path.name) for path in existing]
            moves += zip(unpacked, (*folders, database), strict=True)
            text = json.dumps([[str(old), str(new)] for old, new in moves])
            write_whole(data_dir / MOVES, text.encode())
            sync(data_dir)
        finish(data_dir)
        return Restored(archive.manifest, data_dir / aside if existing else None)


def finish(data_dir: Path) -> bool:
    """Finish the moves of an interrupted restore; return whether there were any.

    Each move is within one directory and is made only once.
    StoreError if another file was put at a destination in the meantime.
    """
    moves = data_dir / MOVES
    if not moves.is_file():
        return False
    for old, new in json.loads(moves.read_text()):
        source, target = Path(old), Path(new)
        if not source.exists():
            continue
        if _has_content(target):
            if source.parent.name == UNPACKED:
                raise StoreError(
                    f"{target} was created while a backup was being restored: move it away, then "
                    "start again"
                )
            continue  # already moved aside; the restored file has taken its place
        target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if target.is_dir():
            target.rmdir()  # empty
        with suppress(FileNotFoundError):  # another process makes the same moves
            source.rename(target)
        sync(target.parent)
        sync(source.parent)
        with suppress(OSError):  # not empty yet
            if source.parent.name == UNPACKED:
                source.parent.rmdir()
    moves.unlink(missing_ok=True)
    sync(data_dir)
    return True


def _check_schema(backup: Path, manifest: Manifest) -> None:
    known = revisions(migrations())
    if manifest.schema not in known:
        raise StoreError(
            f"{backup} has schema {manifest.schema}, this program reads up to {known[0]}: upgrade "
            "Forewarn; nothing was changed"
        )


def _unpack(archive: Archive, data_dir: Path, database: Path) -> tuple[Path, ...]:
    """Write all parts next to their destination and sync them to disk. StoreError.

    Returns the paths of recordings, journals and database; the journals may not exist.
    """
    places = [directory / UNPACKED for directory in (data_dir, database.parent)]
    recordings, copy = places[0] / RECORDINGS, places[1] / DATABASE
    _clear(places)
    try:
        for folder in (recordings, copy.parent):
            folder.mkdir(parents=True, mode=0o700, exist_ok=True)
        for part in archive.manifest.parts:
            path = copy if part.path == DATABASE else places[0] / part.path
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            archive.extract(part, path)
            path.chmod(0o600)
            sync(path)
        for folder in recordings.glob("*"):
            (folder / "scorings").mkdir(exist_ok=True)
        for folder in (*places[0].rglob("*/"), *places):
            sync(folder)
        check_copy(copy)
    except BaseException as error:
        _clear(places)
        if isinstance(error, OSError) and not isinstance(error, StoreError):
            raise StoreError(
                f"the backup cannot be unpacked ({error}); nothing was changed"
            ) from error
        raise
    return recordings, places[0] / JOURNALS, copy


def _clear(places: Iterable[Path]) -> None:
    for place in places:
        shutil.rmtree(place, ignore_errors=True)


def _has_content(path: Path) -> bool:
    return any(path.iterdir()) if path.is_dir() else path.exists()


@contextmanager
def _locked(database: Path) -> Iterator[None]:
    """Lock a database against other programs. StoreError if one has it open."""
    if not database.exists():
        yield
        return
    with closing(sqlite3.connect(database, timeout=0.2, isolation_level=None)) as connection:
        try:
            connection.execute("PRAGMA locking_mode = EXCLUSIVE")
            connection.execute("BEGIN IMMEDIATE")
        except sqlite3.Error as error:
            if getattr(error, "sqlite_errorcode", None) in BUSY:
                raise StoreError(
                    f"{database} is open in another program: stop the server; nothing was changed"
                ) from error
        yield
        if connection.in_transaction:
            connection.execute("ROLLBACK")
