"""The journal: durable before it is acknowledged, whole lines only, nothing lost to a full disk."""

import asyncio
import errno
import os
from pathlib import Path

import pytest

from app.telemetry import journal as module
from app.telemetry.journal import JournalFull, Journals, lines_of


def test_what_is_acknowledged_is_in_the_file(tmp_path: Path) -> None:
    async def write() -> None:
        journals = Journals(tmp_path)
        journal = journals.open("a")
        for n in range(5):
            await journal.append({"n": n})
            assert [line["n"] for line in lines_of(journal.path)] == [*range(n + 1)]
        journals.close()

    asyncio.run(write())


def test_a_torn_last_line_is_cut_off_and_writing_goes_on(tmp_path: Path) -> None:
    async def write() -> None:
        path = tmp_path / "a.jsonl"
        path.write_bytes(b'{"n":0}\n{"n":1}\n{"n":2')
        assert [line["n"] for line in lines_of(path)] == [0, 1]
        journals = Journals(tmp_path)
        await journals.open("a").append({"n": 2})
        assert path.read_bytes() == b'{"n":0}\n{"n":1}\n{"n":2}\n'
        journals.close()

    asyncio.run(write())


@pytest.fixture
def is_full(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether the disk is full, which writes three bytes and refuses; tried again at once."""
    monkeypatch.setattr(module, "RETRY_S", 0.01)
    is_full, real = [True], os.pwrite

    def pwrite(file: int, content: bytes, offset: int) -> int:
        if is_full[0]:
            real(file, content[:3], offset)
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(file, content, offset)

    monkeypatch.setattr(module.os, "pwrite", pwrite)
    return is_full


def test_what_a_full_disk_refuses_waits_and_is_written_when_there_is_space(
    tmp_path: Path, is_full: list[bool], caplog: pytest.LogCaptureFixture
) -> None:
    async def write() -> None:
        journals = Journals(tmp_path)
        journal = journals.open("a")
        written = journal.append({"n": 0})
        while not journal.problem:
            await asyncio.sleep(0.001)
        assert not written.done()
        assert journal.path.read_bytes() == b""
        is_full[0] = False
        await written
        assert journal.problem == ""
        assert journal.path.read_bytes() == b'{"n":0}\n'
        journals.close()

    asyncio.run(write())
    assert "No space left" in caplog.text


def test_what_a_full_disk_refuses_at_the_end_of_a_flight_goes_into_its_own_file(
    tmp_path: Path, is_full: list[bool]
) -> None:
    async def write() -> None:
        journals = Journals(tmp_path)
        journal = journals.open("a")
        written = journal.append({"n": 0})
        journal.close()
        other = os.open(tmp_path / "other", os.O_RDWR | os.O_CREAT)  # the next free number
        is_full[0] = False
        await written
        os.close(other)
        assert (tmp_path / "other").read_bytes() == b""
        assert journal.path.read_bytes() == b'{"n":0}\n'
        journals.close()
        assert journal.is_closed

    asyncio.run(write())


def test_more_than_may_wait_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_WAITING", 20)

    async def write() -> None:
        journal = Journals(tmp_path).open("a")
        with pytest.raises(JournalFull, match="repeat the batches not acknowledged"):
            journal.append({"text": "x" * 30})

    asyncio.run(write())


def test_closing_writes_what_waits(tmp_path: Path) -> None:
    async def write() -> None:
        journals = Journals(tmp_path)
        journal = journals.open("a")
        journal.append({"n": 0})
        journal.close()
        assert [line["n"] for line in lines_of(journal.path)] == [0]
        journals.close()

    asyncio.run(write())


def test_what_comes_while_the_thread_writes_is_written_before_the_file_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def write() -> None:
        journals = Journals(tmp_path)
        monkeypatch.setattr(journals, "_note", lambda journal: None)
        journal = journals.open("a")
        journal.append({"n": 0})

        def sync(file: int) -> None:
            monkeypatch.setattr(module.os, "fdatasync", lambda file: None)
            journal.append({"n": 1})
            journal._is_closing = True

        monkeypatch.setattr(module.os, "fdatasync", sync)
        journal.commit()
        assert not journals.is_whole("a")
        journal.close()
        assert journals.is_whole("a")
        assert [line["n"] for line in lines_of(journal.path)] == [0, 1]

    asyncio.run(write())
