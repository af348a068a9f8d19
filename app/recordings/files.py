"""Folders of recordings: uploaded file, columns and scored samples.

    recordings/<id>/file            the uploaded file, byte for byte
                    columns/        signals read from it
                    digests.json    SHA-256 of each file of the columns
                    scorings/       samples and tiles of each scoring
    recordings/incoming/<id>/       a recording that is being added or removed

A folder moves in and out in one step, so `recordings/<id>` is always complete.
"""

import errno
import hashlib
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

from app.store.database import Damaged, StoreError
from app.telemetry.contents import CONTENTS, Columns, open_columns

LOG = logging.getLogger("forewarn")
DIGESTS = "digests.json"
REMEDY = "restore the data directory, or delete the recording and upload it again"
SPARE_BYTES = 256 * 2**20
"""Free space reserved for the database and the rest of the machine."""


PIECE_BYTES = 2**20
Signature = tuple[int, int, int, int]


class Elsewhere(StoreError):
    """The recording's folder is in another data directory."""


class NoSpace(OSError):
    """The disk has no room for new data."""


def digest_of(path: Path, rest: Callable[[], None] = lambda: None) -> str:
    """SHA-256 of a file. rest: called between pieces of work."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(PIECE_BYTES):
            digest.update(piece)
            rest()
    return digest.hexdigest()


class Verified:
    """Files whose digests were checked; one is read again only after it was touched."""

    def __init__(self) -> None:
        self._files: dict[Path, tuple[Signature, str]] = {}

    def check(
        self, path: Path, expected: str, remedy: str, digest: Callable[[Path], str] = digest_of
    ) -> None:
        """Compare a file with its digest. Damaged if it differs; FileNotFoundError.

        remedy: advice for the message.   digest: computes the digest in hexadecimal.
        """
        known = _signature(path), expected
        if self._files.get(path) == known:
            return
        if digest(path) != expected:
            raise Damaged(f"{path} is damaged, its digest does not match: {remedy}")
        self._files[path] = known


def _signature(path: Path) -> Signature:
    status = path.stat()
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


class RecordingFiles:
    """The folders under one root, named by recording id."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.incoming = root / "incoming"
        self.verified = Verified()

    def create(self, recording_id: str) -> Path:
        folder = self.incoming / recording_id
        with reporting_full_disk():
            folder.mkdir(parents=True, mode=0o700)
        return folder

    def admit(self, recording_id: str) -> None:
        """Move a complete folder into its place, synced to disk."""
        folder = self.incoming / recording_id
        (folder / "scorings").mkdir()
        digests = {path.name: digest_of(path) for path in sorted((folder / "columns").iterdir())}
        (folder / DIGESTS).write_text(json.dumps(digests), encoding="utf-8")
        for path in (*folder.rglob("*"), folder):
            sync(path)
        folder.rename(self.root / recording_id)
        sync(self.root)

    def reject(self, recording_id: str) -> None:
        """Remove the folder of a recording that is being added, if there is one."""
        shutil.rmtree(self.incoming / recording_id, ignore_errors=True)

    def discard(self, recording_id: str) -> None:
        """Remove a folder from its place in one step, if there is one."""
        removed = self.incoming / f"{recording_id}.gone"
        try:
            self.incoming.mkdir(parents=True, exist_ok=True)
            (self.root / recording_id).rename(removed)
        except FileNotFoundError:
            return
        shutil.rmtree(removed, ignore_errors=True)

    def unnamed(self) -> BinaryIO:
        """A temporary file on the same disk, deleted when closed."""
        with reporting_full_disk():
            self.incoming.mkdir(parents=True, exist_ok=True)
            return cast(BinaryIO, tempfile.TemporaryFile(dir=self.incoming))

    def file(self, recording_id: str) -> Path:
        return self.root / recording_id / "file"

    def scorings(self, recording_id: str) -> Path:
        return self.root / recording_id / "scorings"

    @contextmanager
    def present(self, recording_id: str) -> Iterator[None]:
        """Turn FileNotFoundError into Elsewhere without a folder, else into StoreError."""
        try:
            yield
        except FileNotFoundError as error:
            folder = self.root / recording_id
            if not folder.is_dir():
                raise Elsewhere(
                    f"{folder} is missing: the recording is stored in another data directory; "
                    "start the server with that one, or restore it from a backup"
                ) from error
            raise StoreError(f"{error.filename} is missing: {REMEDY}") from error

    def columns(self, recording_id: str) -> Columns:
        """The columns of a recording; each is checked on reading. FileNotFoundError; Damaged."""
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
        """Check all files of a recording except its scorings. FileNotFoundError; Damaged.

        digest: computes the digest of a file in hexadecimal; may be slow.
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
        """Digests of the columns by file; empty for a recording of an older version."""
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
        """Remove incomplete files of a server that crashed. Arguments: known ids.

        A folder without a row in the database stays: it may belong to another database.
        """
        for folder in self.incoming.glob("*"):
            LOG.warning("removed the incomplete recording %s after a server crash", folder)
            shutil.rmtree(folder, ignore_errors=True)
        for recording_id in recordings:
            for file in self.scorings(recording_id).glob("*"):
                if file.name.partition(".")[0] not in scorings:
                    file.unlink(missing_ok=True)

    def size(self, recording_id: str) -> int:
        return _size_of(self.root / recording_id)

    def require(self, n_bytes: int) -> None:
        """Check that so many bytes can be stored; NoSpace."""
        existing = next(path for path in (self.root, *self.root.parents) if path.exists())
        free = shutil.disk_usage(existing).free
        if n_bytes > free - SPARE_BYTES:
            unit, name = (2**20, "MiB") if n_bytes >= 10 * 2**20 else (2**10, "KiB")
            raise NoSpace(
                f"this needs {ceil(n_bytes / unit):,} {name}, but the disk of the data directory "
                f"has {max(0, free - SPARE_BYTES) // unit:,} {name} available: delete recordings"
            )


def _size_of(folder: Path) -> int:
    total = 0
    for path in folder.rglob("*"):
        with suppress(FileNotFoundError):
            total += path.stat().st_size if path.is_file() else 0
    return total


@contextmanager
def reporting_full_disk() -> Iterator[None]:
    """Raise NoSpace for errors of a full disk."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise
        raise NoSpace("the disk of the data directory is full: delete recordings") from error


def sync(path: Path) -> None:
    """Flush a file or directory to disk, against a power cut."""
    if os.name == "nt":  # cannot open directories
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
