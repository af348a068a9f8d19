"""Recordings in TDMS, as npTDMS writes them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter

from app.telemetry.contents import Columns
from app.telemetry.recording import TelemetryError
from tests.support.recorded_files import read

X = np.arange(5.0)
Saved = Callable[..., Columns]


@pytest.fixture
def saved(tmp_path: Path) -> Saved:
    """Segments of channels: their group, name, values and properties; the columns of the file."""

    def save(*segments: list[tuple[str, str, Any, dict[str, Any]]]) -> Columns:
        path = tmp_path / "recording.tdms"
        with TdmsWriter(path) as file:
            for segment in segments:
                file.write_segment([ChannelObject(*channel) for channel in segment])
        return read("tdms", path)

    return save


def test_a_waveform_has_its_interval_and_start(saved: Saved) -> None:
    start = np.datetime64("2024-05-01T09:30:00")
    waveform = {"wf_increment": 0.02, "wf_start_offset": 0.5, "wf_start_time": start}
    columns = saved([("air", "beta", X, waveform | {"unit_string": "deg"})])
    (group,) = columns.contents.groups
    assert (group.rate, group.start, group.time) == (pytest.approx(50.0), 0.5, "")
    assert columns.contents.start.startswith("2024-05-01T09:30:00")


def test_times_of_day_are_seconds(saved: Saved) -> None:
    times = np.datetime64("2024-05-01T09:30:00") + np.arange(5) * np.timedelta64(20, "ms")
    columns = saved([("air", "clock", times, {}), ("air", "p", X, {})])
    t = columns.values(columns.contents.groups[0].time)
    np.testing.assert_allclose(np.diff(t), 0.02, atol=1e-6)


def test_segments_are_joined_and_counts_are_numbers(saved: Saved) -> None:
    part = [("air", "n", np.arange(3, dtype=np.int16), {})]
    columns = saved(part, part)
    np.testing.assert_array_equal(columns.values("air/n"), [0, 1, 2, 0, 1, 2])


def test_texts_are_named(saved: Saved) -> None:
    columns = saved([("air", "p", X, {}), ("air", "note", ["calm"] * 5, {})])
    assert columns.contents.ignored == ("air/note: text or bytes",)


def test_a_file_without_numbers_is_refused(saved: Saved) -> None:
    with pytest.raises(TelemetryError, match="no numeric signals"):
        saved([("air", "note", ["calm"] * 5, {})])
