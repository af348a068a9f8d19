"""Recordings in Parquet, as pandas and pyarrow write them."""

from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from app.telemetry.recording import TelemetryError
from tests.support.recorded_files import read

PYARROWS = Path(pa.__file__).parent / "tests" / "data" / "parquet"


@pytest.fixture
def stored(tmp_path):
    """An Arrow table or a data frame -> columns of a file of it."""

    def _stored(table, most_bytes=1 << 30, **options):
        path = tmp_path / "recording.parquet"
        if isinstance(table, pd.DataFrame):
            table.to_parquet(path)
        else:
            pq.write_table(table, path, **options)
        return read("parquet", path, most_bytes=most_bytes)

    return _stored


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (pa.array([1, None, 3], pa.int8()), [1, np.nan, 3]),
        (pa.array([1, None, 2**63], pa.uint64()), [1, np.nan, 2.0**63]),
        (pa.array([True, None, False]), [1, np.nan, 0]),
        (pa.array([0.5, None, np.nan], pa.float32()), [0.5, np.nan, np.nan]),
        (pa.array([Decimal("1.25"), None, Decimal("-3.50")]), [1.25, np.nan, -3.5]),
        (pa.array([2.0, None, 2.0]).dictionary_encode(), [2, np.nan, 2]),
        (pa.array([1500, None, 0], pa.duration("ms")), [1.5, np.nan, 0]),
        (pa.array([1500, None, 0], pa.time32("ms")), [1.5, np.nan, 0]),
        (pa.array([250_000, None, 0], pa.time64("us")), [0.25, np.nan, 0]),
    ],
    ids=lambda value: str(getattr(value, "type", "")),
)
def test_every_kind_of_number_is_read_and_what_is_null_is_missing(values, expected, stored):
    columns = stored(pa.table({"x": values}))
    np.testing.assert_array_equal(columns.values("x"), expected)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "Europe/Amsterdam"])
def test_timestamps_are_seconds_from_the_first(unit, zone, stored):
    moments = pd.to_datetime(["NaT", "2024-05-01 09:30:01", "2024-05-01 09:30:03"])
    columns = stored(
        pa.table({"when": pa.array(moments, pa.timestamp(unit, zone)), "x": [1, 2, 3]})
    )
    np.testing.assert_array_equal(columns.values("when"), [np.nan, 0, 2])
    assert columns.contents.start == "2024-05-01T09:30:01" + ("Z" if zone else "")
    assert columns.contents.groups[0].time == "when"
    assert columns.signal("when").unit == "s"


def test_nanoseconds_since_1970_keep_their_differences(stored):
    first = 1_714_555_800_123_456_789
    table = pa.table(
        {
            "when": pa.array([first, first + 7, first + 1_000_000_007], pa.timestamp("ns")),
            "gps": pa.array([1_714_555_800_123_457, 0, 1_714_555_801_123_457], pa.timestamp("us")),
        }
    )
    columns = stored(table)
    np.testing.assert_array_equal(columns.values("when"), [0, 7e-9, 1.000000007])
    np.testing.assert_allclose(columns.values("gps")[[0, 2]], [211e-9, 1 + 211e-9], atol=1e-15)


def test_units_of_pandas_attributes_and_its_index_are_understood(stored):
    index = pd.Index(pd.to_timedelta(np.arange(4) * 20, "ms"), name="elapsed")
    frame = pd.DataFrame({"beta": np.arange(4.0), "p": np.arange(4.0)}, index)
    frame.attrs = {"units": {"beta": "deg"}, "p": {"unit": "deg/s"}, "aircraft": "PH-LAB"}
    columns = stored(frame)
    assert [columns.signal(name).unit for name in ("beta", "p")] == ["deg", "deg/s"]
    assert columns.contents.groups[0].time == "elapsed"
    np.testing.assert_allclose(columns.values("elapsed"), np.arange(4) * 0.02)


@pytest.mark.parametrize("key", ["unit", "units", "UNIT"])
def test_the_unit_of_a_field_is_in_its_metadata(key, stored):
    metadata = {key: "deg", "description": "angle of sideslip"}
    schema = pa.schema([pa.field("beta", pa.float64(), metadata=metadata)])
    signal = stored(pa.table([[1.0, 2.0]], schema=schema)).signal("beta")
    assert (signal.unit, signal.description) == ("deg", "angle of sideslip")


def test_ignored_content_is_listed_with_reasons(stored):
    columns = stored(
        pa.table(
            [[1.0, 2.0], ["a", "b"], [[1], [2]], [{"b": 1.0}] * 2, pa.nulls(2), [3.0, 4.0], [5, 6]],
            names=["a.b", "mode", "list", "a", "null", "x", "x"],
        )
    )
    assert [signal.name for signal in columns.contents.signals] == ["a.b"]
    twice = "x: several columns have this name"
    assert columns.contents.ignored == (
        "mode: text", "list: nested", "a: nested", "null: no value", twice, twice,
    )  # fmt: skip


def test_rows_of_all_row_groups_come_in_their_order(stored, monkeypatch):
    monkeypatch.setattr("app.telemetry.readers.parquet.BATCH_ROWS", 7)
    columns = stored(pa.table({"x": np.arange(1000.0)}), row_group_size=90)
    np.testing.assert_array_equal(columns.values("x"), np.arange(1000.0))


def test_compressed_rows_are_counted_before_reading(stored):
    zeros = pa.DictionaryArray.from_arrays(np.zeros(10**7, "i1"), pa.array([0.0]))
    with pytest.raises(TelemetryError, match="610 MiB of numbers, more than the limit of 64 MiB"):
        stored(pa.table({f"x{k}": zeros for k in range(8)}), most_bytes=64 << 20)


def test_files_of_another_version_of_pandas_are_read(tmp_path):
    name = "v0.7.1.column-metadata-handling.parquet"
    if not (PYARROWS / name).exists():
        pytest.skip("pyarrow is installed without its Parquet files")
    (tmp_path / name).write_bytes((PYARROWS / name).read_bytes())
    columns = read("parquet", tmp_path / name)
    np.testing.assert_array_equal(columns.values("c"), [0, 86400, 172800])
    assert columns.contents.start == "2016-12-31T23:00:00Z"
    assert columns.contents.groups[0].time == "__index_level_1__"


def test_a_moment_beside_another_time_is_no_zero_of_that_time(stored):
    moments = pa.array(pd.to_datetime(["2024-05-01 09:30:01", "2024-05-01 09:30:02"]))
    columns = stored(pa.table({"time": [7.0, 8.0], "landed": moments}))
    assert (columns.contents.groups[0].time, columns.contents.start) == ("time", "")
