"""Find the layout of a text table: delimiter, first line and kinds of columns."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from app.telemetry.readers.text_tables.header import find_header, printable_names
from app.telemetry.readers.text_tables.lines import MOST_CELLS, Line, best_parted
from app.telemetry.readers.text_tables.time_forms import TimeForm, form_of
from app.telemetry.readers.written_units import unit_in, unit_of_cell
from app.telemetry.recording import TelemetryError

SAMPLE_LINES = 500
"""Lines that are used to find the layout, including those above the table."""


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


def find_layout(head: str) -> Layout:
    """Find the layout from the beginning of a text. TelemetryError if there is no table."""
    text = head.split("\n")[:SAMPLE_LINES]
    lines = best_parted(text)
    width = lines.width
    if not width:
        shown = next((line.strip()[:60] for line in text if line.strip()), "")
        raise TelemetryError(
            f"no row of numbers in the first {len(text)} lines, which start with "
            f"{shown!a}: give a text table with one row per sample"
        )
    if width == MOST_CELLS:
        raise TelemetryError(
            f"rows have {width} cells or more: export only the signals of this test"
        )
    rows = lines.rows
    kinds = [_most_common([row.kinds[i] for row in rows]) for i in range(width)]
    header = find_header(lines, kinds, text)
    rows = [row for row in rows if row.number >= header.first_line]
    names = printable_names(header.names, width)
    units = [unit_of_cell(u) for u in header.units] or [unit_in(name) for name in names]
    columns = [
        _column(names[i], units[i] if i < len(units) else "", kinds[i], i, rows)
        for i in range(width)
    ]
    if width > 1 and not any(header.names[width - 1 :]) and not columns[-1].example:
        columns[-1] = TextColumn(names[-1], "", "text")
    notes = ["Numbers have a decimal comma."] if lines.decimal == "," else []
    if not header.names:
        notes.append(
            f"No line of names above the numbers: columns are called column_1 to column_{width}."
        )
    if repeated := [name for name, count in Counter(names).items() if count > 1]:
        notes.append(f"Repeated names, numbered from the second on: {', '.join(repeated)}.")
    return Layout(lines.delimiter, lines.decimal, tuple(columns), header.first_line, tuple(notes))


def _most_common(kinds: Sequence[str]) -> str:
    """Kind of most cells in a column; a column without content may still get numbers."""
    counts = Counter(kinds)
    return max(("number", "time", "text"), key=lambda kind: counts[kind])


def _column(name: str, unit: str, kind: str, i: int, rows: Sequence[Line]) -> TextColumn:
    of_kind = [row.cells[i] for row in rows if row.kinds[i] == kind]
    example = of_kind[0][:40] if of_kind else ""
    if kind != "time":
        return TextColumn(name, unit, kind, example)
    coarse = len(set(of_kind)) < 0.9 * len(of_kind)
    return TextColumn(name, "s", kind, example, form_of(of_kind), coarse)
