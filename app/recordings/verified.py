"""Check files against their digests; a file is read again only after it was touched."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from app.store.database import Damaged

PIECE_BYTES = 2**20
Signature = tuple[int, int, int, int]


def digest_of(path: Path, rest: Callable[[], None] = lambda: None) -> str:
    """SHA-256 of a file. rest: called between pieces of work."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(PIECE_BYTES):
            digest.update(piece)
            rest()
    return digest.hexdigest()


class Verified:
    """Files whose digests were checked."""

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

    def knows(self, path: Path, expected: str) -> bool:
        """Whether a file had this digest and was not touched since: quick."""
        try:
            return self._files.get(path) == (_signature(path), expected)
        except OSError:
            return False


def _signature(path: Path) -> Signature:
    status = path.stat()
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
