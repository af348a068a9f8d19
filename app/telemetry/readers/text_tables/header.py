"""Find the header of a text table: names of its columns and optionally units."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

from app.telemetry.contents import LONGEST_NAME, printable
from app.telemetry.readers.text_tables.cells import BLANKS
from app.telemetry.readers.text_tables.lines import Line, Lines
from app.telemetry.readers.written_units import are_units


@dataclass(frozen=True)
class Header:
    """Cells of the line of names and of the line of units; both may be empty or too short.

    first_line: line number of the first row, good or bad.
    """

    first_line: int
    names: Sequence[str] = ()
    units: Sequence[str] = ()


def find_header(lines: Lines, kinds: Sequence[str], text: Sequence[str]) -> Header:
    """Find the header above the first row. kinds: of the columns.   text: all lines."""
    plain, n_values = lines.plain, sum(kind != "text" for kind in kinds)

    def is_row(line: Line) -> bool:
        if len(line.cells) != lines.width or not line.n_values:
            return False
        pairs = zip(line.kinds, kinds, strict=True)
        return all(kind in (usual, "missing") or usual == "text" for kind, usual in pairs)

    def is_names(line: Line) -> bool:
        surplus = len(line.cells) - lines.width
        fits = not surplus or (surplus == 1 and not line.cells[-1]) or (surplus == -1 and trailing)
        return fits and 2 * line.n_values <= n_values

    start = next((i for i, line in enumerate(plain) if is_row(line)), 0)
    trailing = all(
        row.kinds[-1] == "missing" for row in lines.rows if row.number >= plain[start].number
    )
    # bad rows may come before the first good one
    bad = [
        *takewhile(lambda line: _is_rather_row(line) and not is_names(line), plain[:start][::-1])
    ]
    rows, above = plain[start - len(bad) : start + 1], plain[: start - len(bad)]
    if names := [*takewhile(is_names, reversed(above))]:
        return _header(rows[0].number, names, lines.delimiter)
    last = rows[-1].number
    commented = [line for line in reversed(lines.commented) if line.number < last]
    if names := [line for line in commented if is_names(line)]:
        below = next(row.number for row in rows if row.number > names[0].number)
        return _header(below, names, lines.delimiter)
    if lines.delimiter == BLANKS and above:
        # names that contain single blanks
        spread = re.split(r"\s{2,}|\t", text[above[-1].number - 1].strip())
        if len(spread) == lines.width:
            return Header(rows[0].number, spread)
    return Header(rows[0].number)


def _is_rather_row(line: Line) -> bool:
    return 2 * line.n_values > sum(kind != "missing" for kind in line.kinds)


def _header(first_line: int, above: Sequence[Line], delimiter: str) -> Header:
    """The header from lines that can be names, the nearest first."""
    signs = ",;" if delimiter == BLANKS else ""
    nearest = [[cell.strip(signs) if signs else cell for cell in line.cells] for line in above[:2]]
    if len(nearest) > 1 and are_units(nearest[0]):
        return Header(first_line, nearest[1], nearest[0])
    return Header(first_line, nearest[0])


def printable_names(names: Sequence[str], width: int) -> tuple[str, ...]:
    """`width` printable names; a column without a name is called by its number."""
    shown = ["".join(c for c in name if c.isprintable()).strip() for name in names[:width]]
    padded = [printable(name, LONGEST_NAME) for name in shown] + [""] * (width - len(shown))
    return tuple(name or f"column_{i}" for i, name in enumerate(padded, 1))
