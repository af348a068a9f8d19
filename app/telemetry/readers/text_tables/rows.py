"""Read a text table row by row: slow, but with the fault of each bad row."""

import csv
from dataclasses import dataclass, field
from math import nan

from app.telemetry.contents import MOST_LISTED, BadRow
from app.telemetry.readers.text_tables.cells import BLANKS, MISSING, cells, comment, number
from app.telemetry.readers.text_tables.layout import Layout, TextColumn
from app.telemetry.recording import TelemetryError

Value = float | str | None

ALWAYS_ALLOWED = 3
"""Bad rows that are allowed even in a small table, if twice as many are good."""
SHOWN = 5


@dataclass
class BadRows:
    """The bad rows so far. share: largest share of all rows."""

    share: float
    n: int = 0
    listed: list[BadRow] = field(default_factory=list)

    def add(self, line: int, reason: str, text: str) -> None:
        self.n += 1
        if len(self.listed) < MOST_LISTED:
            shown = text if text.isprintable() else ascii(text[:200])[1:-1]
            self.listed.append(BadRow(line, reason, shown[:80]))

    def check(self, n_good: int, share_read: float = 1.0) -> None:
        """Raise TelemetryError if there are too many.

        share_read: of the file. Before its end it is only refused with a clear excess.
        """
        expected = (n_good + self.n) / share_read * (1.0 if share_read == 1.0 else 1.5)
        few = min(ALWAYS_ALLOWED, n_good // 2)
        if self.n <= max(self.share * expected, few):
            return
        first = "; ".join(f"line {row.line}: {row.reason}" for row in self.listed[:SHOWN])
        rows = f"{n_good + self.n} rows" + (" so far" if share_read < 1.0 else "")
        raise TelemetryError(
            f"{self.n} of the {rows} cannot be read, more than {100 * self.share:g} % ({first}"
            f"{'; ...' if self.n > SHOWN else ''}): repair them or export the file again"
        )

    def notes(self, n_good: int) -> list[str]:
        if not self.n:
            return []
        percent = 100 * self.n / (n_good + self.n)
        return [f"Dropped {self.n} of {n_good + self.n} rows ({percent:.2g} %) as unreadable."]


@dataclass
class RowReader:
    """Reads rows and collects the bad ones.

    unfilled: columns without a number so far.
    turned_text: unfilled columns that turned out to be text, with the first line and cell of it.
    """

    layout: Layout
    bad: BadRows
    unfilled: set[int]
    turned_text: dict[int, tuple[int, str]] = field(default_factory=dict)

    def read(self, line: int, text: str, wanted: list[int]) -> list[list[Value]]:
        """The good rows: numbers, or times as text with None if missing.

        line: number of the first line.   wanted: numbers of the columns to read.
        """
        sign = comment(self.layout.delimiter)
        plain = self._is_plain(text, wanted)
        rows: list[list[Value]] = []
        for at, row in enumerate(text.split("\n"), line):
            values = self._plain_values(row, wanted) if plain else None
            if values is None and (not row.strip(" \t\f\v\x1a") or sign.match(row)):
                continue
            try:
                rows.append(values or self._values(at, self._cells(row), wanted))
            except BadCellError as error:
                self.bad.add(at, str(error), row)
        return rows

    def _is_plain(self, text: str, wanted: list[int]) -> bool:
        """Whether Python's float reads the rows without further checks."""
        return (
            self.layout.decimal == "."
            and not any(self.layout.columns[i].form or i in self.unfilled for i in wanted)
            and text.isascii()
            and not any(sign in text for sign in '"_')
        )

    def _plain_values(self, row: str, wanted: list[int]) -> list[Value] | None:
        row_cells = row.split(None if self.layout.delimiter == BLANKS else self.layout.delimiter)
        if len(row_cells) != len(self.layout.columns):
            return None
        try:
            return [float(row_cells[i]) for i in wanted]
        except ValueError:
            return None

    def _cells(self, row: str) -> list[str]:
        columns = self.layout.columns
        try:
            row_cells = cells(row, self.layout.delimiter)
        except csv.Error:
            raise BadCellError("unmatched quotes") from None
        surplus = len(row_cells) - len(columns)
        if surplus == -1 and columns[-1].is_padding:
            row_cells.append("")
        elif surplus and not (surplus == 1 and not row_cells[-1]):
            raise BadCellError(f"{len(row_cells)} cells instead of {len(columns)}")
        return row_cells

    def _values(self, line: int, row_cells: list[str], wanted: list[int]) -> list[Value]:
        values: list[Value] = []
        for i in wanted:
            column, cell = self.layout.columns[i], row_cells[i]
            if column.form:
                values.append(_time(column, cell))
                continue
            value = number(cell, self.layout.decimal)
            if value is None:
                if i not in self.unfilled:
                    raise BadCellError(_not_a("number", column, cell))
                self.turned_text.setdefault(i, (line, cell))
            values.append(nan if value is None or i in self.turned_text else value)
        for i, value in zip(wanted, values, strict=True):
            if i in self.unfilled and value == value and i not in self.turned_text:
                self.unfilled.discard(i)
        return values


class BadCellError(ValueError):
    """Why a row cannot be read."""


def _time(column: TextColumn, cell: str) -> str | None:
    if cell in MISSING:
        return None
    assert column.form
    if not column.form.matches(cell):
        raise BadCellError(_not_a(column.form.title, column, cell))
    return cell


def _not_a(expected: str, column: TextColumn, cell: str) -> str:
    if "\ufffd" in cell or "\0" in cell:
        return f"unreadable bytes in column {column.name}"
    return f"{cell[:40]!a} in column {column.name} is not a {expected}"
