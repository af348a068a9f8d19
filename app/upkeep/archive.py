"""The file of a backup: a tar of its parts and a manifest, followed by a digest.

    forewarn.db               the database at one moment
    recordings/<id>/...       folders of the recordings in that database
    live/<flight>.jsonl       journals of the live flights in that database
    manifest.json             program, schema, time, and size and SHA-256 of each part

After the tar come a fixed word and the SHA-256 of everything before them, which detects any lost
or changed byte. `tar xf` can read the file too.
"""

import hashlib
import io
import json
import os
import shutil
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, cast

from app.store.database import Damaged, StoreError

FORMAT = 1
MANIFEST, DATABASE, RECORDINGS = "manifest.json", "forewarn.db", "recordings"
JOURNALS = "live"
WORD = b"forewarn backup sha256 "
TRAILER_BYTES = len(WORD) + 64
PIECE_BYTES = 2**20
LARGEST_MANIFEST = 256 * 2**20
REMEDY = "take another backup"


@dataclass(frozen=True)
class ArchivePart:
    """One file of a backup. path: within the backup, with slashes."""

    path: str
    size: int
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """Content of a backup. schema: revision of the database.   created: UTC, ISO 8601.

    damaged: stored content that was damaged or missing before.
    """

    format: int
    program: str
    schema: str
    created: str
    counts: dict[str, int]
    parts: list[ArchivePart] = field(default_factory=list)
    damaged: list[str] = field(default_factory=list)

    @property
    def size(self) -> int:
        """Total size of the parts [bytes]."""
        return sum(part.size for part in self.parts)


class Digested:
    """A file that computes its digest while it is read or written."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._digest, self.n_bytes = file, hashlib.sha256(), 0

    @property
    def sha256(self) -> str:
        return self._digest.hexdigest()

    def read(self, n_bytes: int = PIECE_BYTES) -> bytes:
        return self._digest_piece(self._file.read(n_bytes))

    def write(self, piece: bytes) -> int:
        self._digest_piece(piece)
        return self._file.write(piece)

    def tell(self) -> int:
        return self.n_bytes

    def _digest_piece(self, piece: bytes) -> bytes:
        self._digest.update(piece)
        self.n_bytes += len(piece)
        return piece


class ArchiveWriter:
    """Adds parts to a tar; `close` adds the manifest, the end and the digest."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._digested = file, Digested(file)
        stream: Any = self._digested
        self._tar = tarfile.TarFile(fileobj=stream, mode="w", format=tarfile.PAX_FORMAT)
        self.parts: list[ArchivePart] = []

    def add(self, path: str, source: Path) -> ArchivePart:
        """Add a file at its present size, even if it still grows. FileNotFoundError."""
        with source.open("rb") as file:
            status = source.stat()
            size, content = status.st_size, cast(Any, Digested(file))
            self._tar.addfile(_entry(path, size, status.st_mtime), content)
        part = ArchivePart(path, size, content.sha256)
        self.parts.append(part)
        return part

    def close(self, manifest: Manifest) -> None:
        text = json.dumps(asdict(manifest), indent=1).encode()
        self._tar.addfile(_entry(MANIFEST, len(text)), io.BytesIO(text))
        self._tar.close()
        self._file.write(WORD + self._digested.sha256.encode())


class Archive:
    """An open backup, whose digest was checked when it was opened."""

    def __init__(self, tar: tarfile.TarFile, manifest: Manifest) -> None:
        self._tar, self.manifest = tar, manifest

    def extract(self, part: ArchivePart, target: Path) -> None:
        """Write a part to a new file, with its original time."""
        content: Any = self._tar.extractfile(part.path)
        with target.open("xb") as file:
            shutil.copyfileobj(content, file, PIECE_BYTES)
        modified = self._tar.getmember(part.path).mtime
        os.utime(target, (modified, modified))


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """Open a backup after checking its digest.

    Damaged if any byte is lost or changed; StoreError if it is another kind of file or from a newer
    program.
    """
    if not path.is_file():
        raise StoreError(f"{path} is not a file: give a backup file")
    with path.open("rb") as file:
        _check_digest(path, file)
        file.seek(0)
        try:
            with tarfile.open(fileobj=file, mode="r:") as tar:
                archive = Archive(tar, _manifest(path, tar))
                yield archive
        except tarfile.TarError as error:
            raise Damaged(f"{path} is not a complete backup ({error}): {REMEDY}") from error


def _check_digest(path: Path, file: BinaryIO) -> None:
    size = path.stat().st_size - TRAILER_BYTES
    file.seek(max(size, 0))
    trailer = file.read()
    if size < 0 or not trailer.startswith(WORD):
        raise Damaged(f"{path} is cut off, damaged, or not a backup: give another backup file")
    file.seek(0)
    digested = Digested(file)
    while digested.n_bytes < size:
        if not digested.read(min(PIECE_BYTES, size - digested.n_bytes)):
            break
    if digested.sha256.encode() != trailer[len(WORD) :]:
        raise Damaged(f"{path} is damaged (its digest does not match): {REMEDY}")


def _manifest(path: Path, tar: tarfile.TarFile) -> Manifest:
    members = tar.getmembers()
    names = [member.name for member in members]
    last = members[-1] if members else None
    if last is None or last.name != MANIFEST or last.size > LARGEST_MANIFEST:
        raise StoreError(f"{path} is not a Forewarn backup (no manifest): give another file")
    content = tar.extractfile(last)
    try:
        plain = json.loads(content.read() if content else b"")
        if plain["format"] > FORMAT:
            raise StoreError(
                f"{path} has format {plain['format']}, this program reads up to {FORMAT}: upgrade "
                "Forewarn"
            )
        manifest = Manifest(**plain | {"parts": [ArchivePart(**part) for part in plain["parts"]]})
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"the manifest of {path} cannot be read ({error}): {REMEDY}") from error
    listed = [*(part.path for part in manifest.parts), MANIFEST]
    plain_files = all(member.isfile() for member in members)
    if names != listed or not plain_files or not all(map(_is_part, names[:-1])):
        raise StoreError(f"the files in {path} differ from its manifest: {REMEDY}")
    if listed[0] != DATABASE or len(set(names)) != len(names):
        raise StoreError(f"{path} has no database, or has a file twice: {REMEDY}")
    return manifest


def _is_part(name: str) -> bool:
    parts = PurePosixPath(name).parts
    inside = len(parts) > 2 and parts[0] == RECORDINGS and ".." not in parts
    journal = len(parts) == 2 and parts[0] == JOURNALS and parts[1] != ".."
    return name == DATABASE or ((inside or journal) and str(PurePosixPath(*parts)) == name)


def _entry(path: str, size: int, modified: float = 0.0) -> tarfile.TarInfo:
    entry = tarfile.TarInfo(path)
    entry.size, entry.mode, entry.mtime = size, 0o600, modified
    return entry
