"""An upload: a body of any size to a file, as it comes, off the event loop."""

import asyncio
import hashlib
import unicodedata
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from app.recordings.files import spacious
from app.recordings.workers import to_its_end

BLOCK_BYTES = 2**20
"""Written at once."""
PATIENCE_S = 60.0
"""An upload that sends nothing for so long is given up."""


class Stalled(Exception):
    """The sender stopped half-way and keeps the connection."""


@dataclass(frozen=True)
class Received:
    """A whole body on the disk. digest: its SHA-256."""

    size: int
    digest: str


async def receive(
    body: AsyncIterator[bytes], path: Path, require: Callable[[int], None]
) -> Received:
    """Write a body to a new file.

    require: raises where the disk has no room for so many bytes more.   Stalled; NoSpace.
    """
    sha, size, block = hashlib.sha256(), 0, bytearray()
    loop = asyncio.get_running_loop()
    file: BinaryIO = await to_its_end(lambda: path.open("xb"))

    def write(content: bytearray) -> None:
        require(len(content))
        with spacious():
            file.write(content)
        sha.update(content)

    try:
        async with asyncio.timeout(PATIENCE_S) as patience:
            async for chunk in body:
                block += chunk
                size += len(chunk)
                if len(block) >= BLOCK_BYTES:
                    await to_its_end(write, block)
                    block = bytearray()
                patience.reschedule(loop.time() + PATIENCE_S)
        await to_its_end(write, block)
    except TimeoutError:
        raise Stalled(
            f"nothing came for {PATIENCE_S:g} s after {size} bytes: send the file again"
        ) from None
    finally:
        await to_its_end(file.close)
    return Received(size, sha.hexdigest())


def plain_name(name: str) -> str:
    """What people call a file: without its path, and with nothing in it that does not print."""
    base = unicodedata.normalize("NFC", name.replace("\\", "/").rpartition("/")[2])
    return " ".join("".join(map(_shown, base)).split())


def _shown(character: str) -> str:
    """A character as it prints; a mark that only steers how others do is left out."""
    if character.isprintable():
        return character
    return "" if unicodedata.category(character) == "Cf" else " "
