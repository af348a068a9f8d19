"""Files beside an SQLite database: the reserve, and the mark of the last good stop.

SQLite needs space to delete rows. If the disk is nearly full, the reserve is freed for a deletion
or for the start of the server, and filled again as soon as there is space.

While a server runs, and when it stops, it raises a counter inside the database and then copies it
to the mark. After a crash the database is never behind it. If it is, its write-ahead log was
deleted or an older copy took its place.
"""

import json
import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock

from sqlalchemy import URL, Engine

from app.store.database import StoreError, checkpoint, counter, file_of, raise_counter
from app.store.tables import now
from core.whole_file import write_whole

LOG = logging.getLogger("forewarn")
RESERVE_BYTES = 8 * 2**20
LEAST_BYTES = 2**20
"""A smaller reserve would not help."""
BLOCK_BYTES = 2**18

ENDING = ".stop"


class Reserve:
    """A file beside an SQLite database; does nothing for other databases."""

    def __init__(self, url: URL) -> None:
        database = file_of(url)
        self.path = database and database.with_name(f"{database.name}.reserve")

    def make(self) -> None:
        """Fill the reserve as far as the disk allows, unless it exists."""
        if self.path is None or self.path.exists():
            return
        part = self.path.with_name(f"{self.path.name}.part")
        try:
            size = _fill(part)
            if size < LEAST_BYTES:
                part.unlink(missing_ok=True)
            else:
                part.replace(self.path)
        except OSError as error:
            LOG.warning("no disk space reserved for deletions: %s", error)

    def free(self) -> bool:
        """Free the reserve if the disk is nearly full; return whether it was."""
        if self.path is None or not self.path.parent.is_dir():
            return False
        if shutil.disk_usage(self.path.parent).free >= RESERVE_BYTES:
            return False
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            LOG.warning("the disk space reserved for deletions could not be freed: %s", error)
        return True

    @contextmanager
    def freed(self, engine: Engine) -> Iterator[None]:
        """Free the reserve, if needed, while something is deleted."""
        was_short = self.free()
        try:
            yield
        finally:
            if was_short:
                try:
                    checkpoint(engine)
                except StoreError as error:
                    LOG.warning("%s", error)
                self.make()


def _fill(path: Path) -> int:
    """Write random bytes, which no file system compresses, until the disk is full; their number."""
    size = 0
    with path.open("wb", buffering=0) as file:
        path.chmod(0o600)
        try:
            while size < RESERVE_BYTES:
                size += file.write(os.urandom(BLOCK_BYTES))
            os.fsync(file.fileno())
        except OSError:
            pass
    return size


@dataclass(frozen=True)
class Mark:
    """Content of the mark. older: finding at the last start; empty if nothing was lost."""

    counter: int
    time: str
    stopped: bool
    older: str = ""


class LastStop:
    """The counter and its file; does nothing for databases other than SQLite."""

    def __init__(self, url: URL) -> None:
        database = file_of(url)
        self.path = database and database.with_name(f"{database.name}{ENDING}")
        self._url, self._lock = url, Lock()
        self.older = ""
        """One sentence if the database was older than its file at the start."""

    def finding(self) -> str:
        """Compare the database with its file; one sentence if it is older, else empty."""
        mark = self._read()  # before the database, which is always raised first
        if mark is None or counter(self._url) >= mark.counter:
            return "" if mark is None else mark.older
        at = "at its last good stop" if mark.stopped else "when it was last served"
        return (
            f"the database is older than {at} ({mark.time}): its write-ahead log was deleted, or "
            "an older copy took its place; what was stored since is missing: stop the server and "
            "put the log back or restore a backup"
        )

    def note(self, engine: Engine, *, stopped: bool = False) -> None:
        """Raise the counter, which tests writing. StoreError.

        stopped: at a good stop, which also clears the finding.
        """
        with self._lock:
            raised = raise_counter(engine)
            if self.path is None:
                return
            mark = Mark(raised, now(), stopped, "" if stopped else self.older)
            with suppress(OSError):  # on a full disk the file stays behind, which is harmless
                write_whole(self.path, json.dumps(asdict(mark)).encode())

    def _read(self) -> Mark | None:
        try:
            return None if self.path is None else Mark(**json.loads(self.path.read_text()))
        except (OSError, ValueError, TypeError):
            return None
