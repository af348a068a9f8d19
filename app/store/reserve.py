"""The reserve: disk space held beside the database, so that a full disk can be emptied.

SQLite needs space to delete rows. If the disk is nearly full, the reserve is freed for a deletion
or for the start of the server, and filled again as soon as there is space.
"""

import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import URL, Engine

from app.store.database import StoreError, checkpoint, is_sqlite

LOG = logging.getLogger("forewarn")
RESERVE_BYTES = 8 * 2**20
LEAST_BYTES = 2**20
"""A smaller reserve would not help."""
BLOCK_BYTES = 2**18


class Reserve:
    """A file beside an SQLite database; does nothing for other databases."""

    def __init__(self, url: URL) -> None:
        database = Path(str(url.database)) if is_sqlite(url) else None
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
