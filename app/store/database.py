"""The database behind the store: reached by URL, SQLite by default; engine and transactions.

All SQL that only SQLite understands is in this file.
"""

import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from functools import partial
from json import JSONDecodeError
from pathlib import Path
from typing import Any

from pydantic_core import to_json
from sqlalchemy import URL, Connection, Engine, create_engine, event, inspect, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError, IntegrityError, NoSuchModuleError
from sqlalchemy.exc import TimeoutError as NoConnection
from sqlalchemy.pool import NullPool

WRITES = "writes"
"""Execution option of a connection that is about to write."""

SQLITE_HEADER = b"SQLite format 3\0"
CORRUPT = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_CORRUPT_INDEX, sqlite3.SQLITE_NOTADB)
BUSY_TIMEOUT_MS = 30_000
CHECKPOINT_TIMEOUT_MS = 200
WATCH_S = 0.05
"""[s] Between two looks whether a check is to end."""
LARGEST_IDLE_LOG = 64 * 2**20
"""Bytes that the write-ahead log keeps on disk once its content is in the database."""


class StoreError(OSError):
    """A database that cannot be used, or content of it that is damaged."""


class Damaged(StoreError):
    """Stored content that is not what it was when it was stored."""


class Interrupted(Exception):
    """A check that did not come to its end."""


def address(url_or_path: str | Path) -> URL:
    """Return the database's URL; a path is that of an SQLite file.

    StoreError for what is no URL of a known kind, and for a database in memory.
    """
    written = str(url_or_path)
    if "://" not in written:
        return URL.create("sqlite", database=written)
    try:
        url = make_url(written)
        url.get_dialect()
    except (ArgumentError, NoSuchModuleError) as error:
        raise StoreError(
            f"the database URL is of no known kind ({error}): give a path, or a URL such as "
            "sqlite:////home/crew/forewarn.db"
        ) from error
    if is_sqlite(url) and (url.database in (None, "", ":memory:") or url.query):
        raise StoreError(
            f"{written} is no file: give sqlite:/// with a path, without parameters; a database "
            "in memory would forget all"
        )
    return url


def is_sqlite(url: URL) -> bool:
    """Whether this is SQLite's: one file, one writer at a time."""
    return url.get_backend_name() == "sqlite"


def file_of(url: URL) -> Path | None:
    """The file of an SQLite database, by whichever way it is reached; None for another kind."""
    return Path(str(url.database)).resolve() if is_sqlite(url) else None


def copy_database(url: URL, copy: Path, remedy: str) -> None:
    """Copy an SQLite database as it is at this moment, whole or not at all. StoreError.

    remedy: what to do where that fails.
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


def make_engine(url: URL, *, foreign_keys: bool = True) -> Engine:
    """Return the engine of a database; nothing is opened yet.

    foreign_keys: False while a migration rebuilds tables, whose rows would cascade away otherwise.
    """
    if not is_sqlite(url):
        return create_engine(url, json_serializer=to_text)
    engine = create_engine(
        url,
        json_serializer=to_text,
        pool_size=8,
        max_overflow=24,
        connect_args={"timeout": BUSY_TIMEOUT_MS / 1000},
    )

    @event.listens_for(engine, "connect")
    def prepare(connection: sqlite3.Connection, record: Any) -> None:
        connection.isolation_level = None  # transactions are begun below, DDL included
        mode = connection.execute("PRAGMA journal_mode = WAL").fetchone()[0]
        if mode != "wal":
            raise StoreError(
                f"{url.database} cannot have a write-ahead log (journal mode is {mode!r}): choose "
                "a directory on a local disk"
            )
        connection.execute("PRAGMA synchronous = FULL")  # a power cut loses nothing committed
        connection.execute(f"PRAGMA journal_size_limit = {LARGEST_IDLE_LOG}")
        connection.execute(f"PRAGMA foreign_keys = {'ON' if foreign_keys else 'OFF'}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # A transaction that reads first and writes later cannot wait for another writer.
        writes = connection.get_execution_options().get(WRITES, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine


def make_directory(url: URL) -> None:
    """Make the directory of an SQLite file, for its owner alone, where it is missing."""
    if is_sqlite(url):
        try:
            Path(str(url.database)).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(
                f"the directory of {url.database} cannot be made ({error.strerror}): choose "
                "another with FOREWARN_DATA_DIR"
            ) from error


def engine_to_look(url: URL) -> Engine | None:
    """Return an engine that can change nothing, None where there is no database yet.

    StoreError for a file of another kind: SQLite would take a short one for empty and overwrite it.
    """
    if not is_sqlite(url):
        return make_engine(url)
    path = Path(str(url.database))
    try:
        with path.open("rb") as file:
            start = file.read(len(SQLITE_HEADER))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise StoreError(
            f"{path} cannot be read ({error.strerror}): choose a database of Forewarn, or a new "
            "file"
        ) from error
    if not start and not path.with_name(f"{path.name}-wal").exists():
        return None
    if start and start != SQLITE_HEADER:
        raise StoreError(
            f"{path} cannot be read (it is not a database): choose a database of Forewarn, or a "
            "new file"
        )
    uri = f"{path.resolve().as_uri()}?mode=ro"
    return create_engine(
        "sqlite://", creator=lambda: sqlite3.connect(uri, uri=True), poolclass=NullPool
    )


@contextmanager
def reading(engine: Engine) -> Iterator[Connection]:
    """Open a transaction that sees one moment of the database. StoreError where it fails."""
    with _explained(engine), engine.connect() as connection, connection.begin():
        yield connection


@contextmanager
def writing(engine: Engine) -> Iterator[Connection]:
    """Open a transaction that writes all or nothing. StoreError where it fails.

    It waits for another writer, of this process or another.
    """
    with (
        _explained(engine),
        engine.connect().execution_options(**{WRITES: True}) as connection,
        connection.begin(),
    ):
        yield connection


def checkpoint(engine: Engine) -> None:
    """Bring the write-ahead log into SQLite's database and give its space back, if nobody reads."""
    if not is_sqlite(engine.url):
        return
    with _explained(engine), engine.connect() as connection:
        raw = connection.connection.driver_connection
        assert isinstance(raw, sqlite3.Connection)
        raw.execute(f"PRAGMA busy_timeout = {CHECKPOINT_TIMEOUT_MS}")
        try:
            raw.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        except sqlite3.Error as error:
            raise StoreError(f"the write-ahead log stays as it is ({error})") from error
        finally:
            raw.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")


