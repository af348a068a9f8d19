"""The flight condition of a recorded flight: in the unit that it had in flight."""

import json
from pathlib import Path

import pytest

from app.assessment.limits_history import LimitsHistory
from app.assessment.rulings import LimitsInForce
from app.telemetry.contents import open_columns
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.reading import read_file
from core.limits.limit_sets import LimitCase, LimitSet
from core.limits.limits import Limits


@pytest.mark.parametrize(("unit", "expected"), [("ft", 3048.0), ("m", 10000.0)])
def test_a_condition_that_is_a_channel_has_its_unit(
    tmp_path: Path, unit: str, expected: float
) -> None:
    mapping = Mapping({"h": ChannelSource("alt", unit)}, {"": TimeSource("t", "s")})
    limits = LimitSet((LimitCase("low", {"altitude": (None, 5000.0)}, Limits(Ny=0.5)),))
    put = LimitsInForce(1, "l", "low", 1, {}, 0, 0.0, "", "Ann", limits, ("",))
    header = {"format": 1, "flight": "f", "began": "2030-01-01T00:00:00+00:00"}
    header |= {"mapping": mapping.to_plain(), "conditions": {"altitude": "alt"}}
    lines = [
        header,
        {"e": "limits", "limits": put.to_plain(), "a": 0.0},
        {"s": 0, "b": {"t": [0.0, 0.05], "alt": [10000.0, 10000.0]}, "a": 0.1},
        {"e": "end", "a": 0.2},
    ]
    journal = tmp_path / "flight.jsonl"
    compact = [json.dumps(line, separators=(",", ":")) for line in lines]
    journal.write_text("".join(f"{line}\n" for line in compact))
    read_file(journal, tmp_path / "columns", name="flown")
    history = LimitsHistory.of(open_columns(tmp_path / "columns"), mapping)
    assert history is not None
    assert history.measured["altitude"].values == pytest.approx([expected, expected])
