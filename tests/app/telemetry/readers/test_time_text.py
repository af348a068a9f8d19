"""Times as text in any form become seconds since the first."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.telemetry.contents import ColumnWriter, open_columns
from app.telemetry.readers.text import read
from app.telemetry.readers.text_times import ElapsedTime, form_of, is_time, times_of
from tests.support.clocks import CLOCKS, T0


def seconds(texts):
    clock = ElapsedTime(form_of(texts), texts[0])
    column = pa.chunked_array([pa.array(texts, pa.string())])
    return clock.seconds(times_of(column, clock.form)), clock


@pytest.mark.parametrize("form", CLOCKS)
@settings(max_examples=25)
@given(st.lists(st.integers(0, 300_000), min_size=1, max_size=8))
def test_every_form_gives_the_same_times(form, milliseconds):
    texts = [CLOCKS[form](T0 + timedelta(milliseconds=k)) for k in milliseconds]
    assert all(map(is_time, texts))
    elapsed, _ = seconds(texts)
    np.testing.assert_array_equal(elapsed, (np.array(milliseconds) - milliseconds[0]) / 1000)


@given(st.lists(st.datetimes(datetime(1900, 1, 1), datetime(2150, 1, 1)), min_size=1, max_size=5))
def test_dates_are_counted_as_the_calendar_does(dates):
    expected = [(date - dates[0]) / timedelta(seconds=1) for date in dates]
    for form in (datetime.isoformat, lambda t: t.strftime("%Y-%jT%H:%M:%S.%f")):
        elapsed, _ = seconds([form(date) for date in dates])
        np.testing.assert_allclose(elapsed, expected, rtol=1e-15, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "start"),
    [
        ("2026-05-03T12:34:56.500", "2026-05-03T12:34:56.5"),
        ("2026-05-03 12:34:56", "2026-05-03T12:34:56"),
        ("2026-05-03T12:34:56+02:00", "2026-05-03T10:34:56Z"),
        ("2026-05-03T12:34:56Z", "2026-05-03T12:34:56Z"),
        ("2026-123T12:34:56", "2026-05-03T12:34:56"),
        ("123:12:34:56.789", "123:12:34:56.789"),
        ("001 00:00:07Z", "001:00:00:07Z"),
        ("12:34:56", "12:34:56"),
        ("34:56.789", "34:56.789"),
    ],
)
def test_the_start_has_only_the_known_parts(text, start):
    _, clock = seconds([text, text])
    assert clock.start() == start


def test_the_start_has_the_day_even_without_a_year():
    _, clock = seconds(["123:12:34:56.789"])
    assert "since 12:34:56.789 of day 123 of its year" in clock.notes("IRIG")[0]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("23:59:59.5", "00:00:00.5"),
        ("365:23:59:59.5", "001:00:00:00.5"),
        ("59:59.5", "00:00.5"),
        ("2025-12-31T23:59:59.5", "2026-01-01T00:00:00.5"),
        ("2026-03-01T23:59:59.5+01:00", "2026-03-02T01:00:00.5+02:00"),
    ],
)
def test_a_clock_that_restarts_is_continued(before, after):
    np.testing.assert_array_equal(seconds([before, after])[0], [0, 1])


def test_midnight_within_and_between_blocks_is_counted():
    clock = ElapsedTime(form_of(["00:00:00"]))
    times = [datetime(2026, 1, 1, tzinfo=UTC) + timedelta(hours=5 * k) for k in range(15)]
    elapsed = []
    for block in (times[:4], times[4:5], [], times[5:]):
        column = pa.chunked_array([pa.array([f"{t:%H:%M:%S}" for t in block], pa.string())])
        elapsed.extend(clock.seconds(times_of(column, clock.form)))
    np.testing.assert_array_equal(elapsed, 5 * 3600 * np.arange(15))
    assert "passes midnight 2 times" in clock.notes("UTC")[1]


def test_samples_out_of_order_about_midnight_are_not_days_apart():
    elapsed, clock = seconds(["23:59:59", "00:00:00", "23:59:58", "00:00:01"])
    np.testing.assert_array_equal(elapsed, [0, 1, -1, 2])
    assert clock.turns == 1


@pytest.mark.parametrize("first", [None, "2026-05-03T12:34:56"])
def test_a_missing_time_is_nan(first):
    times = [first, "2026-05-03T12:34:57", None, "2026-05-03T12:34:59"]
    clock = ElapsedTime(form_of([time for time in times if time]))
    for zone in ("", "Z"):
        texts = pa.array([time and time + zone for time in times], pa.string())
        elapsed = clock.seconds(times_of(pa.chunked_array([texts]), clock.form))
        np.testing.assert_array_equal(np.isnan(elapsed), [time is None for time in times])
        assert elapsed[3] - elapsed[1] == 2


@pytest.mark.parametrize(
    "cell",
    ["12.5", "noon", "25:00:00", "12:60:00", "12:00:61", "367:00:00:00", "2026-13-01 12:00:00",
     "12:34", "1:2:3", "2026-03-01", "12:34:56 PM", "00:00:00:00:00", "9999-01-01 00:00:00"],
)  # fmt: skip
def test_text_that_is_not_a_time_is_not_read_as_one(cell):
    assert not is_time(cell)


def poured(text, tmp_path):
    path, folder = tmp_path / "record.csv", tmp_path / "columns"
    path.write_text(text)
    folder.mkdir()
    read(path, ColumnWriter(folder, 2**20))
    return open_columns(folder)


def rows(form, n=300, rate=100):
    return [f"{CLOCKS[form](T0 + timedelta(seconds=k / rate))};{k}" for k in range(n)]


@pytest.mark.parametrize("form", CLOCKS)
def test_a_column_of_times_is_the_time_of_its_table(form, tmp_path):
    columns = poured("\n".join(["UTC [hh:mm:ss];beta", *rows(form)]), tmp_path)
    assert columns.contents.groups[0].time == "UTC [hh:mm:ss]"
    assert columns.signal("UTC [hh:mm:ss]").unit == "s"
    np.testing.assert_array_equal(columns.values("UTC [hh:mm:ss]"), np.arange(300) / 100)
    assert "56.789" in columns.contents.start or form == "minutes"


def test_a_bad_time_is_a_bad_row(tmp_path):
    table = rows("clock")
    table[100], table[200] = "12:99:00;5", "soon;5"
    columns = poured("\n".join(["UTC;beta", *table]), tmp_path)
    assert [row.line for row in columns.contents.bad_rows] == [102, 202]
    assert "'12:99:00' in column UTC is not a time of day" in columns.contents.bad_rows[0].reason
    np.testing.assert_array_equal(columns.values("beta"), np.delete(np.arange(300.0), [100, 200]))


def test_a_clock_with_repeated_times_is_read_but_is_not_the_time(tmp_path):
    table = [f"{T0 + timedelta(seconds=k // 10):%H:%M:%S};{k / 10};{k}" for k in range(100)]
    columns = poured("\n".join(["UTC;t;beta", *table]), tmp_path)
    assert columns.contents.groups[0].time == ""
    np.testing.assert_array_equal(columns.values("UTC"), np.arange(100) // 10)
    assert any("UTC repeats its times" in note for note in columns.contents.notes)


def test_the_finer_of_two_times_is_the_time(tmp_path):
    table = [
        f"{T0 + timedelta(seconds=k // 10):%H:%M:%S};{row}"
        for k, row in enumerate(rows("iso", 100, 10))
    ]
    columns = poured("\n".join(["GPS;UTC;beta", *table]), tmp_path)
    assert columns.contents.groups[0].time == "UTC"
    assert columns.contents.start == "2026-03-01T12:34:56.789"
