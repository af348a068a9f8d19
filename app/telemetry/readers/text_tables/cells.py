"""The cells of a text table: number, missing, time or text."""

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
"""Cells without a value; Fortran writes stars for a number that does not fit."""
BLANKS = " "
"""Delimiter of a table with runs of blanks and tabs between cells."""
DELIMITERS = ("\t", ";", ",", "|", BLANKS)
COMMENT = re.compile(r"\s*(?:#|%|//|!)+")
COMMENT_OR_SEMICOLON = re.compile(r"\s*(?:#|%|//|!|;)+")
EXPONENT = str.maketrans("dD", "eE")
"""Fortran writes 1.5D+03."""


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of one line, stripped of blanks. csv.Error for unmatched quotes."""
    if delimiter == BLANKS:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    row = next(
        csv.reader([line.strip(" ")], delimiter=delimiter, skipinitialspace=True, strict=True)
    )
    return [cell.strip() for cell in row]


def comment(delimiter: str) -> re.Pattern[str]:
    """Pattern for the start of a comment; a semicolon counts unless it is the delimiter."""
    return COMMENT if delimiter == ";" else COMMENT_OR_SEMICOLON


def number(cell: str, decimal: str) -> float | None:
    """The number in a cell, NaN if missing, None if the cell is something else."""
    try:
        value = float(cell if decimal == "." else _with_point(cell))
    except ValueError:
        if cell in MISSING:
            return nan
        swapped = cell.translate(EXPONENT)
        return number(swapped, decimal) if swapped != cell else None
    if "_" in cell or not cell.isascii():
        return None  # spellings that only Python accepts
    return value if isfinite(value) else nan


def kind(cell: str, decimal: str) -> str:
    if cell in MISSING:
        return "missing"
    if number(cell, decimal) is not None:
        return "number"
    return "time" if is_time(cell) else "text"


def _with_point(cell: str) -> str:
    if "." in cell:
        raise ValueError(cell)
    return cell.replace(",", ".")
