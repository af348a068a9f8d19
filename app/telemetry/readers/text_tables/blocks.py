"""Split a text file into blocks of whole lines, and parse a block with Arrow."""

import io
from collections.abc import Iterator, Mapping
from typing import BinaryIO

import numpy as np
import pyarrow as pa
from pyarrow import csv

from app.telemetry.formats import wide_encoding
from app.telemetry.readers.text_tables.layout import BLANKS, MISSING, Layout
from app.telemetry.readers.text_tables.times import Times, times_of
from app.telemetry.recording import TelemetryError
from core.types import Array

BLOCK_SIZE = 4 * 2**20
ARROW_BYTES = 2**20
"""Size of Arrow's own blocks, one per thread."""


def blocks(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Pairs of the number of a block's first line, from 1, and the block; every line ends in \\n.

    UTF-16 is converted to UTF-8; other encodings stay. TelemetryError for a line longer than a
    block.
    """
    wide = wide_encoding(file.read(4096))
    file.seek(0)
    text = io.TextIOWrapper(file, wide or "utf-8", "replace" if wide else "surrogateescape")
    line, mark = 1, "\ufeff"
    while read := text.read(BLOCK_SIZE):
        rest = "" if read.endswith("\n") else text.readline(BLOCK_SIZE + 1)
        if len(rest) > BLOCK_SIZE:
            line += read.count("\n")
            raise TelemetryError(
                f"line {line} is longer than {BLOCK_SIZE / 2**20:.0f} MiB: "
                "this is not a text table, export it again"
            )
        end = "" if (rest or read).endswith("\n") else "\n"
        block = (read.removeprefix(mark) + rest + end).encode(errors="surrogateescape")
        yield line, block
        line, mark = line + block.count(b"\n"), ""
    text.detach()


def pieces(line: int, block: bytes, size: int) -> Iterator[tuple[int, bytes]]:
    """A block in pieces of about `size` bytes, with line numbers."""
    start = 0
    while start < len(block):
        end = block.find(b"\n", start + size) + 1 or len(block)
        piece = block[start:end]
        yield line, piece
        line += piece.count(b"\n")
        start = end


Columns = Mapping[int, Array | Times]
"""Numbers (n,), or times, by number of the column."""


def parsed(block: bytes, layout: Layout, wanted: list[int]) -> tuple[int, Columns]:
    """Number of rows of a block, and its columns; ValueError unless every row is good."""
    if not wanted:
        raise ValueError("no column is wanted")
    delimiter = layout.delimiter.encode()
    if layout.delimiter == BLANKS:
        block = _tidied(block, delimiter)
    try:
        return _parsed(block, layout, wanted)
    except ValueError:
        if (tidy := _tidied(block, delimiter)) == block:
            raise
        return _parsed(tidy, layout, wanted)


def _parsed(block: bytes, layout: Layout, wanted: list[int]) -> tuple[int, Columns]:
    quoted = b'"' in block
    if quoted:
        _check_quotes(block, layout.delimiter.encode())
    forms = {str(i): layout.columns[i].form for i in wanted}
    table = csv.read_csv(
        pa.BufferReader(block),
        csv.ReadOptions(
            use_threads=len(block) > ARROW_BYTES,
            column_names=[str(i) for i in range(len(layout.columns))],
            block_size=ARROW_BYTES,
        ),
        csv.ParseOptions(delimiter=layout.delimiter),
        csv.ConvertOptions(
            column_types={i: pa.string() if form else pa.float64() for i, form in forms.items()},
            include_columns=list(forms),
            null_values=sorted(MISSING),
            strings_can_be_null=True,
            decimal_point=layout.decimal,
        ),
    )
    if quoted and table.num_rows != sum(map(bool, block.split(b"\n"))):
        raise ValueError("cells of several lines")
    return table.num_rows, {
        int(i): times_of(column, form) if form else _numbers(column)
        for (i, form), column in zip(forms.items(), table.columns, strict=True)
    }


def _tidied(block: bytes, delimiter: bytes) -> bytes:
    """A block without blanks around cells and with e in exponents."""
    block = block.translate(bytes.maketrans(b"dD", b"eE"))
    if delimiter == b" ":
        block = block.replace(b"\t", b" ")
    while b"  " in block:
        block = block.replace(b"  ", b" ")
    for sign in {delimiter, b"\n"} - {b" "}:
        block = block.replace(b" " + sign, sign).replace(sign + b" ", sign)
    return block.removeprefix(b" ")


def _check_quotes(block: bytes, delimiter: bytes) -> None:
    """ValueError if quotes do not enclose whole cells: Arrow would read "1"2 as 12."""
    signs = np.frombuffer(b"\n" + block, np.uint8)
    quotes = np.flatnonzero(signs == ord('"'))
    ends = [ord("\n"), ord(delimiter)]
    before, after = signs[quotes[::2] - 1], signs[quotes[1::2] + 1]
    if len(quotes) % 2 or not np.isin([before, after], ends).all():
        raise ValueError("quotes that do not match")


def _numbers(column: pa.ChunkedArray) -> Array:
    """Values, NaN if missing or infinite; Arrow's own conversion imports pandas first."""
    values = np.concatenate([np.empty(0), *map(_numbers_of_chunk, column.chunks)])
    values[~np.isfinite(values)] = np.nan
    return values


def _numbers_of_chunk(chunk: pa.Array) -> Array:
    known, numbers = chunk.buffers()
    values = np.frombuffer(numbers, float, len(chunk), 8 * chunk.offset)
    if chunk.null_count:
        bits = np.unpackbits(np.frombuffer(known, np.uint8), bitorder="little")
        values = np.where(bits[chunk.offset :][: len(chunk)], values, np.nan)
    return values
