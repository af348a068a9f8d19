"""The journal of a live flight: every batch as received, with its arrival time.

    live/<flight>.jsonl     lines of JSON: a description of the flight, batches, events

A line is acknowledged once it is on the disk. One thread writes for all flights, so a slow disk
delays only acknowledgements. Lines that a full disk refuses wait and are retried.
"""

import asyncio
import hashlib
import logging
import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

LOG = logging.getLogger("forewarn")
MOST_WAITING = 64 * 2**20
"""Most bytes of one flight that wait for the disk; further batches are refused."""
RETRY_S = 1.0
PAUSE_S = 0.004
"""Per flight with lines to write: lines within this time are written together [s]."""
ENDING = ".jsonl"
_encoder = msgspec.json.Encoder()


class JournalFull(OSError):
    """Too much waits for the disk: the source must keep the batch and repeat it."""


class Journals:
    """The journals in one folder, and the thread that writes them."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._dirty: set[Journal] = set()
        self._opened: dict[str, Journal] = {}
        self._wake, self._closed = threading.Event(), False
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def open(self, flight_id: str, digest: "hashlib._Hash | None" = None) -> "Journal":
        """Open the journal of a flight for writing, without an incomplete last line. OSError.

        digest: SHA-256 of its complete lines; None if they are not read yet.
        """
        self.root.mkdir(parents=True, exist_ok=True, mode=0o700)
        journal = self._opened[flight_id] = Journal(self, self.path(flight_id), digest)
        return journal

    def is_whole(self, flight_id: str) -> bool:
        """Whether a journal is closed and all of it is on the disk."""
        journal = self._opened.get(flight_id)
        return journal is None or journal.is_closed

    def path(self, flight_id: str) -> Path:
        return self.root / f"{flight_id}{ENDING}"

    def last(self, flight_id: str) -> dict[str, Any]:
        """The last line of a flight's journal; empty if there is none."""
        try:
            file = os.open(self.path(flight_id), os.O_RDONLY)
        except FileNotFoundError:
            return {}
        try:
            end = _whole(file)
            start = _whole(file, end - 1)
            return msgspec.json.decode(os.pread(file, end - start, start)) if end else {}
        finally:
            os.close(file)

    def has(self, flight_id: str) -> bool:
        return self.path(flight_id).exists()

    def size(self, flight_id: str) -> int:
        """Bytes of a journal; 0 if there is none or its recording shares the file."""
        try:
            status = self.path(flight_id).stat()
        except FileNotFoundError:
            return 0
        return status.st_size if status.st_nlink == 1 else 0

    def delete(self, flight_id: str) -> None:
        self._opened.pop(flight_id, None)
        self.path(flight_id).unlink(missing_ok=True)

    def close(self) -> None:
        """Write pending lines, then stop."""
        self._closed = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join()

    def _note(self, journal: "Journal") -> None:
        if journal in self._dirty:
            return
        with self._lock:
            self._dirty.add(journal)
            if self._thread is None:
                self._thread = threading.Thread(target=self._write, name="journal", daemon=True)
                self._thread.start()
        self._wake.set()

    def _write(self) -> None:
        while True:
            self._wake.wait()
            if not self._closed:
                time.sleep(PAUSE_S * (1 + len(self._dirty)))
            self._wake.clear()
            with self._lock:
                dirty, self._dirty = self._dirty, set()
            failed = {journal for journal in dirty if not journal.commit()}
            if self._closed:
                return
            if failed:
                with self._lock:
                    self._dirty |= failed
                threading.Timer(RETRY_S, self._wake.set).start()


