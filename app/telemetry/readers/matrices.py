"""Arrays of one or two dimensions: find the axis of samples and read in parts."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy.typing as npt

from app.telemetry.readers.signal_tables import (
    BLOCK,
    MOST_COLUMNS,
    Clock,
    Column,
    Pieces,
    SignalTable,
)

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
