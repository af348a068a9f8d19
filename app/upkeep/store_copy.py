"""Copy a store to an empty database of either kind, whole and verified or not at all.

Between two data directories the recordings and journals are copied too.
"""

import hashlib
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, Table, insert, select

from app.recordings.files import digest_of
from app.recordings.flown_journal import link_or_copy
from app.store.database import (
    StoreError,
    address,
    continue_numbers,
    file_of,
    make_engine,
    reading,
    writing,
)
from app.store.ownership import owned
from app.store.schema import create_tables, current_revision, needs_upgrade
from app.store.tables import metadata
from app.upkeep.archive import DATABASE, JOURNALS, RECORDINGS
from core.counted import counted

ROWS_AT_ONCE = 100
"""A row holds up to 256 KiB."""


def folder_of(place: str) -> Path | None:
    """The data directory that a place names; None for the URL of a database."""
    return None if "://" in place else Path(place).expanduser()


def store_address(place: str) -> URL:
    """URL of a database given by its URL, or by the data directory that holds it. StoreError."""
    folder = folder_of(place)
    return address(place if folder is None else folder / DATABASE)


def copy_store(
    source: URL, target: URL, folders: tuple[Path, Path] | None = None
) -> tuple[dict[str, int], int]:
    """Copy every row; return their numbers by table, and the number of copied files.

    folders: data directories, to copy recordings and journals too.
    StoreError, with the target as before, if a server has one of them open, if the target is not
    empty, or if what is read back differs.
    """
    if current_revision(source) is None:
        raise StoreError(f"{_name(source)} holds no store: give a data directory, or a URL")
    if needs_upgrade(source):
        raise StoreError(f"{_name(source)} is from an older program: start `forewarn serve` once")
    numbers: dict[str, int] = {}
    n_files = 0
    with ExitStack() as held:
        for url in (source, target):
            held.enter_context(owned(url, first=True))
        if current_revision(target) is not None:
            raise StoreError(f"{_name(target)} is not empty: give a new database or directory")
        held.enter_context(_emptied(target))
        if folders is not None:
            n_files = held.enter_context(_copied_files(*folders))
        rows = held.enter_context(reading(held.enter_context(_verbatim(source))))
        into = held.enter_context(writing(held.enter_context(_verbatim(target))))
        create_tables(into)
        for table in metadata.sorted_tables:
            given, stored = Digest(), Digest()
            for batch in _batches(rows, table):
                given.add(batch)
                into.execute(insert(table), [dict(row._mapping) for row in batch])
            for batch in _batches(into, table):
                stored.add(batch)
            if stored != given:
                raise StoreError(
                    f"{table.name} of {_name(target)} differs from what was copied "
                    f"({counted(stored.n_rows, 'row')} for {given.n_rows}): nothing was kept"
                )
            numbers[table.name] = given.n_rows
        continue_numbers(into, metadata.sorted_tables)
    return numbers, n_files


def n_files_of(folder: Path) -> int:
    """Number of files of recordings and journals in a data directory."""
    return len(_files_of(folder))


def _files_of(folder: Path) -> list[Path]:
    within = (path for name in (RECORDINGS, JOURNALS) for path in (folder / name).rglob("*"))
    incoming = folder / RECORDINGS / "incoming"
    return sorted(path for path in within if path.is_file() and incoming not in path.parents)


@contextmanager
def _copied_files(source: Path, target: Path) -> Iterator[int]:
    """Copy recordings and journals; yields the number of files. Removes them if the copy fails."""
    places = [target / name for name in (RECORDINGS, JOURNALS)]
    for place in places:
        if place.is_dir() and any(place.iterdir()):
            raise StoreError(f"{place} is not empty: give a new directory")
    copies, files = dict[tuple[int, int], Path](), _files_of(source)
    try:
        for path in files:
            copy, status = target / path.relative_to(source), path.stat()
            copy.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            same = copies.setdefault((status.st_dev, status.st_ino), copy)
            link_or_copy(same, copy) if same is not copy else shutil.copyfile(path, copy)
            os.utime(copy, (status.st_mtime, status.st_mtime))
            copy.chmod(0o600)
            if digest_of(copy) != digest_of(path):
                raise StoreError(f"{copy} differs from {path}: nothing was kept")
        for folder in (target / RECORDINGS).glob("*"):
            (folder / "scorings").mkdir(exist_ok=True)
        yield len(files)
    except BaseException as error:
        for place in places:
            shutil.rmtree(place, ignore_errors=True)
        if isinstance(error, OSError) and not isinstance(error, StoreError):
            raise StoreError(f"{target} cannot be written ({error}): nothing was kept") from error
        raise


class Digest:
    """Number and digest of rows in any order: databases sort text differently."""

    def __init__(self) -> None:
        self.n_rows, self.total = 0, 0

    def add(self, rows: list[Any]) -> None:
        for row in rows:
            digest = hashlib.sha256()
            for value in row:
                content = value if isinstance(value, bytes) else repr(value).encode()
                digest.update(f"{type(value).__name__} {len(content)} ".encode() + content)
            self.total = (self.total + int.from_bytes(digest.digest())) % 2**256
        self.n_rows += len(rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Digest) and vars(self) == vars(other)


def _batches(connection: Connection, table: Table) -> Iterator[list[Any]]:
    query = select(table).execution_options(yield_per=ROWS_AT_ONCE)
    for batch in connection.execute(query).partitions():
        yield list(batch)


@contextmanager
def _emptied(target: URL) -> Iterator[None]:
    """Remove the files of a new SQLite database if the copy fails."""
    try:
        yield
    except BaseException:
        if (file := file_of(target)) is not None:
            for ending in ("", "-wal", "-shm"):
                file.with_name(f"{file.name}{ending}").unlink(missing_ok=True)
        raise


@contextmanager
def _verbatim(url: URL) -> Iterator[Engine]:
    """An engine that gives and takes JSON as the text that is stored."""
    engine = make_engine(
        url,
        json_serializer=str,
        json_deserializer=lambda text: text if isinstance(text, str) else text.decode(),
    )
    try:
        yield engine
    finally:
        engine.dispose()


def _name(url: URL) -> str:
    return str(file_of(url) or url.render_as_string(hide_password=True))
