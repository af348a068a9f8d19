"""The folder of an archive's results, of this machine or at a URL that fsspec opens.

Its files are named by their paths below it, and written whole or not at all.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from uuid import uuid4

from app.recordings.remote_files import is_url, opened, reporting, stamp_of
from core.whole_file import write_whole

LOCAL = ("file", "local")
"""Protocols of URLs of this machine's folders."""


class ResultFolder(ABC):
    """OSError from each method; FileNotFoundError for a file that does not exist."""

    @property
    @abstractmethod
    def root(self) -> str:
        """Where it is, without links, to compare it with other places."""

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
        """Whether a place, given as its `root`, is this folder or lies in it."""
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
        found = (self.path / below).rglob(f"*{ending}")
        return {path.relative_to(self.path).as_posix() for path in found}

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
            found = (PurePosixPath(file).relative_to(path) for file in system.find(path))
            return {f"{below}/{file}" for file in found if not file.name.startswith(".")}

        try:
            found = self._ask("listed", below, find)
        except FileNotFoundError:
            return set()
        return {name for name in found if name.endswith(ending)}

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
        """What `ask` answers about the file of this name, for which it is to be `done`."""
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
