"""What the repositories of the store share: one engine, short transactions, rows by id."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import fields
from threading import RLock
from typing import Any

from pydantic import ConfigDict
from sqlalchemy import Connection, Engine, Row, Select, Table, delete, insert, select, update

from app.store.database import reading, writing
from app.store.reserve import Reserve

TRANSACTION_BYTES = 4 * 2**20


class NotFound(LookupError):
    """There is nothing of this id."""


class InUse(ValueError):
    """What was to be deleted is needed by others. users: their names and ids."""

    def __init__(self, what: str, users: Iterable[tuple[str, str]]) -> None:
        self.users = tuple(users)
        named = ", ".join(f"{name} ({identity})" for name, identity in self.users[:5])
        more = f" and {len(self.users) - 5} more" if len(self.users) > 5 else ""
        super().__init__(f"{what} is used by {named}{more}: delete them first")


class KeptForEver(ValueError):
    """What was to be deleted is kept for ever."""


class Entry:
    """What a frozen dataclass of a row derives from: its docstrings describe its fields."""

    __pydantic_config__ = ConfigDict(use_attribute_docstrings=True)


class Writer:
    """What those that write to one database share: their turns, and space to delete.

    unfinished: what must be written before anything else, since the disk was full when it was due.
    """

    def __init__(self, reserve: Reserve) -> None:
        self.reserve = reserve
        self.unfinished: Callable[[], None] | None = None
        self._lock = RLock()

    @contextmanager
    def turn(self) -> Iterator[None]:
        """One writer at a time. StoreError where what is unfinished still cannot be written."""
        with self._lock:
            if (work := self.unfinished) is not None:
                self.unfinished = None
                try:
                    work()
                except BaseException:
                    self.unfinished = work
                    raise
            yield


class Repository:
    """The rows of one table family, reached through an engine from any thread.

    writer: what all repositories of an engine share.
    """

    def __init__(self, engine: Engine, writer: Writer) -> None:
        self._engine = engine
        self._writer = writer

    def _reading(self) -> AbstractContextManager[Connection]:
        return reading(self._engine)

    @contextmanager
    def _writing(self) -> Iterator[Connection]:
        """One writer at a time: SQLite lets others wait by polling, unfairly."""
        with self._writer.turn(), writing(self._engine) as connection:
            yield connection

    @contextmanager
    def _deleting(self) -> Iterator[Connection]:
        """As _writing, with the space that is held for deletions."""
        with (
            self._writer.turn(),
            self._writer.reserve.freed(self._engine),
            writing(self._engine) as connection,
        ):
            yield connection

    def _add_in_parts(
        self,
        table: Table,
        row: Mapping[str, Any],
        part_table: Table,
        parts: Iterable[dict[str, Any]],
    ) -> None:
        """Add a row with content too large for one short transaction.

        The row is `complete`, and so seen, once all parts are there. It is removed on failure; one
        that a dying process left behind is removed when the store opens.
        """
        with self._writing() as connection:
            connection.execute(insert(table).values(**row, complete=False))
        this = table.c.id == row["id"]
        try:
            for group in _transactions(parts):
                with self._writing() as connection:
                    connection.execute(insert(part_table), group)
            with self._writing() as connection:
                connection.execute(update(table).where(this).values(complete=True))
        except BaseException:
            with self._writing() as connection:
                connection.execute(delete(table).where(this))
            raise


def _transactions(parts: Iterable[dict[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    """Group parts by the size of their content."""
    group, size = [], 0
    for part in parts:
        group.append(part)
        size += len(part["content"])
        if size >= TRANSACTION_BYTES:
            yield group
            group, size = [], 0
    if group:
        yield group


def check_not_kept(connection: Connection, table: Table, what: str, identity: str) -> None:
    """KeptForEver; nothing for what is not there."""
    kept = connection.execute(select(table.c.keep).where(table.c.id == identity)).scalar()
    if kept:
        raise KeptForEver(f"{what} {identity} is kept for ever: release it first")


def columns(table: Table, entry: type) -> list[Any]:
    """The columns that an entry has fields of."""
    return [table.c[field.name] for field in fields(entry) if field.name in table.c]


def fetch(connection: Connection, query: Select, what: str, identity: str) -> Row:
    """The one row of a query; NotFound where there is none. what: its kind, in words."""
    row = connection.execute(query).one_or_none()
    if row is None:
        raise NotFound(f"there is no {what} {identity!r}: it was deleted, or never was")
    return row


def complete(table: Table, identity: str) -> Any:
    """Condition: the row of this id, once it is complete."""
    return (table.c.id == identity) & table.c.complete
