"""Small Parquet tables of most types and encodings, and journals of live flights."""

import json
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


def journal(path: Path, mapping: dict[str, Any] | None = None, per_batch: int = 1) -> None:
    """Batches with late, missing and odd values, an event and a torn last line."""
    header = {"format": 1, "flight": "f", "began": "2030-01-01T00:00:00+00:00", "mapping": mapping}
    lines: list[dict[str, Any]] = [header | {"a": 0.0}]
    for k in range(0, N, per_batch):
        t = T[k : k + per_batch].tolist()
        values = {"t": t, "beta": [None if v > 0.3 else 0.1 * v for v in t], "p": [k] * len(t)}
        lines.append({"v": "rest", "s": k, "b": values | {"mode": ["auto"] * len(t)}, "a": t[-1]})
    lines.insert(5, {"e": "manoeuvre", "by": "FTE", "t": 0.06, "a": 0.07})
    path.write_text("\n".join(map(json.dumps, lines)) + '\n{"v": "rest", "b": {"t": [')


MAPPED = {
    "channels": {"beta": {"signal": "beta", "unit": "deg", "sign": 1}},
    "times": {"": {"signal": "t", "unit": "ms"}},
}
TABLES: dict[str, Callable[[Path], object]] = {
    "plain.parquet": lambda path: numbers(path, compression="none", use_dictionary=False),
    "snappy.parquet": lambda path: numbers(path, compression="snappy", data_page_version="2.0"),
    "split.parquet": lambda path: numbers(
        path, use_dictionary=False, use_byte_stream_split=["beta"], compression="zstd"
    ),
    "types.parquet": types,
    "pandas.pq": pandas,
    "live.jsonl": journal,
    "mapped.jsonl": lambda path: journal(path, MAPPED, per_batch=4),
}
