"""Parse whole blocks of a text table with Arrow: fast, but all or nothing."""

from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
from pyarrow import csv

from app.telemetry.readers.text_tables.cells import BLANKS, MISSING
from app.telemetry.readers.text_tables.layout import Layout
from app.telemetry.readers.text_tables.times import Array, Times, times_of

ARROW_BYTES = 2**20
"""Size of Arrow's own blocks, one per thread."""


@dataclass
class Rows:
    """Rows of a table: numbers (n,), or times, by column number."""

    n: int
    columns: dict[int, Array | Times]


@dataclass
class BlockParser:
    """Parses blocks of good rows; ValueError for any other block.

    tidy: whether blanks must be removed from blocks first, which is slower.
    """

    layout: Layout
    tidy: bool = field(init=False)

    def __post_init__(self) -> None:
        self.tidy = self.layout.delimiter == BLANKS

    def parse(self, block: bytes, wanted: list[int]) -> Rows:
        delimiter = self.layout.delimiter.encode()
        if self.tidy:
            return self._parse(tidied(block, delimiter), wanted)
        try:
            return self._parse(block, wanted)
        except ValueError:
            if (tidy := tidied(block, delimiter)) is block:
                raise
            rows = self._parse(tidy, wanted)
            self.tidy = True
            return rows

    def _parse(self, block: bytes, wanted: list[int]) -> Rows:
        if not wanted:
            raise ValueError("no column is wanted")
        quoted = b'"' in block
        if quoted:
            check_quotes(block, self.layout.delimiter.encode())
        forms = {i: self.layout.columns[i].form for i in wanted}
        table = csv.read_csv(
            pa.BufferReader(block),
            csv.ReadOptions(
                column_names=[str(i) for i in range(len(self.layout.columns))],
                block_size=ARROW_BYTES,
            ),
            csv.ParseOptions(delimiter=self.layout.delimiter),
            csv.ConvertOptions(
                column_types={str(i): pa.string() if forms[i] else pa.float64() for i in wanted},
                include_columns=[str(i) for i in wanted],
                null_values=sorted(MISSING),
                strings_can_be_null=True,
                decimal_point=self.layout.decimal,
            ),
        )
        if quoted and table.num_rows != sum(map(bool, block.split(b"\n"))):
            raise ValueError("cells of several lines")
        return Rows(
            table.num_rows,
            {
                i: times_of(column, form) if (form := forms[i]) else _numbers(column)
                for i, column in zip(wanted, table.columns, strict=True)
            },
        )


def tidied(block: bytes, delimiter: bytes) -> bytes:
    """A block without blanks around cells and with e in exponents; itself if unchanged."""
    if not any(sign in block for sign in (b" ", b"\t", b"d", b"D")):
        return block
    block = block.translate(bytes.maketrans(b"dD", b"eE"))
    if delimiter == b" ":
        block = block.replace(b"\t", b" ")
    while b"  " in block:
        block = block.replace(b"  ", b" ")
    for sign in {delimiter, b"\n"} - {b" "}:
        block = block.replace(b" " + sign, sign).replace(sign + b" ", sign)
    return block.removeprefix(b" ")


def check_quotes(block: bytes, delimiter: bytes) -> None:
    """ValueError if quotes do not enclose whole cells: Arrow would read "1"2 as 12."""
    signs = np.frombuffer(b"\n" + block, np.uint8)
    quotes = np.flatnonzero(signs == ord('"'))
    ends = np.zeros(256, bool)
    ends[[ord("\n"), ord(delimiter)]] = True
    before, after = ends[signs[quotes[::2] - 1]], ends[signs[quotes[1::2] + 1]]
    if len(before) != len(after) or not (before.all() and after.all()):
        raise ValueError("quotes that do not match")


def _numbers(column: pa.ChunkedArray) -> Array:
    """Values, NaN if missing or infinite; Arrow's own conversion imports pandas first."""
    chunks = [_numbers_of_chunk(chunk) for chunk in column.chunks]
    return finite(np.concatenate(chunks or [np.empty(0)]))


def finite(values: Array) -> Array:
    """The values, with infinities and NaNs replaced by one NaN in place."""
    values[~np.isfinite(values)] = np.nan
    return values


def _numbers_of_chunk(chunk: pa.Array) -> Array:
    known, numbers = chunk.buffers()
    values = np.frombuffer(numbers, float, len(chunk), 8 * chunk.offset)
    if chunk.null_count:
        bits = np.unpackbits(np.frombuffer(known, np.uint8), bitorder="little")
        values = np.where(bits[chunk.offset :][: len(chunk)], values, np.nan)
    return values
