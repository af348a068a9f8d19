"""Small Parquet tables of most types and encodings."""

from collections.abc import Callable
from datetime import UTC, date, datetime, time, timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

N = 24
T = 0.02 * np.arange(N)


def numbers(path: Path, **how: Any) -> None:
    beta = pa.field("beta", pa.float64(), metadata={"unit": "deg"})
    schema = pa.schema([("time [s]", pa.float64()), beta, ("count", pa.int16())])
    table = pa.table(
        [T, [None if k == 7 else 0.1 * k for k in range(N)], [k % 5 for k in range(N)]],
        schema=schema,
    )
    pq.write_table(table, path, row_group_size=10, **how)


def types(path: Path) -> None:
    start = datetime(2024, 5, 1, 9, 30, tzinfo=UTC)
    rows = range(N)
    columns = {
        "when": pa.array([start + timedelta(milliseconds=20 * k) for k in rows]),
        "since": pa.array([timedelta(milliseconds=20 * k) for k in rows], pa.duration("us")),
        "clock": pa.array([time(9, 30, k) for k in rows], pa.time32("s")),
        "day": pa.array([date(2024, 5, 1 + k) for k in rows]),
        "on": pa.array([k % 2 == 0 for k in rows]),
        "p": pa.array([0.5 * k for k in rows], pa.float32()),
        "small": pa.array([k % 3 for k in rows], pa.uint8()),
        "exact": pa.array([Decimal(k) / 4 for k in rows], pa.decimal128(12, 3)),
        "mode": pa.array([("auto", "hand")[k % 2] for k in rows]).dictionary_encode(),
        "list": pa.array([[float(k)] * (k % 3) for k in rows]),
        "inner": pa.array([{"a": k, "b": "x"} for k in rows]),
        "none": pa.nulls(N),
    }
    pq.write_table(pa.table(columns), path, compression="none", write_statistics=True)


def pandas(path: Path) -> None:
    table = pa.table({"t": T, "beta": np.sin(T), "r": np.cos(T)})
    told = {"index_columns": ["t"], "attributes": {"units": {"beta": "deg"}}}
    text = str(told).replace("'", '"')
    pq.write_table(table.replace_schema_metadata({"pandas": text}), path, compression="gzip")


TABLES: dict[str, Callable[[Path], object]] = {
    "plain.parquet": lambda path: numbers(path, compression="none", use_dictionary=False),
    "snappy.parquet": lambda path: numbers(path, compression="snappy", data_page_version="2.0"),
    "split.parquet": lambda path: numbers(
        path, use_dictionary=False, use_byte_stream_split=["beta"], compression="zstd"
    ),
    "types.parquet": types,
    "pandas.pq": pandas,
}
