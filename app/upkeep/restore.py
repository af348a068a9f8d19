"""Restoring a backup: whole or not at all, and what was there before is kept aside.

Everything is unpacked and checked beside its place first. Then a list of moves is written, the
moves are made, and the list is removed; a program that dies in between leaves the list, and whoever
opens the directory next makes the rest of the moves.
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
from app.store.schema import migrations, revisions
from app.upkeep.archive import DATABASE, JOURNALS, RECORDINGS, Archive, Manifest, open_archive
from app.upkeep.backup import check_pages
from core.whole_file import write_whole

MOVES, UNPACKED = "restore.json", "restoring"
BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


@dataclass(frozen=True)
class Restored:
    """What was restored. aside: where that is kept which was there before; None for nothing."""

    manifest: Manifest
    aside: Path | None


def restore(backup: Path, data_dir: Path, url: str, *, replace: bool = False) -> Restored:
    """Put database, recordings and journals of a backup into a data directory.

    replace: where something is there already, keep it aside. StoreError, and nothing was changed:
    for a backup that is damaged or of a newer program, a database that a server has open, and a
    directory that is not empty without `replace`.
    """
    database = file_of(address(url))
    if database is None:
        raise StoreError("only SQLite's database is restored: use the tools of your database")
    data_dir = data_dir.absolute()
    with open_archive(backup) as archive:
        _check_schema(backup, archive.manifest)
        finish(data_dir)
        folders = [data_dir / RECORDINGS, data_dir / JOURNALS]
        there = [path for path in (*_files_of(database), *folders) if _is_something(path)]
        if there and not replace:
            raise StoreError(
                f"{there[0]} is there already: give --replace, which keeps it aside, or another "
                "--data-dir"
            )
        for directory in (data_dir, database.parent):
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        with _alone(database):
            unpacked = _unpack(archive, data_dir, database)
        aside = f"replaced-{datetime.now(UTC):%Y%m%dT%H%M%S%fZ}"
        with _alone(database):
            moves = [(path, path.parent / aside / path.name) for path in there]
            moves += zip(unpacked, (*folders, database), strict=True)
            text = json.dumps([[str(old), str(new)] for old, new in moves])
            write_whole(data_dir / MOVES, text.encode())
            sync(data_dir)
        finish(data_dir)
        return Restored(archive.manifest, data_dir / aside if there else None)


def finish(data_dir: Path) -> bool:
    """Make the moves that a restore had begun; whether there were any.

    Each is a step within one directory, and none is made twice: what has moved is in its place.
    StoreError where something else was put there meanwhile.
    """
    moves = data_dir / MOVES
    if not moves.is_file():
        return False
    for old, new in json.loads(moves.read_text()):
        source, target = Path(old), Path(new)
        if not source.exists():
            continue
        if _is_something(target):
            if source.parent.name == UNPACKED:
                raise StoreError(
                    f"{target} was made while a backup was being restored: move it away, then "
                    "start again"
                )
            continue  # it is aside, and source is what came in its place
        target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if target.is_dir():
            target.rmdir()  # an empty one
        with suppress(FileNotFoundError):  # another process makes the same moves
            source.rename(target)
        sync(target.parent)
        sync(source.parent)
        with suppress(OSError):  # it holds what comes next
            if source.parent.name == UNPACKED:
                source.parent.rmdir()
    moves.unlink(missing_ok=True)
    sync(data_dir)
    return True


def _check_schema(backup: Path, manifest: Manifest) -> None:
    known = revisions(migrations())
    if manifest.schema not in known:
        raise StoreError(
            f"{backup} has schema {manifest.schema}, this program knows up to {known[0]}: a newer "
            "Forewarn wrote it, upgrade this one; nothing was changed"
        )


def _unpack(archive: Archive, data_dir: Path, database: Path) -> tuple[Path, ...]:
    """Write all parts beside their place, as the disk holds them. StoreError.

    Returns where recordings, journals and database are; there may be no journals.
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
        check_pages(copy)
    except BaseException as error:
        _clear(places)
        if isinstance(error, OSError) and not isinstance(error, StoreError):
            raise StoreError(f"it cannot be unpacked ({error}); nothing was changed") from error
        raise
    return recordings, places[0] / JOURNALS, copy


def _clear(places: Iterable[Path]) -> None:
    for place in places:
        shutil.rmtree(place, ignore_errors=True)


def _files_of(database: Path) -> list[Path]:
    return [database, *(database.with_name(database.name + end) for end in ("-wal", "-shm"))]


def _is_something(path: Path) -> bool:
    return any(path.iterdir()) if path.is_dir() else path.exists()


@contextmanager
def _alone(database: Path) -> Iterator[None]:
    """See that nobody has a database open, and keep others out. StoreError."""
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
