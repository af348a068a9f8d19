"""The database behind the store: URL, engine and transactions; SQLite by default, or PostgreSQL.

All SQL that only one of them understands is in this file; the lock of a server is in `ownership`.
"""

import os
import sqlite3
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial
from importlib.util import find_spec
from json import JSONDecodeError
from pathlib import Path
from typing import Any

from sqlalchemy import (
    URL,
    Connection,
    Engine,
    Table,
    create_engine,
    event,
    func,
    inspect,
    make_url,
    select,
)
from sqlalchemy.exc import ArgumentError, DBAPIError, IntegrityError, NoSuchModuleError
from sqlalchemy.exc import TimeoutError as NoConnection
from sqlalchemy.pool import NullPool

from app import json_codec

POSTGRESQL = "postgresql+psycopg"
WRITES = "writes"
"""Execution option of connections that will write."""

SMALLEST_DATABASE = 512
"""[bytes] Of SQLite."""
CORRUPT = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_CORRUPT_INDEX, sqlite3.SQLITE_NOTADB)
BUSY_TIMEOUT_MS = 30_000
POOL = {"pool_size": 8, "max_overflow": 24}
CHECKPOINT_TIMEOUT_MS = 200
POLL_S = 0.05
"""Interval at which a running check looks whether it must end [s]."""
WRITER_KEY = 0x666F7277
"""Number of the advisory lock of PostgreSQL's writer."""
LARGEST_IDLE_LOG = 64 * 2**20
"""Size of the write-ahead log on disk after a checkpoint [bytes]."""


class StoreError(OSError):
    """The database cannot be used, or its content is damaged."""


class Damaged(StoreError):
    """Stored content has changed since it was stored."""


class Interrupted(Exception):
    """A check that was stopped before its end."""


def address(url_or_path: str | Path) -> URL:
    """URL of the database; a path names an SQLite file.

    StoreError for an unsupported URL and for a database in memory.
    """
    given = str(url_or_path)
    if "://" not in given:
        return URL.create("sqlite", database=given)
    try:
        url = make_url(given)
        if url.drivername in ("postgresql", "postgres"):
            url = url.set(drivername=POSTGRESQL)
        url.get_dialect()
    except (ArgumentError, NoSuchModuleError) as error:
        raise _unsupported(str(error)) from error
    if not is_sqlite(url) and url.drivername != POSTGRESQL:
        raise _unsupported(url.drivername)
    if not is_sqlite(url) and find_spec("psycopg") is None:
        raise StoreError("PostgreSQL needs psycopg: pip install 'forewarn[postgres]'")
    if is_sqlite(url) and (url.database in (None, "", ":memory:") or url.query):
        raise StoreError(
            f"{given} does not name a file: give sqlite:/// with a path and no parameters; a "
            "database in memory would lose its content"
        )
    return url


def _unsupported(reason: str) -> StoreError:
    return StoreError(
        f"unsupported database URL ({reason}): give a path, or a URL such as "
        "sqlite:////home/crew/forewarn.db or postgresql://crew@host/forewarn"
    )


def is_sqlite(url: URL) -> bool:
    return url.get_backend_name() == "sqlite"


def file_of(url: URL) -> Path | None:
    """Resolved path of an SQLite file; None for other databases."""
    return Path(str(url.database)).resolve() if is_sqlite(url) else None


def copy_database(url: URL, copy: Path, remedy: str) -> None:
    """Copy an SQLite database in one consistent state, whole or not at all. StoreError.

    remedy: what to do if it fails.
    """
    part = copy.with_name(f"{copy.name}.part")
    try:
        part.unlink(missing_ok=True)
        with (
            closing(sqlite3.connect(str(url.database))) as source,
            closing(sqlite3.connect(part)) as target,
        ):
            source.backup(target)
        part.chmod(0o600)
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(copy)
    except (OSError, sqlite3.Error) as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise StoreError(
            f"{url.database} cannot be copied ({error}): {remedy}; nothing was changed"
        ) from error


