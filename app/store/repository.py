"""Base of the store's repositories: one engine, short transactions, rows by id."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import fields
from threading import RLock
from typing import Annotated, Any, ClassVar, Generic, NamedTuple, TypeVar

from pydantic import ConfigDict, Field
from sqlalchemy import (
    ColumnElement,
    Connection,
    Engine,
    Row,
    Select,
    Table,
    delete,
    func,
    insert,
    literal,
    select,
    tuple_,
    update,
)

from app.store.database import StoreError, reading, writing
from app.store.disk import Reserve
from app.store.ownership import Ownership
from app.store.tables import flights

TRANSACTION_BYTES = 4 * 2**20
IDS_AT_ONCE = 500
"""Ids in one query."""
CREATED_ID = "~"
"""Between the time and the id of an entry."""


class NotFound(LookupError):
    """Nothing has this id."""


class InUse(ValueError):
    """The item to delete is used by others. users: their names and ids."""

    def __init__(self, what: str, users: Iterable[tuple[str, str]]) -> None:
        self.users = tuple(users)
        named = ", ".join(f"{name} ({identity})" for name, identity in self.users[:5])
        more = f" and {len(self.users) - 5} more" if len(self.users) > 5 else ""
        super().__init__(f"{what} is used by {named}{more}: delete them first")


class KeptPermanently(ValueError):
    """The item to delete is kept permanently."""


Time = Annotated[str, Field(description="UTC, ISO 8601")]


class Entry:
    """Base of dataclasses of a row: their docstrings describe the fields in the API."""

    __pydantic_config__ = ConfigDict(use_attribute_docstrings=True)


E = TypeVar("E", bound=Entry)


class Page(NamedTuple, Generic[E]):
    """Part of a list.   after: position after which the next part begins; empty at the end."""

    entries: list[E]
    after: str


class Writer:
    """Shared by all writers of a database: the lock, and reserved space for deletions.

    unfinished: work to write before anything else, left over because the disk was full.
    """

    def __init__(self, reserve: Reserve) -> None:
        self.reserve = reserve
        self.unfinished: Callable[[], None] | None = None
        self.n_turns = 0
        self.ownership: Ownership | None = None
        self._lock = RLock()

    @contextmanager
    def turn(self) -> Iterator[None]:
        """Let one thread write at a time.

        StoreError if unfinished work still cannot be written, or if the database is another
        server's now.
        """
        with self._lock:
            if self.ownership is not None and self.ownership.fault:
                raise StoreError(self.ownership.fault)
            if (work := self.unfinished) is not None:
                self.unfinished = None
                try:
                    work()
                except BaseException:
                    self.unfinished = work
                    raise
            self.n_turns += 1
            yield


class Repository:
    """Rows of one table family; usable from any thread.

    Methods that take an id raise NotFound if nothing has it.   writer: shared per engine.
    on_change: called, in any thread, after a change that lists of flights or campaigns show.
    """

    def __init__(self, engine: Engine, writer: Writer) -> None:
        self._engine = engine
        self._writer = writer
        self.on_change: Callable[[], object] = lambda: None

    def _reading(self) -> AbstractContextManager[Connection]:
        return reading(self._engine)

    @contextmanager
    def _writing(self) -> Iterator[Connection]:
        """One writer at a time: SQLite itself makes others wait by polling, which is unfair."""
        with self._writer.turn(), writing(self._engine) as connection:
            yield connection

    @contextmanager
    def _deleting(self) -> Iterator[Connection]:
        """Like _writing, with the space reserved for deletions."""
        with (
            self._writer.turn(),
            self._writer.reserve.freed(self._engine),
            writing(self._engine) as connection,
        ):
            yield connection

    def _add_numbered(self, table: Table, flight_id: str, thing: Any, **others: Any) -> None:
        """Store a thing of a flight; one already stored under its number is left unchanged.

        others: values of columns that differ from its fields.
        """
        row = {column.name: getattr(thing, column.name) for column in columns(table, type(thing))}
        existing = select(table.c.number).where(
            table.c.flight_id == flight_id, table.c.number == thing.number
        )
        with self._writing() as connection:
            require(connection, flights, flight_id)
            if connection.execute(existing).first() is None:
                connection.execute(insert(table).values(flight_id=flight_id, **row | others))

    def _by_flight(
        self, query: Select, flight_ids: Iterable[str]
    ) -> dict[str, list[dict[str, Any]]]:
        """Rows of flights by their `flight_id`; flights without any are absent."""
        wanted, by_flight = [*set(flight_ids)], defaultdict[str, list[dict[str, Any]]](list)
        flight_id = query.selected_columns["flight_id"]
        with self._reading() as connection:
            for first in range(0, len(wanted), IDS_AT_ONCE):
                some = flight_id.in_(wanted[first : first + IDS_AT_ONCE])
                for row in connection.execute(query.where(some)):
                    by_flight[row.flight_id].append(dict(row._mapping))
        return dict(by_flight)

    def _add_in_parts(
        self,
        table: Table,
        row: Mapping[str, Any],
        part_table: Table,
        parts: Iterable[dict[str, Any]],
    ) -> None:
        """Add a row whose content is too large for one short transaction.

        The row becomes `complete`, and so visible, with its last part. It is deleted on failure;
        a row left by a process that died is deleted when the store opens.
        """
        with self._writing() as connection:
            connection.execute(insert(table).values(**row, complete=False))
        is_row = table.c.id == row["id"]
        try:
            for group in _transactions(parts):
                with self._writing() as connection:
                    connection.execute(insert(part_table), group)
            with self._writing() as connection:
                connection.execute(update(table).where(is_row).values(complete=True))
        except BaseException:
            with self._writing() as connection:
                connection.execute(delete(table).where(is_row))
            raise


class Entries(Repository, Generic[E]):
    """Rows of a table as entries with an id; content that is not `complete` is hidden.

    parts: table of their content.
    """

    table: ClassVar[Table]
    parts: ClassVar[Table]
    entry: type[E]

    def info(self, identity: str) -> E:
        with self._reading() as connection:
            return self._fetch(connection, identity)

    def all(self) -> list[E]:
        """All entries, newest first."""
        with self._reading() as connection:
            return [self._entry(row) for row in connection.execute(self._newest_first())]

    def page(self, limit: int, after: str = "", *conditions: ColumnElement[bool]) -> Page[E]:
        """At most `limit` entries that meet the conditions, newest first.

        after: of the part before, which may have been deleted since.
        """
        if after:
            created, _, identity = after.partition(CREATED_ID)
            place = tuple_(self.table.c.created, self.table.c.id)
            conditions = (*conditions, place < tuple_(literal(created), literal(identity)))
        query = self._newest_first(*conditions).limit(limit + 1)
        with self._reading() as connection:
            rows = connection.execute(query).all()
        entries = [self._entry(row) for row in rows[:limit]]
        last = rows[limit - 1] if len(rows) > limit else None
        return Page(entries, f"{last.created}{CREATED_ID}{last.id}" if last else "")

    def sizes(self) -> dict[str, int]:
        """Bytes in the database by id."""
        size, (owner, *_) = func.sum(func.length(self.parts.c.content)), self.parts.primary_key
        with self._reading() as connection:
            rows = connection.execute(select(owner, size).group_by(owner))
            return {identity: int(size) for identity, size in rows}

    def keep(self, identity: str, keep: bool) -> None:
        """Keep a row permanently, or release it."""
        with self._writing() as connection:
            require(connection, self.table, identity)
            is_row = self.table.c.id == identity
            connection.execute(update(self.table).where(is_row).values(keep=keep))

    def recover(self) -> None:
        """Delete partly stored rows of a process that died."""
        with self._deleting() as connection:
            connection.execute(delete(self.table).where(~self.table.c.complete))

    def _newest_first(self, *conditions: ColumnElement[bool]) -> Select:
        created, identity = self.table.c.created, self.table.c.id
        return self._query().where(*conditions).order_by(created.desc(), identity.desc())

    def _query(self) -> Select:
        query = select(*columns(self.table, self.entry))
        return query.where(self.table.c.complete) if "complete" in self.table.c else query

    def _entry(self, row: Row) -> E:
        return self.entry(**row._mapping)

    def _fetch(self, connection: Connection, identity: str) -> E:
        query = self._query().where(self.table.c.id == identity)
        return self._entry(fetch(connection, query, kind_of(self.table), identity))


def _transactions(parts: Iterable[dict[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    group, size = [], 0
    for part in parts:
        group.append(part)
        size += len(part["content"])
        if size >= TRANSACTION_BYTES:
            yield group
            group, size = [], 0
    if group:
        yield group


def check_deletable(connection: Connection, table: Table, identity: str) -> None:
    """Raise KeptPermanently if the row has the flag `keep`."""
    keep = connection.execute(select(table.c.keep).where(table.c.id == identity)).scalar()
    if keep:
        raise KeptPermanently(f"{kind_of(table)} {identity} is kept permanently: release it first")


def columns(table: Table, entry: type) -> list[Any]:
    return [table.c[field.name] for field in fields(entry) if field.name in table.c]


def fetch(connection: Connection, query: Select, kind: str, identity: str) -> Row:
    """The only row of a query. NotFound.   kind: in words, for the message."""
    row = connection.execute(query).one_or_none()
    if row is None:
        raise NotFound(f"there is no {kind} {identity!r}: it was deleted or never existed")
    return row


def require(connection: Connection, table: Table, identity: str) -> None:
    """Raise NotFound unless a complete row has this id."""
    query = select(table.c.id).where(table.c.id == identity)
    query = query.where(table.c.complete) if "complete" in table.c else query
    fetch(connection, query, kind_of(table), identity)


def kind_of(table: Table) -> str:
    """Name of one row of a table, for messages."""
    return table.name.removesuffix("s").replace("_", " ")
