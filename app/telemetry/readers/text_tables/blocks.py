"""Split a text file into blocks of whole lines with uniform line ends."""

import codecs
from collections.abc import Iterator
from typing import BinaryIO

from app.telemetry.recording import TelemetryError

BLOCK_BYTES = 4 * 2**20
UTF8_MARK = codecs.BOM_UTF8


def blocks(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Pairs of the number of a block's first line, from 1, and the block; every line ends in \\n.

    UTF-16 is converted to UTF-8; other encodings stay. TelemetryError for a line longer than a
    block.
    """
    line, rest = 1, b""
    for chunk in _decoded(file):
        data = rest + chunk
        # the last byte may be the first half of a line end
        end = max(data.rfind(b"\n"), data.rfind(b"\r", 0, len(data) - 1)) + 1
        if not end and len(data) > BLOCK_BYTES:
            raise TelemetryError(
                f"line {line} is longer than {BLOCK_BYTES / 2**20:.0f} MiB: this is not a text "
                "table, export it again"
            )
        block, rest = data[:end], data[end:]
        if block:
            block = _with_plain_ends(block)
            yield line, block
            line += block.count(b"\n")
    if rest:
        block = _with_plain_ends(rest)
        yield line, block if block.endswith(b"\n") else block + b"\n"


def pieces(line: int, block: bytes, size: int) -> Iterator[tuple[int, bytes]]:
    """A block in pieces of about `size` bytes, with line numbers."""
    start = 0
    while start < len(block):
        end = block.find(b"\n", start + size) + 1 or len(block)
        piece = block[start:end]
        yield line, piece
        line += piece.count(b"\n")
        start = end


def _decoded(file: BinaryIO) -> Iterator[bytes]:
    """Chunks of the file in an encoding that extends ASCII, without a byte order mark."""
    chunk = file.read(BLOCK_BYTES)
    wide = wide_encoding(chunk[:4096])
    if not wide:
        yield chunk.removeprefix(UTF8_MARK)
        while chunk := file.read(BLOCK_BYTES):
            yield chunk
        return
    decoder = codecs.getincrementaldecoder(wide)("replace")
    mark = "\ufeff"
    while chunk:
        yield decoder.decode(chunk).removeprefix(mark).encode()
        mark = ""
        chunk = file.read(BLOCK_BYTES)


def wide_encoding(head: bytes) -> str:
    """UTF-16 by its byte order mark, or by zeros in every other byte; else ""."""
    if head.startswith(codecs.BOM_UTF16_LE):
        return "utf-16-le"
    if head.startswith(codecs.BOM_UTF16_BE):
        return "utf-16-be"
    even, odd = head[::2].count(0), head[1::2].count(0)
    if max(even, odd) > 0.4 * len(head) and min(even, odd) == 0:
        return "utf-16-le" if odd else "utf-16-be"
    return ""


def _with_plain_ends(block: bytes) -> bytes:
    if b"\r" in block:
        block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return block
