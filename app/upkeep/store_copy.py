"""Copy the rows of a store to an empty database of either kind, verified, or none at all."""

import hashlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, Table, insert, select

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
from app.upkeep.archive import DATABASE
from core.counted import counted

ROWS_AT_ONCE = 100
"""A row holds up to 256 KiB."""


def store_address(place: str) -> URL:
    """URL of a database given by its URL, or by the data directory that holds it. StoreError."""
    return address(place if "://" in place else Path(place).expanduser() / DATABASE)


def copy_store(source: URL, target: URL) -> dict[str, int]:
    """Copy every row; return their numbers by table.

    StoreError, with the target as before, if a server has one of them open, if the target is not
    empty, or if what is read back differs.
    """
    if current_revision(source) is None:
        raise StoreError(f"{_name(source)} holds no store: give a data directory, or a URL")
    if needs_upgrade(source):
        raise StoreError(f"{_name(source)} is from an older program: start `forewarn serve` once")
    numbers: dict[str, int] = {}
    with ExitStack() as held:
        for url in (source, target):
            held.enter_context(owned(url, first=True))
        if current_revision(target) is not None:
            raise StoreError(f"{_name(target)} is not empty: give a new database or directory")
        held.enter_context(_emptied(target))
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
    return numbers


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
