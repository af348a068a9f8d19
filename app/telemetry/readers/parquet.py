"""Read Parquet in batches: one table; a signal is a column of numbers or times."""

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow.parquet import ParquetFile

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.signal_tables import (
    BLOCK,
    DESCRIPTION_NAMES,
    UNIT_NAMES,
    Column,
    Pieces,
    SignalTable,
    is_time_name,
    library_errors,
    write_tables,
)
from app.telemetry.readers.text_times import SECOND, ElapsedTime, form_of
from core.types import Array

BATCH_ROWS = 1 << 16
BUFFER = 1 << 18
"""Buffer of one column, instead of its whole part of a row group [bytes]."""
PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
UTC = "1970-01-01T00:00:00Z"
"""A time with a zone, as an example for the clock."""


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a Parquet file; timestamps become seconds from the first one."""
    with (
        library_errors("Parquet"),
        ParquetFile(path, buffer_size=BUFFER, pre_buffer=False) as file,
    ):
        clock, ignored = ElapsedTime(form_of([UTC])), list[str]()
        columns = _columns(file.schema_arrow, ignored)
        names = [column.name for column in columns]

        def pieces() -> Pieces:
            rows = max(1, min(BATCH_ROWS, 4 * BLOCK // len(names)))
            for batch in file.iter_batches(rows, columns=names, use_threads=False):
                for number, name in enumerate(names):
                    yield number, numbers(batch.column(name), clock)

        table = SignalTable((), tuple(columns), file.metadata.num_rows, pieces)
        write_tables([table], writer, ignored)
        kinds = [file.schema_arrow.field(column.name).type for column in columns if column.time]
        start = clock.start() if any(map(is_moment, kinds)) else ""
        return writer.finish("parquet", start=start, ignored=ignored)


def _columns(schema: pa.Schema, ignored: list[str]) -> list[Column]:
    """The columns to read; reasons for the others are added to `ignored`."""
    count, fields = Counter(schema.names), list[pa.Field]()
    for field in schema:
        repeated = "several columns have this name" if count[field.name] > 1 else ""
        if reason := repeated or not_numbers(field.type):
            ignored.append(f"{field.name}: {reason}")
        else:
            fields.append(field)
    of_table, time = units_of_table(schema), _time(schema, fields)
    columns = []
    for field in fields:
        timed = is_moment(field.type) or is_span(field.type)
        unit = "s" if timed else _metadata(field, UNIT_NAMES) or of_table.get(field.name, "")
        description = _metadata(field, DESCRIPTION_NAMES)
        columns.append(Column(field.name, unit, description, field.name == time))
    return columns


def _time(schema: pa.Schema, fields: list[pa.Field]) -> str:
    """The time column by name or type, pandas' index first; "" for none."""
    moments = [field.name for field in fields if is_moment(field.type)]
    spans = [field.name for field in fields if is_span(field.type)]
    likely = [*(f.name for f in fields if is_time_name(f.name)), *moments, *spans]
    index = _json(schema, b"pandas").get("index_columns")
    first = [n for n in index if n in likely] if isinstance(index, list) else []
    return next(iter([*first, *likely]), "")


def not_numbers(kind: pa.DataType) -> str:
    """Why a column of a type is not a signal, "" if it is."""
    if pa.types.is_dictionary(kind):
        return not_numbers(kind.value_type)
    if pa.types.is_nested(kind):
        return "nested"
    if pa.types.is_null(kind):
        return "no value"
    if pa.types.is_date(kind):
        return "dates"
    return "" if pa.types.is_primitive(kind) or pa.types.is_decimal(kind) else "text"


def is_moment(kind: pa.DataType) -> bool:
    return pa.types.is_timestamp(kind)


def is_span(kind: pa.DataType) -> bool:
    """Whether values are durations, or times of day."""
    return pa.types.is_duration(kind) or pa.types.is_time(kind)


def numbers(column: pa.Array, clock: ElapsedTime) -> Array:
    """Values as floating-point numbers, NaN if missing; timestamps as seconds of the clock."""
    if pa.types.is_dictionary(column.type):
        column = column.dictionary_decode()
    kind = column.type
    if not (is_moment(kind) or is_span(kind)):
        return column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    known = column.is_valid().to_numpy(zero_copy_only=False)
    integers = column.cast(pa.int32()) if pa.types.is_time32(kind) else column
    counts = integers.cast(pa.int64()).fill_null(0).to_numpy(zero_copy_only=False)
    if is_span(kind):
        return np.where(known, counts / PER_SECOND[kind.unit], np.nan)
    if clock.origin is None and kind.tz is not None:
        clock.example = UTC
    return clock.seconds((counts * (SECOND // PER_SECOND[kind.unit]), known))


def units_of_table(schema: pa.Schema) -> dict[str, str]:
    """Units by column name from the metadata of the table, such as pandas' attrs.

    Either {"units": {name: unit}} or {name: {"unit": unit}}.
    """
    inner = _json(schema, b"pandas").get("attributes")
    attributes = (inner if isinstance(inner, dict) else {}) | _json(schema, b"PANDAS_ATTRS")
    by_name: dict[str, str] = {}
    for name, value in attributes.items():
        if name in UNIT_NAMES and isinstance(value, Mapping):
            by_name |= {str(k): v for k, v in value.items() if isinstance(v, str)}
        elif isinstance(value, Mapping):
            units = [value[key] for key in UNIT_NAMES if isinstance(value.get(key), str)]
            by_name |= {name: units[0]} if units else {}
    return by_name


def _metadata(field: pa.Field, keys: tuple[str, ...]) -> str:
    """The first of the named texts in the metadata of a column."""
    values = ((field.metadata or {}).get(key.encode(), b"") for key in keys)
    return next((value.decode("utf-8", "replace").strip() for value in values if value), "")


def _json(schema: pa.Schema, key: bytes) -> dict[str, Any]:
    """A JSON object in the metadata of a table; empty if missing."""
    try:
        plain = json.loads((schema.metadata or {}).get(key, b"{}"))
    except (ValueError, RecursionError):
        return {}
    return plain if isinstance(plain, dict) else {}
