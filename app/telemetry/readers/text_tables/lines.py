"""The first lines of a text table parted into cells, by whatever makes most sense of them."""

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from app.telemetry.readers.text_tables.cells import DELIMITERS, cells, comment, kind

MOST_CELLS = 1 << 14
"""Of a line; further ones are not looked at, and a table of so many columns is refused."""


@dataclass(frozen=True)
class Line:
    """A line that is not blank. kinds: of its cells.   commented: it begins with a comment sign."""

    number: int
    cells: tuple[str, ...]
    kinds: tuple[str, ...]
    commented: bool

    @property
    def n_values(self) -> int:
        """Number of cells that are numbers or times."""
        return sum(kind in ("number", "time") for kind in self.kinds)


@dataclass(frozen=True)
class Lines:
    """Lines parted by one delimiter, with numbers of one decimal sign.

    width: number of cells of the rows that hold most of the values; 0 where none holds any.
    """

    delimiter: str
    decimal: str
    plain: tuple[Line, ...]
    commented: tuple[Line, ...]
    width: int

    @property
    def rows(self) -> list[Line]:
        """Lines of that width with values, also those above the table."""
        return [line for line in self.plain if len(line.cells) == self.width and line.n_values]

    def share_read(self) -> float:
        """How much of the text from the first row on is values in rows of one width, by length."""
        rows = self.rows
        if not rows:
            return 0.0
        read = sum(
            len(row.cells)
            - 1
            + sum(len(c) for c, k in zip(row.cells, row.kinds, strict=True) if k != "text")
            for row in rows
        )
        below = [line for line in self.plain if line.number >= rows[0].number]
        return read / sum(len(line.cells) - 1 + sum(map(len, line.cells)) for line in below)


def best_parted(text: Sequence[str]) -> Lines:
    """Lines parted by the delimiter and decimal sign that make most sense of them."""
    best, best_share = parted(text, DELIMITERS[0], "."), -1.0
    for decimal in (".", ","):
        for delimiter in DELIMITERS:
            lines = parted(text, delimiter, decimal)
            if (share := lines.share_read()) > best_share:
                best, best_share = lines, share
            if share == 1.0:
                return best
    return best


def parted(text: Sequence[str], delimiter: str, decimal: str) -> Lines:
    """Lines parted by a delimiter, without regard to quotes where they do not match."""
    sign = comment(delimiter)
    lines = []
    for number, line in enumerate(text, 1):
        if not line.strip():
            continue
        commented = sign.match(line) is not None
        bare = sign.sub("", line, count=1) if commented else line
        try:
            row = cells(bare, delimiter)
        except csv.Error:
            row = bare.split(delimiter)
        row = row[:MOST_CELLS]
        kinds = tuple(kind(cell, decimal) for cell in row)
        lines.append(Line(number, tuple(row), kinds, commented))
    plain = tuple(line for line in lines if not line.commented)
    commented = tuple(line for line in lines if line.commented)
    return Lines(delimiter, decimal, plain, commented, _width(plain))


def _width(plain: Sequence[Line]) -> int:
    values: Counter[int] = Counter()
    for line in plain:
        values[len(line.cells)] += line.n_values
    width, count = max(values.items(), key=lambda item: item[1], default=(0, 0))
    return width if count else 0