def touch(engine: Engine) -> None:
    """Write a page, and change nothing. StoreError where the database takes no writes."""
    with writing(engine) as connection:
        if is_sqlite(engine.url):
            number = connection.exec_driver_sql("PRAGMA user_version").scalar_one()
            connection.exec_driver_sql(f"PRAGMA user_version = {int(number)}")


def reusable_bytes(engine: Engine) -> int | None:
    """Bytes of SQLite's file that hold nothing and are used again; None for another database."""
    if not is_sqlite(engine.url):
        return None
    with reading(engine) as connection:
        pages, size = (
            connection.exec_driver_sql(f"PRAGMA {name}").scalar_one()
            for name in ("freelist_count", "page_size")
        )
    return int(pages) * int(size)


def damage(engine: Engine) -> list[str]:
    """Look through the whole database; one line for each thing that is wrong with it."""
    with reading(engine) as connection:
        if not is_sqlite(engine.url):
            connection.execute(text("SELECT 1"))
            return []
        lines = [
            str(line) for line in connection.exec_driver_sql("PRAGMA integrity_check").scalars()
        ]
        return [line for line in lines if line != "ok"] + broken_references(connection)


def look_at_pages(engine: Engine, stopped: threading.Event, seconds: float) -> list[str]:
    """Look at pages and rows, not at whether indices match them; one line for each thing wrong.

    seconds: bound on its time [s].   Interrupted where it was stopped or took longer.
    """
    return _checked(engine, ["quick_check(20)"], stopped, lambda: None, seconds)


def check_pages(engine: Engine, stopped: threading.Event, rest: Callable[[], None]) -> list[str]:
    """As `damage`, table by table. rest: called between pieces.   Interrupted where stopped."""
    tables = [f'integrity_check("{name}")' for name in table_names(engine)]
    return _checked(engine, [*tables, "foreign_key_check"], stopped, rest)


def table_names(engine: Engine) -> list[str]:
    """Names of the tables; none where the schema cannot be read, as the check will say."""
    try:
        return inspect(engine).get_table_names()
    except DBAPIError:
        return []


def _checked(
    engine: Engine,
    pragmas: Iterable[str],
    stopped: threading.Event,
    rest: Callable[[], None],
    seconds: float | None = None,
) -> list[str]:
    """What pragmas say of an SQLite database, on a connection of its own that changes nothing."""
    if not is_sqlite(engine.url):
        return []
    uri = f"{Path(str(engine.url.database)).resolve().as_uri()}?mode=ro"
    connecting = partial(sqlite3.connect, uri, uri=True, timeout=BUSY_TIMEOUT_MS / 1000)
    lines: list[str] = []
    with (
        closing(connecting(check_same_thread=False)) as connection,
        _watched(connection, stopped, seconds),
    ):
        for pragma in pragmas:
            lines += _lines_of(connection, pragma)
            rest()
    return lines


def _lines_of(connection: sqlite3.Connection, pragma: str) -> list[str]:
    try:
        rows = connection.execute(f"PRAGMA {pragma}").fetchall()
    except sqlite3.DatabaseError as error:
        if error.sqlite_errorcode == sqlite3.SQLITE_INTERRUPT:
            raise Interrupted("the check of the database was interrupted") from None
        return [str(error)]
    if pragma == "foreign_key_check":
        return [f"row {row[1]} of {row[0]} refers to no row of {row[2]}" for row in rows]
    return [" ".join(str(row[0]).split()) for row in rows if row[0] != "ok"]


@contextmanager
def _watched(
    connection: sqlite3.Connection, stopped: threading.Event, seconds: float | None
) -> Iterator[None]:
    """Interrupt a connection once it is told to stop, or its time is over [s]."""
    over = threading.Event()

    def watch() -> None:
        end = None if seconds is None else time.monotonic() + seconds
        while not over.wait(WATCH_S):
            if stopped.is_set() or (end is not None and time.monotonic() > end):
                connection.interrupt()

    watcher = threading.Thread(target=watch, name="integrity-watch", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()


def broken_references(connection: Connection) -> list[str]:
    """Rows that refer to what is not there, one line each."""
    if connection.dialect.name != "sqlite":
        return []
    rows = connection.exec_driver_sql("PRAGMA foreign_key_check")
    return [f"row {row[1]} of {row[0]} refers to no row of {row[2]}" for row in rows]


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
            f"the database {place} failed ({error.orig}): see that its disk has space and allows "
            "writing, and that no other program holds it"
        ) from error


def to_text(value: Any) -> str:
    """JSON; what is not a number becomes null, arrays become lists."""
    written = to_json(value, inf_nan_mode="null", fallback=_plain)
    return written.decode()


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be stored as JSON: give plain data")
