"""Recordings of an archive at a URL that fsspec opens, such as s3://bucket/folder."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

CHANGES = ("etag", "md5", "checksum", "mtime", "modified", "created", "updated")
"""Parts of the names of metadata that changes with a file's content."""


@dataclass(frozen=True)
class RemoteFile:
    """A file at a URL.   name: its path below the listed one.

    stamp: changes with the content; "" if no metadata of the file system does.
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
        with system.open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()


def is_url(source: str) -> bool:
    return "://" in source


def remote_files(url: str) -> list[RemoteFile]:
    """Files below a URL by name, without hidden ones. ValueError; OSError."""
    system, root = opened(url)
    system.invalidate_cache()
    root = root.rstrip("/")
    files = []
    try:
        listed = system.find(root, detail=True)
    except OSError:
        raise
    except Exception as error:  # the file system's own, such as for credentials
        raise OSError(f"{url} cannot be listed: {error}") from error
    for path, about in listed.items():
        name = path.removeprefix(root).lstrip("/")
        if name and not any(part.startswith(".") for part in name.split("/")):
            size = int(about.get("size") or 0)
            files.append(RemoteFile(system.unstrip_protocol(path), name, size, stamp_of(about)))
    return sorted(files, key=lambda file: file.name)


def stamp_of(about: dict[str, Any]) -> str:
    """Digest of the metadata that changes with a file's content; "" if there is none."""
    known = [key for key in about if any(part in key.lower() for part in CHANGES)]
    if not known:
        return ""
    lines = [f"{key}={about[key]}" for key in sorted({*known, "size"} & about.keys())]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


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


def result_folder(place: str) -> Path:
    if is_url(place):
        raise ValueError(f"the results are at the URL {place}: give a folder of this machine")
    return Path(place).expanduser().absolute()
