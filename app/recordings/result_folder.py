"""Folders of an archive on this machine or at a URL that fsspec opens, such as s3://bucket/folder.

Recordings at a URL are fetched one at a time. Results are written whole or not at all.
"""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any
from uuid import uuid4

from core.whole_file import write_whole

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
    with reporting(f"{url} cannot be listed"):
        listed = system.find(root, detail=True)
    for path, about in listed.items():
        name = path.removeprefix(root).lstrip("/")
        if name and not any(part.startswith(".") for part in name.split("/")):
            size = int(about.get("size") or 0)
            files.append(RemoteFile(system.unstrip_protocol(path), name, size, stamp_of(about)))
    return sorted(files, key=lambda file: file.name)


@contextmanager
def reporting(problem: str) -> Iterator[None]:
    """Raise a file system's own errors, such as for credentials, as OSError."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        raise OSError(f"{problem}: {error}") from error


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


LOCAL = ("file", "local")
"""Protocols of URLs of this machine's folders."""


class ResultFolder(ABC):
    """The results of an archive; files are named by their paths in it.

    Each method raises OSError; FileNotFoundError for a file that does not exist.
    """

    @property
    @abstractmethod
    def root(self) -> str:
        """Its place without links, to compare it with others."""

    @abstractmethod
    def read(self, name: str) -> bytes: ...

    @abstractmethod
    def write(self, name: str, content: bytes) -> None: ...

    @abstractmethod
    def delete(self, name: str) -> None:
        """Delete a file, if there is one."""

    @abstractmethod
    def names(self, below: str, ending: str) -> set[str]:
        """Names of the files below one of its folders, empty if there is none."""

    @abstractmethod
    def stamp(self, name: str) -> str:
        """Changes with the content of a file."""

    @abstractmethod
    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""

    @abstractmethod
    def has_folder(self, name: str) -> bool: ...

    @property
    def name(self) -> str:
        return PurePosixPath(str(self)).name

    def holds(self, place: str) -> bool:
        """Whether another folder's `root` is this folder or inside it."""
        return PurePosixPath(place).is_relative_to(self.root)


@dataclass(frozen=True)
class LocalFolder(ResultFolder):
    """A folder of this machine, by its absolute path."""

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    @property
    def root(self) -> str:
        return str(self.path.resolve())

    def read(self, name: str) -> bytes:
        path = (self.path / name).resolve()
        if not path.is_relative_to(self.path.resolve()):
            raise PermissionError(f"{name} is a link out of {self.path}: replace it by the file")
        return path.read_bytes()

    def write(self, name: str, content: bytes) -> None:
        path = self.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)

    def delete(self, name: str) -> None:
        (self.path / name).unlink(missing_ok=True)

    def names(self, below: str, ending: str) -> set[str]:
        paths = (self.path / below).rglob(f"*{ending}")
        return {path.relative_to(self.path).as_posix() for path in paths}

    def stamp(self, name: str) -> str:
        about = (self.path / name).stat()
        return f"{about.st_mtime_ns} {about.st_size} {about.st_ino}"

    def has(self, name: str) -> bool:
        return (self.path / name).is_file()

    def has_folder(self, name: str) -> bool:
        return (self.path / name).is_dir()


@dataclass(frozen=True)
class RemoteFolder(ResultFolder):
    """A folder at a URL, without a slash at its end."""

    url: str

    def __str__(self) -> str:
        return self.url

    @property
    def root(self) -> str:
        return self._ask("opened", "", lambda system, path: system.unstrip_protocol(path))

    def read(self, name: str) -> bytes:
        return self._ask("read", name, lambda system, path: system.cat_file(path))

    def write(self, name: str, content: bytes) -> None:
        def write(system: Any, path: str) -> None:
            folder, _, file = path.rpartition("/")
            part = f"{folder}/.{file}.{uuid4().hex}"
            system.makedirs(folder, exist_ok=True)
            try:
                system.pipe_file(part, content)
                system.mv(part, path)
            except BaseException:
                with suppress(Exception):
                    system.rm_file(part)
                raise

        self._ask("written", name, write)

    def delete(self, name: str) -> None:
        with suppress(FileNotFoundError):
            self._ask("deleted", name, lambda system, path: system.rm_file(path))

    def names(self, below: str, ending: str) -> set[str]:
        def find(system: Any, path: str) -> set[str]:
            system.invalidate_cache()
            names = (PurePosixPath(file).relative_to(path) for file in system.find(path))
            return {f"{below}/{file}" for file in names if not file.name.startswith(".")}

        try:
            names = self._ask("listed", below, find)
        except FileNotFoundError:
            return set()
        return {name for name in names if name.endswith(ending)}

    def stamp(self, name: str) -> str:
        def stamp(system: Any, path: str) -> str:
            system.invalidate_cache()
            return stamp_of(system.info(path)) or uuid4().hex

        return self._ask("read", name, stamp)

    def has(self, name: str) -> bool:
        return self._ask("read", name, lambda system, path: system.isfile(path))

    def has_folder(self, name: str) -> bool:
        return self._ask("read", name, lambda system, path: system.isdir(path))

    def _ask(self, done: str, name: str, ask: Callable[[Any, str], Any]) -> Any:
        """Call `ask` with the file system and the path of a file.   done: for the error."""
        system, root = opened(self.url)
        with reporting(f"{self.url}/{name} cannot be {done}"):
            return ask(system, "/".join(filter(None, (root.rstrip("/"), name))))


def result_folder(place: str) -> ResultFolder:
    """The folder of a path or URL. ValueError for a URL that no file system opens."""
    system, _, path = place.partition("://")
    if is_url(place) and system not in LOCAL:
        opened(place)
        return RemoteFolder(place.rstrip("/"))
    return LocalFolder(Path(path if is_url(place) else place).expanduser().absolute())
