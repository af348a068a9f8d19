"""Recordings at a URL that fsspec opens, such as s3://bucket/folder, fetched one at a time."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

CHANGES = ("etag", "md5", "checksum", "mtime", "modified", "created", "updated")
"""Parts of the names under which file systems say what changes with a file's content."""
PIECE_BYTES = 2**20


@dataclass(frozen=True)
class RemoteFile:
    """A file at a URL.   name: its path below the listed one.

    stamp: changes with the content, "" if the file system does not say what does.
    """

    url: str
    name: str
    size: int
    stamp: str

    @contextmanager
    def fetched(self) -> Iterator[Path]:
        """A copy of it, which is deleted afterwards. OSError."""
        system, path = opened(self.url)
        with TemporaryDirectory(prefix="forewarn-") as folder:
            copy = Path(folder) / PurePosixPath(self.name).name
            system.get_file(path, str(copy))
            yield copy

    def digest(self) -> str:
        """SHA-256 of its content, without storing it. OSError."""
        system, path = opened(self.url)
        digest = hashlib.sha256()
        with system.open(path, "rb") as file:
            while piece := file.read(PIECE_BYTES):
                digest.update(piece)
        return digest.hexdigest()


def is_url(source: str) -> bool:
    return "://" in source


def remote_files(url: str) -> list[RemoteFile]:
    """Files below a URL by name, without hidden ones. ValueError; OSError."""
    system, root = opened(url)
    system.invalidate_cache()
    root = root.rstrip("/")
    found = []
    with reporting(f"{url} cannot be listed"):
        listed = system.find(root, detail=True)
    for path, about in listed.items():
        name = path.removeprefix(root).lstrip("/")
        if name and not any(part.startswith(".") for part in name.split("/")):
            size = int(about.get("size") or 0)
            found.append(RemoteFile(system.unstrip_protocol(path), name, size, stamp_of(about)))
    return sorted(found, key=lambda file: file.name)


@contextmanager
def reporting(problem: str) -> Iterator[None]:
    """Raise the errors that file systems have of their own, such as for credentials, as OSError."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        raise OSError(f"{problem}: {error}") from error


def stamp_of(about: dict[str, Any]) -> str:
    """Of what a file system says about a file, what changes with its content; "" for nothing."""
    known = [key for key in about if any(part in key.lower() for part in CHANGES)]
    if not known:
        return ""
    said = [f"{key}={about[key]}" for key in sorted({*known, "size"} & about.keys())]
    return hashlib.sha256("\n".join(said).encode()).hexdigest()


def opened(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path there. ValueError."""
    try:
        from fsspec.core import url_to_fs

        return url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise ValueError(
            f"{url} cannot be opened ({error}): install forewarn[archive] and the file system's "
            "own package"
        ) from None
