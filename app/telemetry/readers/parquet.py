"""Read Parquet in batches: one table; a signal is a column of numbers or times."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.readers.signal_tables import (
    BLOCK,
    DESCRIPTION_NAMES,
    Column,
    Pieces,
    SignalTable,
    is_time_name,
    library_errors,
    write_tables,
)  # fmt: skip
from core.types import Array

TITLE = "Parquet"
BATCH_ROWS = 1 << 16
BUFFER = 1 << 18
"""Buffer of one column, instead of its whole part of a row group [bytes]."""


def read(path: Path, writer: ColumnWriter) -> Contents:
    """Read a Parquet file; timestamps become seconds from the first one."""
    with library_errors(TITLE):
        from pyarrow.parquet import ParquetFile

        with ParquetFile(path, buffer_size=BUFFER, pre_buffer=False) as file:
            schema, moments = file.schema_arrow, Moments()
            ignored, names = _chosen(schema)

            def pieces() -> Pieces:
                rows = max(1, min(BATCH_ROWS, 4 * BLOCK // len(names)))
                for batch in file.iter_batches(rows, columns=names, use_threads=False):
                    for number, name in enumerate(names):
                        yield number, moments.numbers(batch.column(name))

            columns = _columns(schema, names)
            write_tables(
                [SignalTable((), columns, file.metadata.num_rows, pieces)], writer, ignored
            )
            return writer.finish("parquet", start=moments.start, ignored=ignored)


def _chosen(schema: pa.Schema) -> tuple[list[str], list[str]]:
    """Ignored columns with reasons, and the names of the columns to read."""
    ignored, chosen, count = [], [], Counter(schema.names)
    for name, kind in zip(schema.names, schema.types, strict=True):
        repeated = "several columns have this name" if count[name] > 1 else ""
        if reason := repeated or not_numbers(kind):
            ignored.append(f"{name}: {reason}")
        else:
            chosen.append(name)
    return ignored, chosen


def _columns(schema: pa.Schema, names: Sequence[str]) -> tuple[Column, ...]:
    of_table, time = units_of_table(schema), _time(schema, names)
    columns = []
    for name in names:
        field = schema.field(name)
        timed = is_moment(field.type) or is_span(field.type)
        unit = "s" if timed else unit_of(field) or of_table.get(name, "")
        columns.append(Column(name, unit, description_of(field), name == time))
    return tuple(columns)


def _time(schema: pa.Schema, names: Sequence[str]) -> str:
    """The time column by name or type, pandas' index first; "" for none."""
    moments = [name for name in names if is_moment(schema.field(name).type)]
    spans = [name for name in names if is_span(schema.field(name).type)]
    index = [n for n in index_of_table(schema) if n in moments or n in spans or is_time_name(n)]
    named = [name for name in names if is_time_name(name)]
    return next(iter([*(n for n in index if n in names), *named, *moments, *spans]), "")


PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
NANOSECONDS = 10**9


def not_numbers(kind: pa.DataType) -> str:
    """Why a column of a type is not a signal, "" if it is."""
    if pa.types.is_dictionary(kind):
        return not_numbers(kind.value_type)
    if pa.types.is_nested(kind):
        return "nested"
    if pa.types.is_null(kind):
        return "no value"
    if pa.types.is_boolean(kind) or pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return ""
    if pa.types.is_decimal(kind) or is_moment(kind) or is_span(kind):
        return ""
    return "dates" if pa.types.is_date(kind) else "text"


def is_moment(kind: pa.DataType) -> bool:
    return pa.types.is_timestamp(kind)


def is_span(kind: pa.DataType) -> bool:
    """Whether values are durations, or times of day."""
    return pa.types.is_duration(kind) or pa.types.is_time(kind)


@dataclass(eq=False)
class Moments:
    """Timestamps as seconds from the first one in the file. first: [ns since 1970]."""

    first: int | None = None
    zoned: bool = False

    @property
    def start(self) -> str:
        """The first moment in ISO 8601, in UTC if the file gives a zone; "" if there is none."""
        if self.first is None:
            return ""
        text = str(np.datetime64(self.first, "ns"))
        return text.rstrip("0").rstrip(".") + ("Z" if self.zoned else "")

    def numbers(self, column: pa.Array) -> Array:
        """Values as floating-point numbers, NaN if missing."""
        if pa.types.is_dictionary(column.type):
            column = column.dictionary_decode()
        kind = column.type
        if not (is_moment(kind) or is_span(kind)):
            return column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        missing = column.is_null().to_numpy(zero_copy_only=False)
        integers = column.cast(pa.int32()) if pa.types.is_time32(kind) else column
        counts = integers.cast(pa.int64()).fill_null(0).to_numpy(zero_copy_only=False)
        rate = PER_SECOND[kind.unit]
        seconds = (
            self._since_first(counts, missing, kind, rate) if is_moment(kind) else counts / rate
        )
        return np.where(missing, np.nan, seconds)

    def _since_first(
        self, counts: np.ndarray, missing: np.ndarray, kind: pa.TimestampType, rate: int
    ) -> Array:
        """Subtract as integers, because nanoseconds since 1970 exceed a float's precision."""
        if missing.all():
            return np.zeros(len(counts))
        if self.first is None:
            self.first = int(counts[~missing][0]) * (NANOSECONDS // rate)
            self.zoned = kind.tz is not None
        first, rest = divmod(self.first, NANOSECONDS // rate)
        return (counts - first) / rate - rest / NANOSECONDS


KEYS = ("unit", "units", "Unit", "Units", "UNIT", "UNITS")


def unit_of(field: pa.Field) -> str:
    return _metadata_text(field, KEYS)


def description_of(field: pa.Field) -> str:
    return _metadata_text(field, DESCRIPTION_NAMES)


def units_of_table(schema: pa.Schema) -> dict[str, str]:
    """Units by column name from the metadata of the table, such as pandas' attrs.

    Either {"units": {name: unit}} or {name: {"unit": unit}}.
    """
    attributes = _attributes(schema)
    by_name: dict[str, str] = {}
    for name, value in attributes.items():
        if name in KEYS and isinstance(value, Mapping):
            by_name |= {str(k): v for k, v in value.items() if isinstance(v, str)}
        elif isinstance(value, Mapping):
            units = [value[key] for key in KEYS if isinstance(value.get(key), str)]
            by_name |= {name: units[0]} if units else {}
    return by_name


def index_of_table(schema: pa.Schema) -> tuple[str, ...]:
    """Names of the columns that were pandas' index."""
    index = _json(schema, b"pandas").get("index_columns")
    return tuple(name for name in index if isinstance(name, str)) if isinstance(index, list) else ()


def _metadata_text(field: pa.Field, keys: tuple[str, ...]) -> str:
    metadata = field.metadata or {}
    values = (metadata.get(key.encode(), b"") for key in keys)
    return next((value.decode("utf-8", "replace").strip() for value in values if value), "")


def _attributes(schema: pa.Schema) -> dict[str, Any]:
    inner = _json(schema, b"pandas").get("attributes")
    return (inner if isinstance(inner, dict) else {}) | _json(schema, b"PANDAS_ATTRS")


def _json(schema: pa.Schema, key: bytes) -> dict[str, Any]:
    """A JSON object in the metadata of a table; empty if missing."""
    try:
        plain = json.loads((schema.metadata or {}).get(key, b"{}"))
    except (ValueError, RecursionError):
        return {}
    return plain if isinstance(plain, dict) else {}
