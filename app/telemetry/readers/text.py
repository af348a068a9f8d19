"""Read text tables with comma, semicolon, tab, bar or blanks between cells."""

import io
from collections.abc import Iterator, Mapping
from itertools import chain
from math import nan
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
from pyarrow import csv

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.formats import wide_encoding
from app.telemetry.readers.text_layout import (
    BLANKS,
    MISSING,
    Layout,
    TextColumn,
    cells,
    comment,
    find_layout,
    number,
)
from app.telemetry.readers.text_times import ElapsedTime, Times, times_of
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
    chunks = column.fill_null(nan).chunks
    parts = [np.frombuffer(x.buffers()[1], float, len(x), 8 * x.offset) for x in chunks]
    values = np.concatenate([np.empty(0), *parts])
    values[~np.isfinite(values)] = nan
    return values


HEAD_BYTES = 2**18
PIECE_BYTES = 2**14
"""A block that cannot be parsed is retried in pieces of this size, then row by row."""


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a table with a line of names, optionally a line of units, and one line per sample.

    Bad rows are dropped, up to the writer's share, and so are columns of text.
    Raises TelemetryError if no table is left.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        stream = blocks(file)
        line, head = next(stream, (1, b""))
        layout = find_layout(decoded(head[: head.find(b"\n", HEAD_BYTES) + 1] or head))
        table = _Table(layout, writer)
        rows = head.split(b"\n", layout.first_line - line)[-1]
        for at, block in chain([(layout.first_line, rows)], stream):
            table.add(at, block)
            if (share := file.tell() / size) < 1.0:
                writer.bad.check(table.n_rows, share)
    return table.finish()


def decoded(text: bytes) -> str:
    """Text in UTF-8, otherwise in the usual 8-bit encoding, with replacement characters."""
    try:
        return text.decode()
    except UnicodeDecodeError:
        return text.decode("cp1252", "replace")


class _Table:
    """Passes the columns of a table from blocks of text to the writer.

    A block of good rows is parsed at once; of any other, each bad row is found and dropped.
    """

    def __init__(self, layout: Layout, writer: ColumnWriter) -> None:
        self._layout, self._columns, self._writer = layout, layout.columns, writer
        self._wanted = [i for i, column in enumerate(layout.columns) if column.kind != "text"]
        self._clocks = {
            i: ElapsedTime(c.form, c.example) for i, c in enumerate(layout.columns) if c.form
        }
        self._unfilled = {i for i in self._wanted if not layout.columns[i].example}
        """Columns without a number so far; a cell of text makes one a column of text."""
        self._turned_text: dict[int, tuple[int, str]] = {}
        """By such a column, the line and cell of its first text."""
        self.n_rows = 0
        group = writer.add_group()
        # times as text are the table's time, unless they repeat from row to row
        fine = next((i for i in self._clocks if not layout.columns[i].coarse), None)
        self._clock = self._clocks.get(fine if fine is not None else min(self._clocks, default=-1))
        self._signals = [*self._wanted]
        for i in self._signals:
            column = layout.columns[i]
            writer.add_signal(group, column.name, column.unit, time=i == fine)

    def add(self, line: int, block: bytes) -> None:
        """Append the good rows of a block of whole lines; its first line has number `line`."""
        parts = [*self._parts(line, block, BLOCK_SIZE)]
        for signal, values in enumerate(np.concatenate(parts, axis=1) if parts else ()):
            self._writer.append(signal, values)
        self.n_rows += sum(part.shape[1] for part in parts)

    def finish(self) -> Contents:
        """Complete the columns. TelemetryError if too many rows are bad or too few good."""
        bad = self._writer.bad
        bad.check(self.n_rows)
        ignored = [
            f"{column.name}: text such as {column.example!a}"
            for column in self._columns
            if column.kind == "text" and column.example
        ]
        for i, (line, cell) in self._turned_text.items():
            ignored.append(f"{self._columns[i].name}: text from line {line} on, {cell[:40]!a}")
        times = [n for i, c in self._clocks.items() for n in c.notes(self._columns[i].name)]
        coarse = [
            f"{column.name} repeats its times from row to row, so it is not used as the time."
            for column in self._columns
            if column.coarse
        ]
        return self._writer.finish(
            "csv",
            start=self._clock.start() if self._clock else "",
            ignored=tuple(ignored),
            notes=(*self._layout.notes, *times, *coarse, *bad.notes(self.n_rows)),
        )

    def _parts(self, line: int, block: bytes, size: int) -> Iterator[Array]:
        """The signals (signals, n) of a block, or of its pieces if it has bad rows."""
        try:
            n, columns = parsed(block, self._layout, self._wanted)
        except ValueError:
            if size > PIECE_BYTES:
                for at, piece in pieces(line, block, PIECE_BYTES):
                    yield from self._parts(at, piece, PIECE_BYTES)
                return
            n, columns = self._row_by_row(line, block)
        part = np.full((len(self._signals), n), nan)
        for k, i in enumerate(self._signals):
            values = columns.get(i, nan)
            part[k] = self._clocks[i].seconds(values) if isinstance(values, tuple) else values
            if i in self._unfilled and not np.isnan(part[k]).all():
                self._unfilled.discard(i)
        yield part

    def _row_by_row(self, line: int, piece: bytes) -> tuple[int, Columns]:
        """The good rows; the others are noted with their faults."""
        sign, rows = comment(self._layout.delimiter), list[list[float | str | None]]()
        for at, text in enumerate(decoded(piece).split("\n"), line):
            if text.strip(" \t\f\v\x1a") and not sign.match(text):
                try:
                    rows.append(self._values(at, text))
                except ValueError as error:
                    self._writer.bad.add(at, str(error), text)
        columns: dict[int, Array | tuple] = {}
        for i, values in zip(self._wanted, zip(*rows, strict=True), strict=False):
            if form := self._columns[i].form:
                columns[i] = times_of(pa.chunked_array([pa.array(values, pa.string())]), form)
            else:
                columns[i] = np.array(values, float)
        self._wanted = [i for i in self._wanted if i not in self._turned_text]
        return len(rows), columns

    def _values(self, line: int, text: str) -> list[float | str | None]:
        """Numbers, or times as text with None if missing; ValueError with the fault of the row."""
        row, width = cells(text, self._layout.delimiter), len(self._columns)
        if len(row) == width - 1 and self._columns[-1].is_padding:
            row.append("")
        if len(row) != width and not (len(row) == width + 1 and not row[-1]):
            raise ValueError(f"{len(row)} cells instead of {width}")
        values: list[float | str | None] = []
        for i in self._wanted:
            column, cell = self._columns[i], row[i]
            if column.form:
                if cell not in MISSING and not column.form.parts(cell):
                    raise ValueError(_not_a(column.form.title, column, cell))
                values.append(None if cell in MISSING else cell)
                continue
            value = number(cell, self._layout.decimal)
            if value is None:
                if i not in self._unfilled:
                    raise ValueError(_not_a("number", column, cell))
                self._turned_text.setdefault(i, (line, cell))
            values.append(nan if value is None or i in self._turned_text else value)
        filled = zip(self._wanted, values, strict=True)
        self._unfilled -= {i for i, v in filled if v == v and i not in self._turned_text}
        return values


def _not_a(expected: str, column: TextColumn, cell: str) -> str:
    if "\ufffd" in cell or "\0" in cell:
        return f"unreadable bytes in column {column.name}"
    return f"{cell[:40]!a} in column {column.name} is not a {expected}"
