"""Journals of live flights as recordings: sent values and times of arrival, nothing else."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.telemetry.contents import Columns, open_columns
from app.telemetry.reading import read_file
from app.telemetry.recording import TelemetryError

HEADER = {"format": 1, "flight": "f", "began": "2030-01-01T00:00:00+00:00", "a": 0.0}


def columns_of(root: Path, lines: list[Any], header: dict[str, Any] = HEADER) -> Columns:
    path = root / "f.jsonl"
    texts = [line if isinstance(line, str) else json.dumps(line) + "\n" for line in lines]
    path.write_text("".join([json.dumps(header) + "\n", *texts]).replace('": ', '":'))
    read_file(path, root / "columns")
    return open_columns(root / "columns")


def batch(arrived: float, **values: list[Any]) -> dict[str, Any]:
    return {"v": "rest", "s": 1, "b": values, "a": arrived}


def test_values_are_exactly_those_sent_in_the_order_of_arrival(tmp_path: Path) -> None:
    beta = [0.1 + 0.2, -1e-300, None, 3]
    lines = [
        batch(0.5, t=[0.02, 0.0], beta=beta[:2]),
        {"e": "manoeuvre", "by": "FTE", "a": 0.6},
        batch(0.7, t=[0.04, 0.06], beta=beta[2:], **{"nav/h": [True, 7]}),
    ]
    columns = columns_of(tmp_path, lines)
    assert columns.contents.format == "journal"
    assert columns.contents.groups[0].time == "t"
    assert columns.values("t").tolist() == [0.02, 0.0, 0.04, 0.06]
    assert columns.values("arrived").tolist() == [0.5, 0.5, 0.7, 0.7]
    np.testing.assert_array_equal(columns.values("beta"), [0.1 + 0.2, -1e-300, np.nan, 3.0])
    np.testing.assert_array_equal(columns.values("nav/h"), [np.nan, np.nan, 1.0, 7.0])
    assert columns.contents.n_bad_rows == 0


def test_an_incomplete_last_line_is_dropped_with_a_note(tmp_path: Path) -> None:
    lines = [batch(0.1 * k, t=[0.1 * k], beta=[0.0]) for k in range(3)]
    columns = columns_of(tmp_path, [*lines, '{"v":"rest","s":9,"b":{"t":[0.3'])
    assert len(columns.values("t")) == 3
    assert "incomplete last line" in columns.contents.notes[0]


def test_text_and_unequal_lengths_are_ignored_by_name(tmp_path: Path) -> None:
    lines = [batch(k, t=[k, k + 0.5], beta=[1.0, 2.0], mode=["a", "b"], n=[1]) for k in range(3)]
    columns = columns_of(tmp_path, lines)
    assert [signal.name for signal in columns.contents.signals] == ["t", "beta", "arrived"]
    assert [line.partition(":")[0] for line in columns.contents.ignored] == ["mode", "n"]


def test_units_are_those_of_the_flight(tmp_path: Path) -> None:
    lines = [batch(k, clock=[1e3 * k], AOS=[1.0], t=[5.0]) for k in range(3)]
    mapping = {
        "channels": {"beta": {"signal": "AOS", "unit": "deg"}},
        "times": {"": {"signal": "clock", "unit": "ms"}},
    }
    columns = columns_of(tmp_path, lines, HEADER | {"mapping": mapping})
    assert columns.contents.groups[0].time == "clock"
    assert {s.name: s.unit for s in columns.contents.signals} == {
        "clock": "ms", "AOS": "deg", "t": "", "arrived": "s",
    }  # fmt: skip
    (tmp_path / "own").mkdir()
    lines = [batch(k, t=[k], beta=[1.0]) for k in range(3)]
    unmapped = columns_of(tmp_path / "own", lines, HEADER | {"mapping": None})
    assert [s.unit for s in unmapped.contents.signals] == ["s", "rad", "s"]


def test_damaged_lines_are_bad_rows_and_too_many_are_refused(tmp_path: Path) -> None:
    good = [batch(k, t=[k], beta=[0.0]) for k in range(8)]
    odd = ["{\n", {"b": {"t": 1}, "a": 0.0}, batch(0.0, beta=[1.0])]
    columns = columns_of(tmp_path, good + odd)
    assert [row.line for row in columns.contents.bad_rows] == [10, 11, 12]
    (tmp_path / "more").mkdir()
    with pytest.raises(TelemetryError, match="4 of the 12 rows cannot be read"):
        columns_of(tmp_path / "more", [*good, *odd, "[]\n"])


def test_a_signal_that_begins_late_is_missing_before(tmp_path: Path) -> None:
    lines = [batch(k, t=[k], **({"late": [1.5]} if k > 6 else {})) for k in range(10)]
    late = columns_of(tmp_path, lines).values("late")
    assert np.isnan(late[:7]).all()
    assert late[7:].tolist() == [1.5] * 3
