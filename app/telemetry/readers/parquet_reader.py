"""Recordings in Parquet: one table, read by batches; a signal is a column of numbers or times."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.library_errors import library_errors
from app.telemetry.readers.sources import BLOCK, Column, Pieces, Source, is_time_name, listed, pour

if TYPE_CHECKING:
    import pyarrow as pa

TITLE = "Parquet"
BATCH_ROWS = 1 << 16
BUFFER = 1 << 18
"""Of one column, instead of its whole part of a row group [bytes]."""


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a Parquet file; its timestamps become seconds from the first of them."""
    with library_errors(TITLE):
        from pyarrow.parquet import ParquetFile

        from app.telemetry.readers.arrow_numbers import Moments

        with ParquetFile(path, buffer_size=BUFFER, pre_buffer=False) as file:
            schema, moments = file.schema_arrow, Moments()
            ignored, names = _chosen(schema)

            def pieces() -> Pieces:
                rows = max(1, min(BATCH_ROWS, 4 * BLOCK // len(names)))
                for batch in file.iter_batches(rows, columns=names, use_threads=False):
                    for number, name in enumerate(names):
                        yield number, moments.numbers(batch.column(name))

            columns = _columns(schema, names)
            pour(path, [Source((), columns, file.metadata.num_rows, pieces)], writer, ignored)
            return writer.finish("parquet", start=moments.start, ignored=listed(ignored))


def _chosen(schema: "pa.Schema") -> tuple[list[str], list[str]]:
    """What is ignored with the reason, and the names of the columns that are read."""
    from app.telemetry.readers.arrow_numbers import not_numbers

    ignored, chosen, count = [], [], Counter(schema.names)
    for name, kind in zip(schema.names, schema.types, strict=True):
        twice = "a name that another column has too" if count[name] > 1 else ""
        if reason := twice or not_numbers(kind):
            ignored.append(f"{name}: {reason}")
        else:
            chosen.append(name)
    return ignored, chosen


def _columns(schema: "pa.Schema", names: Sequence[str]) -> tuple[Column, ...]:
    from app.telemetry.readers.arrow_numbers import is_moment, is_span
    from app.telemetry.readers.parquet_units import description_of, unit_of, units_of_table

    of_table, time = units_of_table(schema), _time(schema, names)
    columns = []
    for name in names:
        field = schema.field(name)
        timed = is_moment(field.type) or is_span(field.type)
        unit = "s" if timed else unit_of(field) or of_table.get(name, "")
        columns.append(Column(name, unit, description_of(field), name == time))
    return tuple(columns)


def _time(schema: "pa.Schema", names: Sequence[str]) -> str:
    """The column that is the time by its name or type: pandas' index first; "" for none."""
    from app.telemetry.readers.arrow_numbers import is_moment, is_span
    from app.telemetry.readers.parquet_units import index_of_table

    moments = [name for name in names if is_moment(schema.field(name).type)]
    spans = [name for name in names if is_span(schema.field(name).type)]
    index = [n for n in index_of_table(schema) if n in moments or n in spans or is_time_name(n)]
    named = [name for name in names if is_time_name(name)]
    return next(iter([*(n for n in index if n in names), *named, *moments, *spans]), "")
