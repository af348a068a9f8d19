"""The last good stop: a counter that shows whether a database has lost content.

While a server runs, and when it stops, it raises a counter inside the database and then copies it
to a file beside it. After a crash the database is never behind that file. If it is, its write-ahead
log was deleted or an older copy took its place.
"""

import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock

from sqlalchemy import URL, Engine

from app.store.database import counter, file_of, raise_counter
from app.store.tables import now

ENDING = ".stop"


@dataclass(frozen=True)
class Mark:
    """Content of the file. older: finding at the last start; empty if nothing was lost."""

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
                self._write(self.path, mark)

    def _read(self) -> Mark | None:
        try:
            return None if self.path is None else Mark(**json.loads(self.path.read_text()))
        except (OSError, ValueError, TypeError):
            return None

    @staticmethod
    def _write(path: Path, mark: Mark) -> None:
        part = path.with_name(f"{path.name}.part")
        part.write_text(json.dumps(asdict(mark)))
        part.chmod(0o600)
        os.replace(part, path)
