"""Folders of recordings: what is uploaded, its columns, its scored samples.

    recordings/<id>/file            the uploaded file, byte for byte
                    columns/        what was read from it
                    scorings/       samples and tiles of each scoring
    recordings/incoming/<id>/       a recording that is on its way in, or out

A folder moves in and out in one step, so that what lies under `recordings/<id>` is whole.
"""

import errno
import logging
import os
import shutil
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from app.store.database import StoreError
from app.telemetry.contents import Columns, open_columns

LOG = logging.getLogger("forewarn")
SPARE_BYTES = 256 * 2**20
"""Left free on the disk for the database and the rest of the machine."""


class NoSpace(OSError):
    """The disk has no room for what is to be kept."""


class RecordingFiles:
    """The folders under one root, each named by the id of its recording."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.incoming = root / "incoming"

    def begin(self, recording_id: str) -> Path:
        """Make the folder of a recording that is on its way in."""
        folder = self.incoming / recording_id
        with spacious():
            folder.mkdir(parents=True, mode=0o700)
        return folder

    def admit(self, recording_id: str) -> None:
        """Put a folder in its place, whole on the disk."""
        folder = self.incoming / recording_id
        (folder / "scorings").mkdir()
        for path in (*folder.rglob("*"), folder):
            _sync(path)
        folder.rename(self.root / recording_id)
        _sync(self.root)

    def reject(self, recording_id: str) -> None:
        """Remove the folder of a recording that is on its way in; nothing where there is none."""
        shutil.rmtree(self.incoming / recording_id, ignore_errors=True)

    def discard(self, recording_id: str) -> None:
        """Remove a folder from its place in one step; nothing where there is none."""
        gone = self.incoming / f"{recording_id}.gone"
        try:
            self.incoming.mkdir(parents=True, exist_ok=True)
            (self.root / recording_id).rename(gone)
        except FileNotFoundError:
            return
        shutil.rmtree(gone, ignore_errors=True)

    def file(self, recording_id: str) -> Path:
        """The uploaded file."""
        return self.root / recording_id / "file"

    def scorings(self, recording_id: str) -> Path:
        """Folder of the scored samples."""
        return self.root / recording_id / "scorings"

    def columns(self, recording_id: str) -> Columns:
        """The columns of a recording. FileNotFoundError; StoreError where they are damaged."""
        folder = self.root / recording_id / "columns"
        try:
            return open_columns(folder)
        except (ValueError, KeyError, TypeError) as error:
            raise StoreError(
                f"{folder} is damaged ({error}): restore the data directory, or delete the "
                "recording and upload it again"
            ) from error

    def clear(self, recordings: Iterable[str], scorings: Collection[str]) -> None:
        """Remove what a server that died left half-way, in these recordings and on its way.

        A folder that no row knows is left alone: it may belong to another database.
        """
        for left in self.incoming.glob("*"):
            LOG.warning("removed %s, which a server that died left half-way", left)
            shutil.rmtree(left, ignore_errors=True)
        for recording_id in recordings:
            for left in self.scorings(recording_id).glob("*"):
                if left.name.partition(".")[0] not in scorings:
                    left.unlink(missing_ok=True)

    def require(self, n_bytes: int) -> None:
        """Check that so many bytes can be kept; NoSpace."""
        here = next(path for path in (self.root, *self.root.parents) if path.exists())
        free = shutil.disk_usage(here).free
        if n_bytes > free - SPARE_BYTES:
            raise NoSpace(
                f"this needs {n_bytes / 2**20:,.0f} MiB, and the disk of the data directory has "
                f"{max(0, free - SPARE_BYTES) / 2**20:,.0f} MiB to spare: delete recordings"
            )


@contextmanager
def spacious() -> Iterator[None]:
    """Say as NoSpace that the disk is full."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise
        raise NoSpace("the disk of the data directory is full: delete recordings") from error


def _sync(path: Path) -> None:
    """Have the disk hold a file or directory, against a power cut."""
    if os.name == "nt":  # it opens no directories
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
