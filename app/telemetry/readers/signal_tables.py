"""Write the tables and arrays that a file declares as groups of signals that share their times.

A reader first collects unread tables with known lengths, so a file that declares too much is
refused before any of it is read.
"""

import errno
import io
import re
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from app.telemetry.contents import ColumnWriter
from app.telemetry.recording import TelemetryError
from app.telemetry.scaling import AS_RECORDED, Scaling
from app.telemetry.units import unit_in

BLOCK = 1 << 20
"""Numbers that are read at once."""
MOST_COLUMNS = 256
"""Widest matrix of signals; a wider one is an image or a map."""
TIME_NAMES = frozenset(
    {"t", "t_s", "time", "time_s", "times", "timestamp", "timestamps", "tout", "seconds"}
)
UNIT_NAMES = ("unit", "units", "Unit", "Units", "UNIT", "UNITS")
DESCRIPTION_NAMES = ("description", "long_name", "label", "comment")
"""Attributes and fields that describe a signal."""

Clock = tuple[str, ...] | None
Pieces = Iterator[tuple[int, npt.ArrayLike]]
Place = tuple[tuple[str, ...], int]
"""Path and length of a table; tables of one place are a group."""


@dataclass(frozen=True)
class Column:
    """A future signal. time: whether the file declares it as the time of the others.

    rate: declared sample rate [Hz], 0 if unknown; the first sample is at `start` [s].
    scaling: of raw counts.   n_bits: of raw words, 0 if unknown.
    """

    name: str
    unit: str = ""
    description: str = ""
    time: bool = False
    rate: float = 0.0
    start: float = 0.0
    scaling: Scaling = AS_RECORDED
    n_bits: int = 0


@dataclass(frozen=True, eq=False)
class SignalTable:
    """Columns of equal length that are read together.

    within: groups or structures that contain them, outermost first.
    pieces: reads (number of column, values); the pieces of a column are in order.
    clock: declared common clock. Without one, tables in the same place with the same length share
    their times.
    """

    within: tuple[str, ...]
    columns: tuple[Column, ...]
    n_rows: int
    pieces: Callable[[], Pieces]
    clock: Clock = None


def is_time_name(name: str) -> bool:
    """Whether a signal with this name is the time of its neighbours."""
    return re.split(r"[\[({<]", name)[0].strip().lower() in TIME_NAMES


def write_tables(
    tables: Sequence[SignalTable],
    writer: ColumnWriter,
    ignored: list[str],
    separator: str = "/",
) -> None:
    """Write the tables of a file as groups of signals; single values are added to `ignored`.

    TelemetryError if nothing is left, or if the file declares too much.
    """
    ignored += [
        f"{column.name}: {'one value' if table.n_rows else 'no value'}"
        for table in tables
        if table.n_rows < 2
        for column in table.columns
    ]
    series = [table for table in tables if table.n_rows > 1]
    if not any(table.columns for table in series):
        raise TelemetryError(_nothing(ignored))
    _check_size(series, writer)
    with_times = [s for s in series if any(column.time for column in s.columns)]
    timed = {(s.within, s.n_rows) for s in with_times if s.clock is None}
    clocked = {(s.clock, s.n_rows) for s in with_times if s.clock is not None}
    groups: dict[Place, list[SignalTable]] = {}
    for table in series:
        place = _place(table, timed)
        first = table.columns[0]
        if place not in timed | clocked and first.rate:
            start = f" from {first.start:g} s" if first.start else ""
            place = (f"{first.rate:g} Hz{start}",), table.n_rows
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
    """Start a group and its signals; the first time among them is its time."""
    rates = {(column.rate, column.start) for table in members for column in table.columns}
    rate, start = rates.pop() if len(rates) == 1 else (0.0, 0.0)
    group = writer.add_group(name, rate=rate, start=start)
    time = next((c for table in members for c in table.columns if c.time), None)
    return [
        (
            table,
            [
                writer.add_signal(
                    group,
                    c.name,
                    c.unit or unit_in(c.name),
                    c.description,
                    time=c is time,
                    scaling=c.scaling,
                    n_bits=c.n_bits,
                )
                for c in table.columns
            ],
        )
        for table in members
    ]


