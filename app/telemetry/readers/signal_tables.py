"""From what a file declares to the folder of columns: groups that share their times, then numbers.

A reader first collects tables, which know their lengths and have not been read; so a file that
declares more than may be read is refused before any of it is.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy.typing as npt

from app.telemetry.contents import MOST_LISTED, MOST_SIGNALS, ColumnWriter
from app.telemetry.readers.written_units import unit_in
from app.telemetry.recording import TelemetryError

BLOCK = 1 << 20
"""Numbers that are read at a time."""
MOST_COLUMNS = 256
"""Of one matrix; a wider one is an image or a map, not a set of signals."""
TIME_NAMES = frozenset(
    {"t", "t_s", "time", "time_s", "times", "timestamp", "timestamps", "tout", "seconds"}
)
DESCRIPTION_NAMES = ("description", "long_name", "label", "comment")
"""Attributes and fields that say in words what a signal is."""

Clock = tuple[str, ...] | None
Pieces = Iterator[tuple[int, npt.ArrayLike]]
Place = tuple[tuple[str, ...], int]
"""Where a table lies and how long it is; those of one place are a group."""


@dataclass(frozen=True)
class Column:
    """A signal to be. time: the file says that it is the time of the others.

    rate: at which the file says that it was sampled [Hz], 0 where it says nothing; the first sample
    is at `start` [s].
    """

    name: str
    unit: str = ""
    description: str = ""
    time: bool = False
    rate: float = 0.0
    start: float = 0.0


@dataclass(frozen=True, eq=False)
class SignalTable:
    """Columns of equal length that are read together.

    within: the groups or structures they lie in, outermost first.
    pieces: reads (number of column, values); the pieces of one column come in their order.
    clock: what the format says they share their times with; None where it says nothing, and then
    they share them with what lies in the same place and is as long.
    """

    within: tuple[str, ...]
    columns: tuple[Column, ...]
    n_rows: int
    pieces: Callable[[], Pieces]
    clock: Clock = None


def is_time_name(name: str) -> bool:
    """Whether a signal of this name is the time of those beside it."""
    return re.split(r"[\[({<]", name)[0].strip().lower() in TIME_NAMES


def write_tables(
    tables: Sequence[SignalTable],
    writer: ColumnWriter,
    ignored: list[str],
    separator: str = "/",
) -> None:
    """Write the tables of a file as groups of signals.

    The single values among them are added to `ignored`. TelemetryError where nothing is left, or
    where the file declares too much.
    """
    ignored += [
        f"{column.name}: {'one value' if table.n_rows else 'no value'}"
        for table in tables
        if table.n_rows < 2
        for column in table.columns
    ]
    series = [table for table in tables if table.n_rows > 1]
    if not any(table.columns for table in series):
        raise TelemetryError(nothing(ignored))
    _check_size(series, writer)
    with_times = [s for s in series if any(map(_time, s.columns))]
    timed = {(s.within, s.n_rows) for s in with_times if s.clock is None}
    clocked = {(s.clock, s.n_rows) for s in with_times if s.clock is not None}
    groups: dict[Place, list[SignalTable]] = {}
    for table in series:
        place = _place(table, timed)
        if place not in timed | clocked and table.columns[0].rate:
            place = (_rate_words(table.columns[0]),), table.n_rows
        groups.setdefault(place, []).append(table)
    added = [
        (table, numbers)
        for name, members in zip(_names(list(groups), separator), groups.values(), strict=True)
        for table, numbers in _added(writer, name, members)
    ]
    for table, numbers in added:
        for column, values in table.pieces():
            writer.append(numbers[column], values)


def _added(
    writer: ColumnWriter, name: str, members: list[SignalTable]
) -> list[tuple[SignalTable, list[int]]]:
    """Begin a group and its signals; the first time among them is its time."""
    rates = {(column.rate, column.start) for table in members for column in table.columns}
    rate, start = rates.pop() if len(rates) == 1 else (0.0, 0.0)
    group = writer.add_group(name, rate=rate, start=start)
    time = next((c for table in members for c in table.columns if c.time), None)
    return [
        (
            table,
            [
                writer.add_signal(
                    group, c.name, c.unit or unit_in(c.name), c.description, time=c is time
                )
                for c in table.columns
            ],
        )
        for table in members
    ]


def _check_size(series: Sequence[SignalTable], writer: ColumnWriter) -> None:
    """TelemetryError where a file declares more signals or numbers than may be written."""
    n_signals = sum(len(table.columns) for table in series)
    if n_signals > MOST_SIGNALS:
        raise TelemetryError(
            f"the file has {n_signals} signals, more than {MOST_SIGNALS}: export the ones of this "
            "test"
        )
    n_bytes = 8 * sum(len(table.columns) * table.n_rows for table in series)
    if n_bytes > writer.most_bytes:
        raise TelemetryError(
            f"the file declares {n_bytes / 2**20:.0f} MiB of numbers, more than the "
            f"{writer.most_bytes / 2**20:.0f} MiB that one of its size may unfold to: export the "
            "time range and the signals of this test"
        )


def listed(ignored: Sequence[str]) -> tuple[str, ...]:
    """Keep the first of what was ignored, and count the others."""
    more = len(ignored) - MOST_LISTED
    return (*ignored[:MOST_LISTED], *([f"and {more} more"] if more > 0 else []))


def nothing(ignored: Sequence[str]) -> str:
    """Say that a file holds no signal, and what it holds instead."""
    instead = f" ({'; '.join(ignored[:3])}{'; ...' if len(ignored) > 3 else ''})" if ignored else ""
    return (
        f"nothing in the file is a signal of numbers{instead}: export the signals of the test with "
        "their times as plain tables or vectors"
    )


def _time(column: Column) -> bool:
    return column.time


def _rate_words(column: Column) -> str:
    """What signals that were sampled together at a rate are called."""
    return f"{column.rate:g} Hz" + (f" from {column.start:g} s" if column.start else "")


def _place(table: SignalTable, timed: set[Place]) -> Place:
    """Where a table belongs: its clock, else the nearest place outwards with a time as long."""
    if table.clock is not None:
        return table.clock, table.n_rows
    for depth in range(len(table.within), -1, -1):
        if (table.within[:depth], table.n_rows) in timed:
            return table.within[:depth], table.n_rows
    return table.within, table.n_rows


def _names(places: list[Place], separator: str) -> list[str]:
    """A name for each group: its place, and its length where two have the same place."""
    plain = [separator.join(path) for path, _ in places]
    return [
        name if plain.count(name) == 1 else f"{name} ({n} rows)".strip()
        for name, (_, n) in zip(plain, places, strict=True)
    ]
