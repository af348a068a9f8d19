"""Split the first lines of a text table into cells, with the delimiter that fits best."""

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from app.telemetry.readers.text_tables.cells import DELIMITERS, cells, comment, kind

MOST_CELLS = 1 << 14
"""Most cells of a line; the rest is ignored, and such a table is refused."""


@dataclass(frozen=True)
class Line:
    """A line that is not blank. kinds: of its cells.   commented: whether it starts a comment."""

    number: int
    cells: tuple[str, ...]
    kinds: tuple[str, ...]
    commented: bool

    @property
    def n_values(self) -> int:
        return sum(kind in ("number", "time") for kind in self.kinds)


@dataclass(frozen=True)
class Lines:
    """Lines split at one delimiter, with one decimal sign.

    width: number of cells of the rows with most values; 0 if there are no values.
    """

    delimiter: str
    decimal: str
    plain: tuple[Line, ...]
    commented: tuple[Line, ...]
    width: int

    @property
    def rows(self) -> list[Line]:
        """Lines of that width with values, including any above the table."""
        return [line for line in self.plain if len(line.cells) == self.width and line.n_values]

    def share_read(self) -> float:
        """Share of the text, from the first row on, that is values in rows of one width."""
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
    """Lines split at the delimiter and with the decimal sign that fit best."""
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
    """Lines split at a delimiter; unmatched quotes are ignored."""
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