def _check_size(series: Sequence[SignalTable], writer: ColumnWriter) -> None:
    """TelemetryError if a file declares more numbers than may be written."""
    n_bytes = 8 * sum(len(table.columns) * table.n_rows for table in series)
    if n_bytes > writer.most_bytes:
        raise TelemetryError(
            f"the file declares {n_bytes / 2**20:.0f} MiB of numbers, more than the limit of "
            f"{writer.most_bytes / 2**20:.0f} MiB for its size: export only the time range and "
            "signals of this test"
        )


def _nothing(ignored: Sequence[str]) -> str:
    """Message for a file without signals, with its contents."""
    instead = f" ({'; '.join(ignored[:3])}{'; ...' if len(ignored) > 3 else ''})" if ignored else ""
    return (
        f"the file has no numeric signals{instead}: export the signals of the test with "
        "their times as plain tables or vectors"
    )


def _place(table: SignalTable, timed: set[Place]) -> Place:
    """Group of a table: its clock, else the nearest outer place with a time of equal length."""
    if table.clock is not None:
        return table.clock, table.n_rows
    for depth in range(len(table.within), -1, -1):
        if (table.within[:depth], table.n_rows) in timed:
            return table.within[:depth], table.n_rows
    return table.within, table.n_rows


def _names(places: list[Place], separator: str) -> list[str]:
    """Name of each group: its place, with its length if two have the same place."""
    plain = [separator.join(path) for path, _ in places]
    return [
        name if plain.count(name) == 1 else f"{name} ({n} rows)".strip()
        for name, (_, n) in zip(plain, places, strict=True)
    ]


RATES = ("frequency", "sample_rate", "sampling_rate", "sampling_frequency")
STARTS = ("supf_offset",)
"""Time of the first sample in the superframe of a flight data recorder [s]."""
USUAL_HZ = (0.1, 5e4)
"""A frequency outside this range belongs to a radio."""


def declared_rate(attribute: Callable[[str], Any]) -> tuple[float, float]:
    """Rate [Hz] and time of the first sample [s]; (0, 0) without such attributes."""
    rate = next((value for name in RATES if (value := _number(attribute(name)))), 0.0)
    if not USUAL_HZ[0] <= rate <= USUAL_HZ[1]:
        return 0.0, 0.0
    return rate, next((value for name in STARTS if (value := _number(attribute(name)))), 0.0)


def _number(value: Any) -> float:
    """A finite number, otherwise 0."""
    values = np.asarray(0.0 if value is None else value).reshape(-1)
    if len(values) != 1 or values.dtype.kind not in "iuf" or not np.isfinite(values[0]):
        return 0.0
    return float(values[0])


NO_ROOM = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
LONGEST_REASON = 120


@contextmanager
def library_errors(title: str) -> Iterator[None]:
    """Turn any error of a library into one TelemetryError. title: kind of file.

    Output and warnings are dropped. A missing library and a full disk are not faults of the file;
    their errors pass unchanged.
    """
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    except (TelemetryError, ImportError):
        raise
    except MemoryError as error:
        raise TelemetryError(
            f"reading this {title} file needs more memory than available: export only the time "
            "range and signals of this test"
        ) from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            raise
        raise TelemetryError(
            f"the {title} file is damaged or cut short ({_reason(error)}): copy or export it again"
        ) from error


def _reason(error: Exception) -> str:
    """First line of the library's message, otherwise the type of the error."""
    message = str(error).strip()
    line = message.splitlines()[0].rstrip(".: ") if message else ""
    printable = "".join(letter if letter.isprintable() else "?" for letter in line)
    return printable[:LONGEST_REASON] or type(error).__name__


# --- arrays of one or two dimensions: find the axis of samples, read in parts ---------------------

