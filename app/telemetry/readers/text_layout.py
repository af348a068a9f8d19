"""Find the layout of a text table: delimiter, decimal sign, names, units and kinds of columns."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from math import isfinite, nan

from app.telemetry.contents import LONGEST_NAME, printable
from app.telemetry.readers.text_times import TimeForm, form_of, is_time
from app.telemetry.recording import TelemetryError
from app.telemetry.units import are_units, unit_in, unit_of_cell

SAMPLE_LINES = 500
"""Lines that are used to find the layout, including those above the table."""
MOST_CELLS = 1 << 14
"""Most cells of a line that are looked at; a table with so many is refused when it is written."""
MISSING_WORDS = (
    "", "-", "--", "---", "?", "NA", "N/A", "#N/A", "NaN", "-NaN", "+NaN", "NULL", "None", "NIL",
    "NaT", "missing", "inf", "+inf", "-inf", "infinity", "-infinity", "#NUM!", "#DIV/0!", "#VALUE!",
    "1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND", "1.#INF", "-1.#INF",
)  # fmt: skip
MISSING = frozenset(
    spelled for word in MISSING_WORDS for spelled in (word, word.lower(), word.upper())
) | {"*" * n for n in range(1, 33)}
"""Cells without a value; Fortran writes stars for a number that does not fit."""
BLANKS = " "
"""Delimiter of a table with runs of blanks and tabs between cells."""
DELIMITERS = ("\t", ";", ",", "|", BLANKS)
EXPONENT = str.maketrans("dD", "eE")
"""Fortran writes 1.5D+03."""
VALUES = ("number", "time")


@dataclass(frozen=True)
class TextColumn:
    """A column of the table. kind: "number", "time" or "text".   example: one of its cells.

    form: of its times.   coarse: whether its times repeat from row to row.
    """

    name: str
    unit: str
    kind: str
    example: str = ""
    form: TimeForm | None = None
    coarse: bool = False

    @property
    def is_padding(self) -> bool:
        """Whether it only exists because rows end in a delimiter."""
        return self.kind == "text" and not self.example


@dataclass(frozen=True)
class Layout:
    """delimiter: one of DELIMITERS.   first_line: line number of the first row, from 1."""

    delimiter: str
    decimal: str
    columns: tuple[TextColumn, ...]
    first_line: int
    notes: tuple[str, ...] = ()


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of one line, stripped of blanks. ValueError for unmatched quotes."""
    if delimiter == BLANKS:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    reader = csv.reader([line.strip(" ")], delimiter=delimiter, skipinitialspace=True, strict=True)
    try:
        return [cell.strip() for cell in next(reader)]
    except csv.Error:
        raise ValueError("unmatched quotes") from None


def comment(delimiter: str) -> re.Pattern[str]:
    """Pattern for the start of a comment; a semicolon counts unless it is the delimiter."""
    return re.compile(rf"\s*(?:#|%|//|!{'' if delimiter == ';' else '|;'})+")


def number(cell: str, decimal: str) -> float | None:
    """The number in a cell, NaN if missing, None if the cell is something else."""
    plain = cell
    if decimal == ",":
        plain = cell.replace(".", "_").replace(",", ".")
    try:
        value = float(plain)
    except ValueError:
        if cell in MISSING:
            return nan
        swapped = cell.translate(EXPONENT)
        return number(swapped, decimal) if swapped != cell else None
    if "_" in plain or not cell.isascii():
        return None  # spellings that only Python accepts
    return value if isfinite(value) else nan


def find_layout(head: str) -> Layout:
    """Find the layout from the beginning of a text. TelemetryError if there is no table."""
    text = head.split("\n")[:SAMPLE_LINES]
    lines = _best_parted(text)
    width = lines.width
    if not width:
        shown = next((line.strip()[:60] for line in text if line.strip()), "")
        raise TelemetryError(
            f"no row of numbers in the first {len(text)} lines, which start with "
            f"{shown!a}: give a text table with one row per sample"
        )
    counts = [Counter(row.kinds[i] for row in lines.rows) for i in range(width)]
    # a column without content may still get numbers
    kinds = [max((*VALUES, "text"), key=count.__getitem__) for count in counts]
    first_line, header, header_units = _header(lines, kinds, text)
    rows = [row for row in lines.rows if row.number >= first_line]
    shown = ["".join(c for c in name if c.isprintable()) for name in header[:width]]
    names = [printable(name, LONGEST_NAME) for name in shown] + [""] * (width - len(shown))
    names = [name or f"column_{i}" for i, name in enumerate(names, 1)]
    units = [unit_of_cell(u) for u in header_units] or [unit_in(name) for name in names]
    units += [""] * (width - len(units))
    columns = [_column(names[i], units[i], kinds[i], i, rows) for i in range(width)]
    if width > 1 and not any(header[width - 1 :]) and not columns[-1].example:
        columns[-1] = TextColumn(names[-1], "", "text")
    notes = ["Numbers have a decimal comma."] if lines.decimal == "," else []
    if not header:
        notes.append(
            f"No line of names above the numbers: columns are called column_1 to column_{width}."
        )
    if repeated := [name for name, count in Counter(names).items() if count > 1]:
        notes.append(f"Repeated names, numbered from the second on: {', '.join(repeated)}.")
    return Layout(lines.delimiter, lines.decimal, tuple(columns), first_line, tuple(notes))