class Journal:
    """One flight's journal. `append` is called in the event loop, `commit` in the thread.

    is_closed: whether it accepts no more lines and all of it is on the disk.
    """

    def __init__(
        self, journals: Journals, path: Path, digest: "hashlib._Hash | None" = None
    ) -> None:
        self._journals, self.path = journals, path
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        self._size = _whole(self._file)
        os.ftruncate(self._file, self._size)
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self._is_closing = self.is_closed = False
        self._waiting: list[bytes] = []
        self._groups: list[asyncio.Future[None]] = []
        self._is_grouping = False
        self._bytes = 0
        self._digest = digest
        self.problem = ""

    def append(self, line: dict[str, Any]) -> asyncio.Future[None]:
        """Queue a line. Returns a future, shared by lines written together. JournalFull.

        The future is done once the line is on the disk.
        """
        text = _encoder.encode(line) + b"\n"
        if self._bytes + len(text) > MOST_WAITING:
            raise JournalFull(
                f"{self._bytes} bytes of this flight wait for the disk, which refuses writes "
                f"({self.problem}): free space, then repeat the batches not acknowledged"
            )
        with self._lock:
            if not self._is_grouping:
                self._groups.append(asyncio.get_running_loop().create_future())
                self._is_grouping = True
            self._waiting.append(text)
            self._bytes += len(text)
            group = self._groups[-1]
        self._journals._note(self)
        return group

    def settled(self) -> asyncio.Future[None]:
        """A future that is done once all queued lines are on the disk."""
        with self._lock:
            if self._waiting:
                return self._groups[-1]
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        future.set_result(None)
        return future

    def commit(self) -> bool:
        """Flush queued lines. Returns False if the write failed."""
        with self._writing:
            if self.is_closed:
                return True
            if not self._commit():
                return False
            if self._is_closing and not self._waiting:
                os.close(self._file)
                self.is_closed = True
            return True

    def _commit(self) -> bool:
        with self._lock:
            n_lines, n_groups = len(self._waiting), len(self._groups)
            content, self._is_grouping = b"".join(self._waiting), False
        if not content:
            return True
        try:
            if self._digest is None:
                with self.path.open("rb") as earlier:
                    self._digest = hashlib.file_digest(earlier, "sha256")
            _write_all(self._file, content, self._size)
            os.fdatasync(self._file)
        except OSError as error:
            self._refused(error)
            return False
        self._digest.update(content)
        self._size += len(content)
        self.problem = ""
        with self._lock:
            del self._waiting[:n_lines]
            self._bytes -= len(content)
            groups, self._groups = self._groups[:n_groups], self._groups[n_groups:]
        with suppress(RuntimeError):  # the loop has ended
            groups[0].get_loop().call_soon_threadsafe(_resolve, groups)
        return True

    def close(self) -> str | None:
        """Accept no more lines; close the file once all queued lines are written.

        Returns the SHA-256 of all lines; None while some wait for the disk.
        """
        self._is_closing = True
        self.commit()
        return self._digest.hexdigest() if self.is_closed and self._digest else None

    def _refused(self, error: OSError) -> None:
        if not self.problem:
            LOG.error("%s is not written: %s; retrying", self.path, error)
        self.problem = error.strerror or str(error)
        with suppress(OSError):
            os.ftruncate(self._file, self._size)


class JournalReader:
    """Reads a journal that another process may write meanwhile.

    digest: SHA-256 of the lines read.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.digest = path, hashlib.sha256()
        self._end, self._last = 0, b""

    def is_continued(self) -> bool:
        """Whether the last line read is still where it was, so that those before it are, too.

        Each has its time of arrival. OSError.
        """
        with self.path.open("rb") as file:
            file.seek(self._end - len(self._last))
            return file.read(len(self._last)) == self._last

    def lines(self) -> Iterator[dict[str, Any]]:
        """The next lines, in order, without an incomplete last one. OSError."""
        with self.path.open("rb") as file:
            file.seek(self._end)
            for line in file:
                if not line.endswith(b"\n"):
                    return
                plain = msgspec.json.decode(line)
                self._end, self._last = self._end + len(line), line
                self.digest.update(line)
                yield plain


def lines_of(path: Path) -> Iterator[dict[str, Any]]:
    """The lines of a journal, in order, without an incomplete last one. OSError."""
    return JournalReader(path).lines()


def _resolve(futures: list[asyncio.Future[None]]) -> None:
    for future in futures:
        if not future.done():
            future.set_result(None)


def _write_all(file: int, content: bytes, offset: int) -> None:
    done = 0
    while done < len(content):
        done += os.pwrite(file, content[done:], offset + done)


def _whole(file: int, size: int | None = None) -> int:
    """Length up to the last complete line within the first `size` bytes; of all if None."""
    size = os.fstat(file).st_size if size is None else max(0, size)
    while size:
        start = max(0, size - 65536)
        block = os.pread(file, size - start, start)
        end = block.rfind(b"\n")
        if end >= 0:
            return start + end + 1
        size = start
    return 0