def make_engine(url: URL, *, foreign_keys: bool = True, **json: Any) -> Engine:
    """Engine of a database; it opens nothing yet.

    foreign_keys: False while a migration rebuilds tables, whose rows would otherwise cascade.
    json: other (de)serializers than those of the program.
    """
    settings = {"json_serializer": to_text} | POOL | json
    if not is_sqlite(url):
        return _make_postgresql(url, settings)
    engine = create_engine(url, **settings, connect_args={"timeout": BUSY_TIMEOUT_MS / 1000})

    @event.listens_for(engine, "connect")
    def prepare(connection: sqlite3.Connection, record: Any) -> None:
        connection.isolation_level = None  # `begin` below starts all transactions, DDL included
        mode = connection.execute("PRAGMA journal_mode = WAL").fetchone()[0]
        if mode != "wal":
            raise StoreError(
                f"{url.database} cannot use a write-ahead log (journal mode is {mode!r}): choose "
                "a directory on a local disk"
            )
        connection.execute("PRAGMA synchronous = FULL")  # committed data survives a power cut
        connection.execute(f"PRAGMA journal_size_limit = {LARGEST_IDLE_LOG}")
        connection.execute(f"PRAGMA foreign_keys = {'ON' if foreign_keys else 'OFF'}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # A transaction that reads before it writes cannot wait for another writer.
        writes = connection.get_execution_options().get(WRITES, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine


def _make_postgresql(url: URL, settings: dict[str, Any]) -> Engine:
    """An engine whose transactions are as SQLite's: one writer at a time, one state to readers."""
    engine = create_engine(url, **settings, isolation_level="REPEATABLE READ")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        if connection.get_execution_options().get(WRITES, False):
            # its statements see what was written while it waited
            connection.exec_driver_sql(
                "SET TRANSACTION ISOLATION LEVEL READ COMMITTED;"
                f"SET LOCAL lock_timeout = {BUSY_TIMEOUT_MS};"
                f"SELECT pg_advisory_xact_lock({WRITER_KEY})"
            )

    return engine


def make_directory(url: URL) -> None:
    """Create the directory of an SQLite file if missing, accessible to its owner only."""
    if is_sqlite(url):
        try:
            Path(str(url.database)).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(
                f"cannot create the directory of {url.database} ({error.strerror}): choose "
                "another with FOREWARN_DATA_DIR"
            ) from error


def read_only_engine(url: URL) -> Engine | None:
    """Engine that cannot write; None if the database does not exist yet.

    StoreError for a short file of another kind, which SQLite would treat as empty and overwrite; it
    refuses others itself.
    """
    if not is_sqlite(url):
        return make_engine(url)
    path = Path(str(url.database))
    try:
        size = path.stat().st_size  # opening the file here would end the locks of this process
    except FileNotFoundError:
        return None
    except OSError as error:
        raise StoreError(
            f"{path} cannot be read ({error.strerror}): choose a Forewarn database, or a new file"
        ) from error
    if not size and not path.with_name(f"{path.name}-wal").exists():
        return None
    if 0 < size < SMALLEST_DATABASE:
        raise StoreError(
            f"{path} cannot be read (it is not a database): choose a Forewarn database, or a "
            "new file"
        )
    uri = f"{path.resolve().as_uri()}?mode=ro"
    return create_engine(url, creator=lambda: sqlite3.connect(uri, uri=True), poolclass=NullPool)


@contextmanager
def reading(engine: Engine) -> Iterator[Connection]:
    """Transaction that reads one consistent state. StoreError."""
    with _explained(engine), engine.connect() as connection, connection.begin():
        yield connection


@contextmanager
def writing(engine: Engine) -> Iterator[Connection]:
    """Transaction that writes all or nothing. StoreError.

    It waits for other writers, in this process or another.
    """
    with (
        _explained(engine),
        engine.connect().execution_options(**{WRITES: True}) as connection,
        connection.begin(),
    ):
        yield connection


def checkpoint(engine: Engine) -> None:
    """Move the write-ahead log into the database and free its space, if no reader prevents it."""
    if not is_sqlite(engine.url):
        return
    with _explained(engine), engine.connect() as connection:
        raw = connection.connection.driver_connection
        assert isinstance(raw, sqlite3.Connection)
        raw.execute(f"PRAGMA busy_timeout = {CHECKPOINT_TIMEOUT_MS}")
        try:
            raw.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        except sqlite3.Error as error:
            raise StoreError(f"the write-ahead log could not be emptied ({error})") from error
        finally:
            raw.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")


def raise_counter(engine: Engine) -> int:
    """Raise the counter that SQLite keeps in a database. StoreError if it cannot be written."""
    with writing(engine) as connection:
        if not is_sqlite(engine.url):
            return 0
        number = int(connection.exec_driver_sql("PRAGMA user_version").scalar_one()) + 1
        connection.exec_driver_sql(f"PRAGMA user_version = {number}")
        return number


def counter(url: URL) -> int:
    """The counter of a database; 0 if it does not exist yet. StoreError."""
    if not is_sqlite(url) or (engine := read_only_engine(url)) is None:
        return 0
    with reading(engine) as connection:
        return int(connection.exec_driver_sql("PRAGMA user_version").scalar_one())


def reusable_bytes(engine: Engine) -> int | None:
    """Free bytes inside SQLite's file, which it will reuse; None for other databases."""
    if not is_sqlite(engine.url):
        return None
    with reading(engine) as connection:
        pages, size = (
            connection.exec_driver_sql(f"PRAGMA {name}").scalar_one()
            for name in ("freelist_count", "page_size")
        )
    return int(pages) * int(size)


def check_pages(
    engine: Engine,
    stopped: threading.Event | None = None,
    rest: Callable[[], None] = lambda: None,
) -> list[str]:
    """Check pages, rows, indices and references, table by table; one line per fault.

    stopped: interrupts the check.   rest: called between tables.   Interrupted.
    """
    if not is_sqlite(engine.url):
        return []
    tables = (f'integrity_check("{name}")' for name in table_names(engine))
    uri = f"{Path(str(engine.url.database)).resolve().as_uri()}?mode=ro"
    connecting = partial(sqlite3.connect, uri, uri=True, timeout=BUSY_TIMEOUT_MS / 1000)
    lines: list[str] = []
    with (
        closing(connecting(check_same_thread=False)) as connection,
        _watched(connection, stopped or threading.Event()),
    ):
        for pragma in (*tables, "foreign_key_check"):
            lines += _lines_of(connection, pragma)
            rest()
    return lines


def continue_numbers(connection: Connection, tables: Iterable[Table]) -> None:
    """Let PostgreSQL number new rows after those that were inserted with their number."""
    if connection.dialect.name == "sqlite":
        return
    for table in tables:
        if (column := table.autoincrement_column) is not None:
            newest = select(func.coalesce(func.max(column), 0) + 1).scalar_subquery()
            sequence = func.pg_get_serial_sequence(table.name, column.name)
            connection.execute(select(func.setval(sequence, newest, False)))


def table_names(engine: Engine) -> list[str]:
    """Names of the tables; empty if the schema cannot be read, which the check then reports."""
    try:
        return inspect(engine).get_table_names()
    except DBAPIError:
        return []


def _lines_of(connection: sqlite3.Connection, pragma: str) -> list[str]:
    try:
        rows = connection.execute(f"PRAGMA {pragma}").fetchall()
    except sqlite3.DatabaseError as error:
        if error.sqlite_errorcode == sqlite3.SQLITE_INTERRUPT:
            raise Interrupted("the check of the database was interrupted") from None
        return [str(error)]
    if pragma == "foreign_key_check":
        return _broken(rows)
    return [" ".join(str(row[0]).split()) for row in rows if row[0] != "ok"]


@contextmanager
def _watched(connection: sqlite3.Connection, stopped: threading.Event) -> Iterator[None]:
    finished = threading.Event()

    def watch() -> None:
        while not finished.wait(POLL_S):
            if stopped.is_set():
                connection.interrupt()

    watcher = threading.Thread(target=watch, name="integrity-watch", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        finished.set()
        watcher.join()


def broken_references(connection: Connection) -> list[str]:
    """Rows that refer to missing rows, one line each."""
    if connection.dialect.name != "sqlite":
        return []
    return _broken(connection.exec_driver_sql("PRAGMA foreign_key_check").all())


def _broken(rows: Iterable[Sequence[Any]]) -> list[str]:
    return [f"row {row[1]} of {row[0]} refers to a missing row of {row[2]}" for row in rows]


@contextmanager
def _explained(engine: Engine) -> Iterator[None]:
    try:
        yield
    except IntegrityError:
        raise
    except NoConnection as error:
        raise StoreError(f"the database is too busy ({error}): try again") from error
    except JSONDecodeError as error:
        place = engine.url.render_as_string(hide_password=True)
        raise Damaged(
            f"the database {place} is damaged ({error}): restore a backup of it"
        ) from error
    except DBAPIError as error:
        place = engine.url.render_as_string(hide_password=True)
        if getattr(error.orig, "sqlite_errorcode", None) in CORRUPT:
            raise Damaged(
                f"the database {place} is damaged ({error.orig}): stop the server and restore a "
                "backup of it"
            ) from error
        raise StoreError(
            f"the database {place} failed ({reason_of(error)}): check that its disk has space and "
            "allows writing, and that no other program locks it"
        ) from error


def reason_of(error: DBAPIError) -> str:
    """The database's message for an error, on one line."""
    return " ".join(str(error.orig).split())


def to_text(value: Any) -> str:
    """JSON; non-finite numbers become null, arrays become lists."""
    return json_codec.encode(value).decode()
