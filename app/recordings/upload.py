"""Write an upload of any size to a file in chunks, outside the event loop."""

import asyncio
import hashlib
import unicodedata
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

from app.recordings.files import reporting_full_disk
from app.recordings.workers import run_to_end

BLOCK_BYTES = 2**20
"""Size of a write."""
STALL_AFTER_S = 60.0
"""An upload without data for this long is aborted."""


class Stalled(Exception):
    """The client stopped sending but keeps the connection open."""


class SentField(NamedTuple):
    """A field of a form, or a whole body.   file_name: "" for text, and if the sender gave none."""

    name: str
    file_name: str
    content: AsyncIterator[bytes]


@dataclass(frozen=True)
class Received:
    """A complete body on the disk. digest: its SHA-256."""

    size: int
    digest: str


async def receive(
    body: AsyncIterator[bytes], path: Path, require: Callable[[int], None]
) -> Received:
    """Write a body to a new file.

    require: raises if the disk has no room for so many more bytes.   Stalled; NoSpace.
    """
    sha, size, block = hashlib.sha256(), 0, bytearray()
    loop = asyncio.get_running_loop()
    file: BinaryIO = await run_to_end(lambda: path.open("xb"))

    def write(content: bytearray) -> None:
        require(len(content))
        with reporting_full_disk():
            file.write(content)
        sha.update(content)

    try:
        async with asyncio.timeout(STALL_AFTER_S) as deadline:
            async for chunk in body:
                block += chunk
                size += len(chunk)
                if len(block) >= BLOCK_BYTES:
                    await run_to_end(write, block)
                    block = bytearray()
                deadline.reschedule(loop.time() + STALL_AFTER_S)
        await run_to_end(write, block)
    except TimeoutError:
        raise Stalled(
            f"no data for {STALL_AFTER_S:g} s after {size} bytes: send the file again"
        ) from None
    finally:
        await run_to_end(file.close)
    return Received(size, sha.hexdigest())


def plain_name(name: str) -> str:
    """A file name for people: without path and non-printing characters."""
    base = unicodedata.normalize("NFC", name.replace("\\", "/").rpartition("/")[2])
    return " ".join("".join(map(_shown, base)).split())


def _shown(character: str) -> str:
    """A printable character; formatting characters are removed, others become blanks."""
    if character.isprintable():
        return character
    return "" if unicodedata.category(character) == "Cf" else " "
