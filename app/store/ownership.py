"""Ownership of a database: only one process serves it, and its lock ends with it.

SQLite: a locked file next to the database. PostgreSQL: a session's advisory lock, on a connection
of its own; a process that loses the connection must take the lock again.
"""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from errno import EACCES
from pathlib import Path
from threading import RLock
from typing import Any

from filelock import FileLock, Timeout
from sqlalchemy import URL, Connection, create_engine, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import NullPool

from app.store.database import StoreError, file_of, reason_of
from core import __version__
from core.whole_file import write_whole

OWNER_KEY = 0x666F7265
"""Number of the advisory lock of the process that serves."""
ANSWERS_S = 10
"""[s] A peer is lost if it is silent for a few times this."""
PROGRAM, PUBLISHED = __version__, "forewarn.owner"
_OWNED: dict[URL, "Ownership"] = {}
_TURN = RLock()


class Taken(StoreError):
    """Another process serves the database."""


class FileHold:
    """A lock file. locked: the protected file.   option: chooses another one."""

    def __init__(self, locked: Path, path: Path, option: str) -> None:
        self._locked, self._option = locked, option
        self._lock = FileLock(path, timeout=0, mode=0o600, thread_local=False)
        self._path = path

    def take(self) -> None:
        """Taken; StoreError where it cannot be written."""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            if not os.access(self._path.parent, os.W_OK):
                raise PermissionError(EACCES, os.strerror(EACCES))
            self._lock.acquire()
        except Timeout:
            raise _taken(str(self._locked), self._option) from None
        except OSError as error:
            raise StoreError(
                f"{self._locked} is not writable ({error.strerror}): choose another one with "
                f"{self._option}"
            ) from error

    def release(self) -> None:
        self._lock.release()


class SessionHold:
    """An advisory lock of PostgreSQL, held by its own connection."""

    def __init__(self, url: URL) -> None:
        self._place = url.render_as_string(hide_password=True)
        silent = {"keepalives_idle": ANSWERS_S, "keepalives_interval": ANSWERS_S}
        self._engine = create_engine(
            url,
            poolclass=NullPool,
            isolation_level="AUTOCOMMIT",
            connect_args=silent | {"connect_timeout": ANSWERS_S},
        )
        self._connection: Connection | None = None

    def take(self) -> None:
        """Taken; StoreError where the database cannot be reached."""
        try:
            connection = self._connection = self._engine.connect()
            # the database frees the lock of a machine that is gone
            for name in ("tcp_keepalives_idle", "tcp_keepalives_interval"):
                connection.execute(text(f"SET {name} = {ANSWERS_S}"))
            lock = text(f"SELECT pg_try_advisory_lock({OWNER_KEY})")
            is_held = connection.execute(lock).scalar_one()
        except DBAPIError as error:
            self.release()
            raise StoreError(
                f"{self._place} cannot be opened ({reason_of(error)}): check that the database "
                "runs and accepts this user"
            ) from error
        if not is_held:
            self.release()
            raise _taken(self._place, "--database-url")

    def regain(self) -> str:
        """Take the lock again if the connection no longer answers; one sentence if it is lost."""
        try:
            if self._connection is not None:
                self._connection.execute(text("SELECT 1"))
                return ""
        except DBAPIError:
            self.release()
        try:
            self.take()
        except StoreError as error:
            return f"this server has lost its database: {error}"
        return ""

    def release(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.invalidate()  # close it, even if it does not answer
            connection.close()


def _taken(place: str, option: str) -> Taken:
    return Taken(
        f"another forewarn serves {place}: stop it, choose other data with {option}, or start both "
        "with --shared, one data directory and an address each"
    )


class Ownership:
    """The lock on a database that this process serves.

    fault: one sentence while the lock is lost, as of the newest check; empty while it is held.
    """

    def __init__(self, url: URL) -> None:
        database = file_of(url)
        if database is None:
            self._hold: SessionHold | FileHold = SessionHold(url)
        else:
            lock = database.with_name(f"{database.name}.lock")
            self._hold = FileHold(database, lock, "--database-url")
        self.n_users = 0
        self.fault = ""

    @property
    def can_be_lost(self) -> bool:
        return isinstance(self._hold, SessionHold)

    def take(self) -> None:
        self._hold.take()

    def release(self) -> None:
        self._hold.release()

    def check(self) -> str:
        """Take a lost lock again; return the fault."""
        hold = self._hold
        if isinstance(hold, SessionHold):
            with _TURN:
                self.fault = hold.regain() if self.n_users else ""
        return self.fault


@contextmanager
def owned(url: URL, *, first: bool = False) -> Iterator[Ownership]:
    """Own a database; several times at once in one process.

    Taken if another process owns it, with `first` also if this one does; StoreError where the lock
    cannot be written or reached.
    """
    database = file_of(url)
    key = url if database is None else url.set(database=str(database))
    with _TURN:
        ownership = _OWNED.get(key)
        if ownership is None:
            ownership = Ownership(url)
            ownership.take()
            _OWNED[key] = ownership
        elif first:
            raise _taken(key.render_as_string(hide_password=True), "--database-url")
        ownership.n_users += 1
    try:
        yield ownership
    finally:
        with _TURN:
            ownership.n_users -= 1
            if not ownership.n_users:
                del _OWNED[key]
                ownership.release()


@contextmanager
def published(data_dir: Path, about: dict[str, Any] | None) -> Iterator[None]:
    """Publish facts about the owner in the data directory; nothing if None."""
    place = data_dir / PUBLISHED
    place.unlink(missing_ok=True)  # of one that was killed
    if about is not None:
        write_whole(place, json.dumps(about).encode())
    try:
        yield
    finally:
        place.unlink(missing_ok=True)


def published_by(data_dir: Path) -> dict[str, Any]:
    """Facts that the owner of a data directory has published there; empty if none."""
    try:
        return json.loads((data_dir / PUBLISHED).read_text())
    except (OSError, ValueError):
        return {}
