"""Folders of recordings: what is uploaded, its columns, its scored samples.

    recordings/<id>/file            the uploaded file, byte for byte
                    columns/        what was read from it
                    digests.json    SHA-256 of each file of the columns
                    scorings/       samples and tiles of each scoring
    recordings/incoming/<id>/       a recording that is on its way in, or out

A folder moves in and out in one step, so that what lies under `recordings/<id>` is whole.
"""

import errno
import json
import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from math import ceil
from pathlib import Path
from typing import BinaryIO, cast

from app.recordings.verified import Verified, digest_of
from app.store.database import Damaged
from app.telemetry.contents import CONTENTS, Columns, open_columns

LOG = logging.getLogger("forewarn")
DIGESTS = "digests.json"
REMEDY = "restore the data directory, or delete the recording and upload it again"
SPARE_BYTES = 256 * 2**20
"""Left free on the disk for the database and the rest of the machine."""


class NoSpace(OSError):
    """The disk has no room for what is to be kept."""


class RecordingFiles:
    """The folders under one root, each named by the id of its recording."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.incoming = root / "incoming"
        self.verified = Verified()

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
        digests = {path.name: digest_of(path) for path in sorted((folder / "columns").iterdir())}
        (folder / DIGESTS).write_text(json.dumps(digests), encoding="utf-8")
        for path in (*folder.rglob("*"), folder):
            sync(path)
        folder.rename(self.root / recording_id)
        sync(self.root)

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

    def unnamed(self) -> BinaryIO:
        """A file on the same disk, to write and read, that is gone once it is closed."""
        with spacious():
            self.incoming.mkdir(parents=True, exist_ok=True)
            return cast(BinaryIO, tempfile.TemporaryFile(dir=self.incoming))

    def file(self, recording_id: str) -> Path:
        """The uploaded file."""
        return self.root / recording_id / "file"

    def scorings(self, recording_id: str) -> Path:
        """Folder of the scored samples."""
        return self.root / recording_id / "scorings"

    def columns(self, recording_id: str) -> Columns:
        """The columns of a recording, each checked as it is read. FileNotFoundError; Damaged."""
        folder = self.root / recording_id / "columns"
        try:
            digests = self._digests(recording_id)
            check = partial(self._check_column, digests)
            check(folder / CONTENTS)
            return replace(open_columns(folder), check=check)
        except (ValueError, KeyError, TypeError) as error:
            raise Damaged(f"{folder} is damaged ({error}): {REMEDY}") from error

    def check(
        self, recording_id: str, file_digest: str, digest: Callable[[Path], str] = digest_of
    ) -> None:
        """Read a whole recording, but for its scorings. FileNotFoundError; Damaged.

        digest: of a file's content, in hexadecimal; it may take its time.
        """
        folder = self.root / recording_id / "columns"
        self.verified.check(self.file(recording_id), file_digest, REMEDY, digest)
        try:
            digests = self._digests(recording_id)
            for name in digests:
                self._check_column(digests, folder / name, digest)
        except (ValueError, TypeError) as error:
            raise Damaged(f"{folder} is damaged ({error}): {REMEDY}") from error

    def _digests(self, recording_id: str) -> dict[str, str]:
        """Digests of the columns by file; none of a recording of an older program."""
        try:
            text = (self.root / recording_id / DIGESTS).read_text(encoding="utf-8")
        except FileNotFoundError:
            return {}
        return dict(json.loads(text))

    def _check_column(
        self,
        digests: Mapping[str, str],
        path: Path,
        digest: Callable[[Path], str] = digest_of,
    ) -> None:
        if digests:
            self.verified.check(path, digests[path.name], REMEDY, digest)

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

    def size(self, recording_id: str) -> int:
        """Bytes of all files in the folder of a recording; 0 where it is gone."""
        return _size_of(self.root / recording_id)

    def require(self, n_bytes: int) -> None:
        """Check that so many bytes can be kept; NoSpace."""
        here = next(path for path in (self.root, *self.root.parents) if path.exists())
        free = shutil.disk_usage(here).free
        if n_bytes > free - SPARE_BYTES:
            unit, name = (2**20, "MiB") if n_bytes >= 10 * 2**20 else (2**10, "KiB")
            raise NoSpace(
                f"this needs {ceil(n_bytes / unit):,} {name}, and the disk of the data directory "
                f"has {max(0, free - SPARE_BYTES) // unit:,} {name} to spare: delete recordings"
            )


def _size_of(folder: Path) -> int:
    total = 0
    for path in folder.rglob("*"):
        with suppress(FileNotFoundError):
            total += path.stat().st_size if path.is_file() else 0
    return total


@contextmanager
def spacious() -> Iterator[None]:
    """Say as NoSpace that the disk is full."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise
        raise NoSpace("the disk of the data directory is full: delete recordings") from error


def sync(path: Path) -> None:
    """Have the disk hold a file or directory, against a power cut."""
    if os.name == "nt":  # it opens no directories
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
