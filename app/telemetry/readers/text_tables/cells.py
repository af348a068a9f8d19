"""What the cells of a text table say: a number, nothing, a time, or words."""

import csv
import re
from math import isfinite, nan

from app.telemetry.readers.text_tables.time_forms import is_time

MISSING_WORDS = (
    "", "-", "--", "---", "?", "NA", "N/A", "#N/A", "NaN", "-NaN", "+NaN", "NULL", "None", "NIL",
    "NaT", "missing", "inf", "+inf", "-inf", "infinity", "-infinity", "#NUM!", "#DIV/0!", "#VALUE!",
    "1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND", "1.#INF", "-1.#INF",
)  # fmt: skip
MISSING = frozenset(
    spelled for word in MISSING_WORDS for spelled in (word, word.lower(), word.upper())
) | {"*" * n for n in range(1, 33)}
"""Cells that say that nothing was recorded; stars are Fortran's for a number that does not fit."""
BLANKS = " "
"""The delimiter of a table whose cells are parted by runs of blanks and tabs."""
DELIMITERS = ("\t", ";", ",", "|", BLANKS)
COMMENT = re.compile(r"\s*(?:#|%|//|!)+")
COMMENT_OR_SEMICOLON = re.compile(r"\s*(?:#|%|//|!|;)+")
EXPONENT = str.maketrans("dD", "eE")
"""Fortran writes 1.5D+03."""


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of one line, without blanks around them. csv.Error for quotes that do not match."""
    if delimiter == BLANKS:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    row = next(
        csv.reader([line.strip(" ")], delimiter=delimiter, skipinitialspace=True, strict=True)
    )
    return [cell.strip() for cell in row]


def comment(delimiter: str) -> re.Pattern[str]:
    """What a comment begins with; a semicolon only where it does not part cells."""
    return COMMENT if delimiter == ";" else COMMENT_OR_SEMICOLON


def number(cell: str, decimal: str) -> float | None:
    """The number in a cell, NaN where nothing was recorded, None where it is something else."""
    try:
        value = float(cell if decimal == "." else _with_point(cell))
    except ValueError:
        if cell in MISSING:
            return nan
        swapped = cell.translate(EXPONENT)
        return number(swapped, decimal) if swapped != cell else None
    if "_" in cell or not cell.isascii():
        return None  # Python's own spellings
    return value if isfinite(value) else nan


def kind(cell: str, decimal: str) -> str:
    """One of "missing", "number", "time", "text"."""
    if cell in MISSING:
        return "missing"
    if number(cell, decimal) is not None:
        return "number"
    return "time" if is_time(cell) else "text"


def _with_point(cell: str) -> str:
    if "." in cell:
        raise ValueError(cell)
    return cell.replace(",", ".")