def _column(name: str, unit: str, kind: str, i: int, rows: Sequence["_Line"]) -> TextColumn:
    of_kind = [row.cells[i] for row in rows if row.kinds[i] == kind]
    example = of_kind[0][:40] if of_kind else ""
    if kind != "time":
        return TextColumn(name, unit, kind, example)
    coarse = len(set(of_kind)) < 0.9 * len(of_kind)
    return TextColumn(name, "s", kind, example, form_of(of_kind), coarse)


@dataclass(frozen=True)
class _Line:
    """A line that is not blank. commented: whether it starts a comment."""

    number: int
    cells: list[str]
    kinds: Sequence[str]
    commented: bool

    @property
    def n_values(self) -> int:
        return sum(kind in VALUES for kind in self.kinds)


class _Lines:
    """Lines split at one delimiter, with one decimal sign.

    width: number of cells of the rows with most values; 0 if there are no values.
    """

    def __init__(self, text: Sequence[str], delimiter: str, decimal: str) -> None:
        self.delimiter, self.decimal, sign = delimiter, decimal, comment(delimiter)
        lines: list[_Line] = []
        for at, line in enumerate(text, 1):
            bare = sign.sub("", line, count=1) if sign.match(line) else line
            try:
                row = cells(bare, delimiter)[:MOST_CELLS]
            except ValueError:
                row = bare.split(delimiter)[:MOST_CELLS]
            if line.strip():
                lines.append(_Line(at, row, [_kind(c, decimal) for c in row], bare is not line))
        self.plain = [line for line in lines if not line.commented]
        self.commented = [line for line in lines if line.commented]
        values: Counter[int] = Counter()
        for line in self.plain:
            values[len(line.cells)] += line.n_values
        width, count = max(values.items(), key=lambda item: item[1], default=(0, 0))
        self.width = width if count else 0

    @cached_property
    def rows(self) -> list[_Line]:
        """Lines of that width with values, including any above the table."""
        return [line for line in self.plain if len(line.cells) == self.width and line.n_values]

    @cached_property
    def share_read(self) -> float:
        """Share of the text, from the first row on, that is values in rows of one width."""
        if not self.rows:
            return 0.0
        below = [line for line in self.plain if line.number >= self.rows[0].number]
        text = sum(len(line.cells) - 1 + sum(map(len, line.cells)) for line in below)
        values = (
            len(cell) if kind != "text" else 0
            for row in self.rows
            for cell, kind in zip(row.cells, row.kinds, strict=True)
        )
        return (len(self.rows) * (self.width - 1) + sum(values)) / text


def _best_parted(text: Sequence[str]) -> _Lines:
    ways: list[_Lines] = []
    for decimal in (".", ","):
        for delimiter in DELIMITERS:
            ways.append(_Lines(text, delimiter, decimal))
            if ways[-1].share_read == 1.0:
                return ways[-1]
    return max(ways, key=lambda lines: lines.share_read)


def _kind(cell: str, decimal: str) -> str:
    if cell in MISSING:
        return "missing"
    if number(cell, decimal) is not None:
        return "number"
    return "time" if is_time(cell) else "text"


def _header(
    lines: _Lines, kinds: Sequence[str], text: Sequence[str]
) -> tuple[int, Sequence[str], Sequence[str]]:
    """Line number of the first row, good or bad; cells of the lines of names and of units.

    kinds: of the columns.   The cells may be none or too few.
    """
    plain, n_values = lines.plain, sum(kind != "text" for kind in kinds)

    def is_row(line: _Line) -> bool:
        if len(line.cells) != lines.width or not line.n_values:
            return False
        pairs = zip(line.kinds, kinds, strict=True)
        return all(kind in (usual, "missing") or usual == "text" for kind, usual in pairs)

    def is_names(line: _Line) -> bool:
        surplus = len(line.cells) - lines.width
        fits = not surplus or (surplus == 1 and not line.cells[-1]) or (surplus == -1 and trailing)
        return fits and 2 * line.n_values <= n_values

    def is_bad_row(line: _Line) -> bool:
        n_given = sum(kind != "missing" for kind in line.kinds)
        return 2 * line.n_values > n_given and not is_names(line)

    first = next((i for i, line in enumerate(plain) if is_row(line)), 0)
    after = [row for row in lines.rows if row.number >= plain[first].number]
    trailing = all(row.kinds[-1] == "missing" for row in after)
    start = first - len([*takewhile(is_bad_row, reversed(plain[:first]))])
    above = [*takewhile(is_names, reversed(plain[:start]))]
    if not above:
        commented = (line for line in lines.commented if line.number < plain[first].number)
        above = [line for line in reversed([*commented]) if is_names(line)]
        while above and plain[start].number < above[0].number:
            start += 1
    first_line = plain[start].number
    if above:
        signs = ",;" if lines.delimiter == BLANKS else " "
        nearest, *next_above = [[c.strip(signs) for c in line.cells] for line in above[:2]]
        if next_above and are_units(nearest):
            return first_line, next_above[0], nearest
        return first_line, nearest, ()
    if lines.delimiter == BLANKS and start:
        # names that contain single blanks
        spread = re.split(r"\s{2,}|\t", text[plain[start - 1].number - 1].strip())
        if len(spread) == lines.width:
            return first_line, spread, ()
    return first_line, (), ()
