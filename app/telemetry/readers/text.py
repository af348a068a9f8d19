"""Read text tables with comma, semicolon, tab, bar or blanks between cells."""

from itertools import chain
from pathlib import Path

import numpy as np
import pyarrow as pa

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.text_tables.blocks import blocks, pieces
from app.telemetry.readers.text_tables.layout import Layout, find_layout
from app.telemetry.readers.text_tables.parser import BlockParser, Rows, finite
from app.telemetry.readers.text_tables.rows import BadRows, RowReader
from app.telemetry.readers.text_tables.times import Array, ElapsedTime, times_of

HEAD_BYTES = 2**18
PIECE_BYTES = 2**16
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
                table.bad.check(table.n_rows, share)
    table.bad.check(table.n_rows)
    return table.finish()


def decoded(text: bytes) -> str:
    """Text in UTF-8, otherwise in the usual 8-bit encoding, with replacement characters."""
    try:
        return text.decode()
    except UnicodeDecodeError:
        return text.decode("cp1252", "replace")


class _Table:
    """Passes the columns of a table from blocks of text to the writer."""

    def __init__(self, layout: Layout, writer: ColumnWriter) -> None:
        self._columns, self._notes, self._writer = layout.columns, layout.notes, writer
        self._wanted = [i for i, column in enumerate(layout.columns) if column.kind != "text"]
        self._clocks = {
            i: ElapsedTime(c.form, c.example) for i, c in enumerate(layout.columns) if c.form
        }
        self._parser = BlockParser(layout)
        self.bad = BadRows(writer.bad_share)
        unfilled = {i for i in self._wanted if not layout.columns[i].example}
        self._rows = RowReader(layout, self.bad, unfilled)
        self.n_rows = 0
        group = writer.add_group()
        # times as text are the table's time, unless they repeat from row to row
        fine = next((i for i in self._clocks if not layout.columns[i].coarse), None)
        self._clock = self._clocks.get(fine if fine is not None else min(self._clocks, default=-1))
        self._signals = {
            i: writer.add_signal(
                group, layout.columns[i].name, layout.columns[i].unit, time=i == fine
            )
            for i in self._wanted
        }

    def add(self, line: int, block: bytes) -> None:
        """Append the good rows of a block of whole lines; its first line has number `line`."""
        parts = self._parsed(line, block)
        for i, signal in self._signals.items():
            values = [self._values(i, part) for part in parts]
            self._writer.append(signal, np.concatenate(values) if values else ())
        self.n_rows += sum(part.n for part in parts)

    def finish(self) -> Contents:
        ignored = [
            f"{column.name}: text such as {column.example!a}"
            for column in self._columns
            if column.kind == "text" and column.example
        ]
        for i, (line, cell) in self._rows.turned_text.items():
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
            bad_rows=tuple(self.bad.listed),
            n_bad_rows=self.bad.n,
            ignored=tuple(ignored),
            notes=(*self._notes, *times, *coarse, *self.bad.notes(self.n_rows)),
        )

    def _parsed(self, line: int, block: bytes) -> list[Rows]:
        try:
            return [self._with_fill(self._parser.parse(block, self._wanted))]
        except ValueError:
            pass
        parts = []
        for at, piece in pieces(line, block, PIECE_BYTES):
            try:
                part = self._with_fill(self._parser.parse(piece, self._wanted))
            except ValueError:
                part = self._row_by_row(at, piece)
            parts.append(part)
        return parts

    def _row_by_row(self, line: int, piece: bytes) -> Rows:
        rows = self._rows.read(line, decoded(piece), self._wanted)
        columns = zip(*rows, strict=True) if rows else ()
        result = Rows(len(rows), {})
        for i, values in zip(self._wanted, columns, strict=False):
            form = self._columns[i].form
            if form:
                result.columns[i] = times_of(
                    pa.chunked_array([pa.array(values, pa.string())]), form
                )
            else:
                result.columns[i] = finite(np.array(values, float))
        self._wanted = [i for i in self._wanted if i not in self._rows.turned_text]
        return result

    def _with_fill(self, part: Rows) -> Rows:
        """The rows, after noting which columns now have numbers."""
        unfilled = self._rows.unfilled
        unfilled -= {
            i for i in unfilled & part.columns.keys() if not np.isnan(part.columns[i]).all()
        }
        return part

    def _values(self, i: int, part: Rows) -> Array:
        values = part.columns.get(i)
        if values is None:
            return np.full(part.n, np.nan)
        return self._clocks[i].seconds(values) if isinstance(values, tuple) else values