Index = tuple[slice | int, ...]
Take = Callable[[Any], npt.NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Matrix:
    """An array of numbers that is not yet read, without its dimensions of length one.

    shape: zero to two dimensions.   take: reads the part at an index.
    chunks: shape of the parts that must be read whole, None if there are none.
    clocks: what each axis counts according to the format, None if unknown.
    rows: axis of the samples, if nothing else decides.
    """

    within: tuple[str, ...]
    column: Column
    shape: tuple[int, ...]
    take: Take
    chunks: tuple[int, ...] | None = None
    clocks: tuple[Clock, ...] = (None, None)
    rows: int = 0

    @property
    def is_time(self) -> bool:
        """Whether these can be the times of other arrays."""
        return self.column.time and len(self.shape) == 1


def matrix(
    within: tuple[str, ...],
    column: Column,
    shape: tuple[int, ...],
    take: Take,
    *,
    chunks: tuple[int, ...] | None = None,
    clocks: tuple[Clock, ...] | None = None,
    reverse: bool = False,
) -> Matrix | str:
    """Make a Matrix of an array of any shape, or return why it cannot be one.

    reverse: whether dimensions are stored last first, as in MATLAB.
    """
    axes = [k for k, n in enumerate(shape) if n != 1]
    long = tuple(shape[k] for k in axes)
    if len(long) > 2:
        return f"{column.name}: {len(long)} dimensions"
    if len(long) == 2 and min(long) > MOST_COLUMNS:
        return f"{column.name}: {long[0]} by {long[1]} numbers, too wide for a set of signals"

    def part(index: Index) -> npt.NDArray[Any]:
        at = dict(zip(axes, index, strict=True))
        return take(tuple(at.get(k, 0) for k in range(len(shape))))

    return Matrix(
        within,
        column,
        long,
        part,
        chunks and tuple(chunks[k] for k in axes),
        tuple(clocks[k] for k in axes) if clocks else (None, None),
        int(reverse),
    )


def to_tables(matrices: Collection[Matrix]) -> list[SignalTable]:
    """Make tables of matrices; the times among them decide which axis is time."""
    times = [m for m in matrices if m.is_time]
    clocks = {m.clocks[0] for m in times} - {None}
    lengths = {m.shape[0] for m in times}
    return [_to_table(m, _samples_axis(m, clocks, lengths)) for m in matrices]


def _to_table(matrix: Matrix, axis: int) -> SignalTable:
    column, columns = matrix.column, (matrix.column,)
    if not matrix.shape:
        return SignalTable(matrix.within, columns, 1, lambda: iter(()))
    if len(matrix.shape) == 2:
        columns = tuple(
            Column(f"{column.name}[{k}]", column.unit, column.description)
            for k in range(matrix.shape[1 - axis])
        )
    pieces = partial(_pieces, matrix, axis)
    return SignalTable(matrix.within, columns, matrix.shape[axis], pieces, matrix.clocks[axis])


def _samples_axis(matrix: Matrix, clocks: Collection[Clock], lengths: Collection[int]) -> int:
    """Axis of the samples: by a declared time, by its length, otherwise the longer one."""
    if len(matrix.shape) < 2:
        return 0
    first, second = matrix.shape
    possible = [axis for axis, n_columns in ((0, second), (1, first)) if n_columns <= MOST_COLUMNS]
    for fitting in (
        [axis for axis in possible if matrix.clocks[axis] in clocks],
        [axis for axis in possible if matrix.shape[axis] in lengths],
    ):
        if len(fitting) == 1:
            return fitting[0]
    return matrix.rows if first == second else int(second > first)


def _pieces(matrix: Matrix, axis: int) -> Pieces:
    """Read in parts of about a BLOCK of numbers, whole chunks at a time."""
    n_rows = matrix.shape[axis]
    if len(matrix.shape) == 1:
        for rows in _spans(n_rows, _whole(BLOCK, matrix.chunks[0] if matrix.chunks else 1)):
            yield 0, matrix.take((rows,))
        return
    n_columns = matrix.shape[1 - axis]
    chunk, wide = (matrix.chunks[axis], matrix.chunks[1 - axis]) if matrix.chunks else (1, BLOCK)
    for columns in _spans(n_columns, wide):
        for rows in _spans(n_rows, _whole(BLOCK // min(wide, n_columns), chunk)):
            block = matrix.take((columns, rows) if axis else (rows, columns))
            for k, values in enumerate(block if axis else block.T):
                yield columns.start + k, values


def _whole(n: int, chunk: int) -> int:
    """Largest multiple of `chunk` up to n, at least one chunk."""
    return max(n // chunk, 1) * chunk


def _spans(n: int, step: int) -> Iterator[slice]:
    return (slice(first, min(first + step, n)) for first in range(0, n, step))
