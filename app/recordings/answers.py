"""What is answered about a recording, as plain data."""

from dataclasses import asdict
from typing import Any

import numpy as np

from app.recordings.recordings import Recordings
from app.store.recordings import MappedColumns
from app.store.store import NotFound
from app.telemetry.contents import Contents
from app.telemetry.mapping.applying import preview
from app.telemetry.mapping.doubts import find_doubts
from app.telemetry.mapping.mapping import Mapping
from core.channels import KEYS

BINS = 120
"""Of a small plot."""
SUMMARY = ("n", "missing", "min", "max", "mean")


def described(recordings: Recordings, recording_id: str) -> dict[str, Any]:
    """All about a recording. NotFound; StoreError."""
    info = recordings.store.recordings.info(recording_id)
    mapped = recordings.store.recordings.mapped_columns(recording_id)
    contents = recordings.columns(recording_id).contents
    return asdict(info) | {
        "same_as": recordings.store.recordings.duplicate_of(recording_id),
        "contents": _contents(contents, mapped),
        "bad_rows": _bad_rows(contents),
        "mapping": mapped.mapping,
        **{key: mapped.proposal[key] for key in ("guesses", "alternatives", "derivable")},
        "missing": [key for key in KEYS if key not in mapped.mapping["channels"]],
        "quality": mapped.quality,
        "problem": mapped.problem,
    }


def bands(recordings: Recordings, recording_id: str, mapping: Mapping, bins: int) -> dict[str, Any]:
    """What comes of a mapping, channel by channel, without keeping it. NotFound; StoreError."""
    mapped = recordings.take_mapping(recording_id, mapping)
    with recordings.present(recording_id):
        columns = recordings.files.columns(recording_id)
        return {
            "channels": preview(columns, mapping, bins),
            "quality": mapped.quality,
            "problem": mapped.problem,
            "doubts": find_doubts(columns, mapping),
        }


def signal_bands(recordings: Recordings, recording_id: str, index: int) -> dict[str, Any]:
    """A signal of a recording in a few bins. NotFound; StoreError."""
    recordings.store.recordings.info(recording_id)
    columns = recordings.columns(recording_id)
    signals = columns.contents.signals
    if not 0 <= index < len(signals):
        raise NotFound(f"the recording has signals 0 to {len(signals) - 1}, not {index}")
    with recordings.present(recording_id):
        values = columns.values(signals[index].name)
    rows = max(1, -(-len(values) // BINS))
    starts = np.arange(0, len(values), rows)
    return {
        "name": signals[index].name,
        "unit": signals[index].unit,
        "n": len(values),
        "rows": rows,
        "low": np.fmin.reduceat(values, starts) if len(values) else [],
        "high": np.fmax.reduceat(values, starts) if len(values) else [],
    }


def _contents(contents: Contents, mapped: MappedColumns) -> dict[str, Any]:
    rates = _rates(contents, mapped)
    return {
        "groups": [
            {"name": group.name, "n_rows": group.n_rows, "rate": rates.get(number)}
            for number, group in enumerate(contents.groups)
        ],
        "signals": [
            asdict(signal) | dict(zip(SUMMARY, summary, strict=True))
            for signal, summary in zip(contents.signals, mapped.statistics, strict=True)
        ],
        "ignored": list(contents.ignored),
        "notes": list(contents.notes),
        "start": contents.start,
    }


def _rates(contents: Contents, mapped: MappedColumns) -> dict[int, float]:
    """Rate of each group that a channel is of [Hz]."""
    groups = {signal.name: signal.group for signal in contents.signals}
    clocks = mapped.quality["clocks"] if mapped.quality else []
    return {
        groups[signal]: clock["rate"]
        for clock in clocks
        for key in clock["channels"]
        if clock["rate"] and (signal := mapped.mapping["channels"][key]["signal"])
    }


def _bad_rows(contents: Contents) -> dict[str, Any]:
    n_rows = contents.n_bad_rows + max(group.n_rows for group in contents.groups)
    return {
        "n": contents.n_bad_rows,
        "share": contents.n_bad_rows / n_rows,
        "rows": [asdict(row) for row in contents.bad_rows],
    }
