"""Recordings from text tables: comma, semicolon or tab between cells, channel names on top."""

import csv
from array import array
from collections.abc import Callable, Sequence
from math import inf, isnan, nan
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.telemetry.channel_names import Column, find_columns
from app.telemetry.recording import ATTITUDE, Array, Recording, TelemetryError
from core.channels import KEYS

if TYPE_CHECKING:
    from _csv import Reader

DELIMITERS = ",;\t"


def read(path: Path) -> Recording:
    """The recording in a file, by the ending of its name; every error names the file."""
    try:
        if path.is_dir() or not path.exists():
            what = "is a directory" if path.is_dir() else "does not exist"
            raise TelemetryError(f"this {what}; give the path of a recorded telemetry file")
        ending = path.suffix.lower().removeprefix(".")
        if ending not in FORMATS:
            raise TelemetryError(
                f"no reader for the ending '{ending}'; export the recording as one of: "
                + ", ".join(FORMATS)
            )
        return FORMATS[ending](path)
    except TelemetryError as error:
        raise TelemetryError(f"{path}: {error}") from None


def read_csv(path: Path) -> Recording:
    """A table with one header line of `channel_unit` names and one row a sample.

    An empty cell, `nan` or `inf` is a missing value and becomes NaN. Time must be present and
    increase from row to row. Raises TelemetryError, with the line number of the first bad row.
    """
    lines = _lines(path)
    first = next((line for line in lines if line.strip()), "")
    if not first:
        raise TelemetryError("the file is empty; needed are a header line and rows of samples")
    if not first.strip().replace("\t", " ").isprintable():
        raise TelemetryError("the first line is not text; save the recording as a UTF-8 CSV file")
    delimiter = max(DELIMITERS, key=first.count)
    rows = csv.reader(lines, delimiter=delimiter, skipinitialspace=True, strict=True)
    try:
        header = next((row for row in rows if not _blank(row)), [""])
        if all(map(_is_number, header)):
            raise TelemetryError(
                "the first line holds numbers; put a line of channel names such as t_s, beta_rad, "
                "p_radps above it"
            )
        columns = find_columns(header)
        table = _table(rows, len(header), list(columns.values()))
    except csv.Error as error:
        raise TelemetryError(
            f"line {rows.line_num}: {error}; check the quotes there and save the file again"
        ) from None
    return _recording(columns, table)


def _lines(path: Path) -> list[str]:
    """The file's lines, whichever of the three line ends it has."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise TelemetryError(
            f"the file cannot be read ({error.strerror}); give one that you may read"
        ) from None
    if b"\0" in content:
        raise TelemetryError(
            f"byte {content.index(0)} is zero, so this is not UTF-8 text; save the recording as a "
            "UTF-8 CSV file"
        )
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise TelemetryError(
            f"byte {error.start} is not UTF-8 text; save the recording as a UTF-8 CSV file"
        ) from None
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _table(rows: "Reader", width: int, columns: list[Column]) -> Array:
    """The wanted columns (n, len(columns)) in their own units, time first; NaN where missing."""
    pick = itemgetter(*(column.index for column in columns))
    values, t_before = array("d"), -inf
    for row in rows:
        if len(row) != width:
            if _blank(row):
                continue
            raise TelemetryError(
                f"line {rows.line_num} has {len(row)} cells where the header has {width}; give "
                "every row one cell a column, empty where nothing was recorded"
            )
        sample = _numbers(pick(row), columns, rows.line_num)
        t = sample[0]
        if not t_before < t < inf:
            raise TelemetryError(_bad_time(rows.line_num, columns[0].name, t_before, t))
        t_before = t
        values.fromlist(sample)
    table = np.array(values).reshape(-1, len(columns))
    if len(table) < 2:
        raise TelemetryError(
            f"samples below the header: {len(table)}; give a recording of at least two"
        )
    return table


def _numbers(cells: Sequence[str], columns: list[Column], line: int) -> list[float]:
    """One row's numbers, NaN for an empty cell; Python's own 1_000 is not a measurement."""
    try:
        if "_" not in "".join(cells):
            return list(map(float, cells))
    except ValueError:
        pass
    sample = []
    for cell, column in zip(cells, columns, strict=True):
        if cell.strip() and not _is_number(cell):
            raise TelemetryError(
                f"line {line}, column {column.name}: {cell[:40]!r} is not a number; write numbers "
                "with a decimal point, and leave the cell empty where nothing was recorded"
            )
        sample.append(float(cell) if cell.strip() else nan)
    return sample


def _bad_time(line: int, name: str, before: float, t: float) -> str:
    """Why a row's time cannot follow the one before it."""
    if isnan(t) or t == inf or before == -inf:
        return f"line {line}, column {name}: time is missing; give every row a time or remove it"
    if t == before:
        return f"line {line}, column {name}: time {t:.15g} is repeated; keep one row for each time"
    return (
        f"line {line}, column {name}: time steps back from {before:.15g} to {t:.15g}; sort the "
        "rows, or split the file where the clock was set back"
    )


def _recording(columns: dict[str, Column], table: Array) -> Recording:
    """The table in SI units, with notes; an empty needed channel is an error, attitude is not."""
    signals = {
        key: np.where(np.isfinite(values), values, nan) / columns[key].per_si
        for key, values in zip(columns, table.T, strict=True)
    }
    missing = {key: int(np.isnan(values).sum()) for key, values in signals.items()}
    empty = [key for key, count in missing.items() if count == len(table)]
    if needed := [key for key in KEYS if key in empty]:
        raise TelemetryError(
            f"no number in {', '.join(f'{key} (column {columns[key].name})' for key in needed)}; "
            "the monitor needs every channel, so use a recording where it was measured"
        )
    bare = [column.name for key, column in columns.items() if not column.unit and key != "t"]
    notes = [
        f"{key} is missing in {missing[key]} of {len(table)} samples."
        for key in KEYS
        if missing[key]
    ]
    if bare:
        notes.insert(0, f"Without a unit in the name, read as SI (N_y in g): {', '.join(bare)}.")
    return Recording(
        t=signals["t"],
        y=np.column_stack([signals[key] for key in KEYS]),
        attitude={key: signals[key] for key in ATTITUDE if key in signals and key not in empty},
        columns={key: column.name for key, column in columns.items() if key not in empty},
        notes=tuple(notes),
    )


def _blank(row: list[str]) -> bool:
    return not any(cell.strip() for cell in row) and len(row) < 2


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


FORMATS: dict[str, Callable[[Path], Recording]] = {"csv": read_csv, "tsv": read_csv}
