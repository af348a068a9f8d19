"""A recording as plain data: contents, mapping, small plots."""

from collections.abc import Collection, Iterable
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from app.recordings.mapped_columns import plain_quality
from app.recordings.recordings import Recordings
from app.store.recordings import MappedColumns
from app.store.store import NotFound
from app.telemetry.contents import Contents
from app.telemetry.mapping.applying import applicable
from app.telemetry.mapping.checks import find_warnings
from app.telemetry.mapping.mapping import Mapping, TimeSource, rate_words
from app.telemetry.recording import Trace, Traces
from app.telemetry.targets import as_mapped, target_of
from app.telemetry.units import choices
from core.channels import DICTIONARIES, LATERAL, Channel, Dictionary
from core.types import Array

BINS = 120
"""Bins of a small plot."""
SUMMARY = ("n", "missing", "min", "max", "mean")


def recording_answer(
    recordings: Recordings,
    recording_id: str,
    monitor_id: str | None = None,
    *,
    proposed: bool = False,
) -> dict[str, Any]:
    """A recording with its contents and mapping. NotFound; StoreError.

    monitor_id: the monitor whose channels come first.   proposed: whether the mapping is
    proposed again for it.
    """
    info = recordings.store.recordings.info(recording_id)
    mapped = recordings.store.recordings.mapped_columns(recording_id)
    contents = recordings.columns(recording_id).contents
    if monitor_id is None:
        dictionary = _likely(mapped.mapping["channels"], recordings.store.dictionaries())
    else:
        dictionary = recordings.dictionary_of(monitor_id)
    if proposed:
        mapped = recordings.proposed_for(recording_id, dictionary)
        state, over = mapped.mapping_state, mapped.confirmed_over
        info = replace(info, mapping_state=state, confirmed_over=over)
    return asdict(info) | {
        "contents": _contents(contents, mapped),
        "bad_rows": _bad_rows(contents),
        "mapping": mapped.mapping,
        "rates": {
            group: rate_words(TimeSource(**source))
            for group, source in mapped.mapping["times"].items()
            if source["rate"]
        },
        **{key: mapped.proposal[key] for key in ("rationales", "alternatives", "derivable")},
        "mapping_notes": mapped.proposal.get("notes", []),
        "channels": list(dictionary.measured),
        "targets": _targets(mapped.mapping["channels"], dictionary, recordings.channels()),
        "missing": [k for k in dictionary.measured if k not in mapped.mapping["channels"]],
        "quality": mapped.quality,
        "problem": mapped.problem,
    }


def _likely(mapped: Collection[str], own: Iterable[Dictionary]) -> Dictionary:
    """The dictionary that a mapping is for: the lateral one if it has any of its channels."""
    if not mapped or any(key in mapped for key in LATERAL.keys):
        return LATERAL
    known = (*own, *DICTIONARIES.values())
    return max(
        known, key=lambda each: sum(key in mapped for key in each.measured) / len(each.measured)
    )


def _targets(
    mapped: dict[str, Any], dictionary: Dictionary, known: Iterable[Channel]
) -> list[dict[str, Any]]:
    """Channels to which signals can be mapped: first those of a dictionary, each key once."""
    targets: dict[str, Channel] = {}
    for channel in (*dictionary.channels, *known):
        if not channel.formula:
            targets.setdefault(channel.key, as_mapped(channel))
    for key, source in mapped.items():
        targets.setdefault(key, target_of(key, source["unit"]))
    return [asdict(target) | {"units": choices(target.unit)} for target in targets.values()]


def preview(
    recordings: Recordings, recording_id: str, mapping: Mapping, bins: int
) -> dict[str, Any]:
    """Channels, quality and warnings under a mapping, without storing it. NotFound; StoreError."""
    mapped = recordings.mapped(recording_id, mapping)
    with recordings.present(recording_id):
        columns = recordings.files.columns(recording_id)
        applied = mapped.applied or applicable(columns, mapping)
        return {
            "channels": channel_bands(applied, bins),
            "quality": plain_quality(mapped.repaired.quality) if mapped.repaired else None,
            "problem": mapped.problem,
            "warnings": find_warnings(columns, mapping, mapped.applied),
        }


def channel_bands(traces: Traces, bins: int = BINS) -> dict[str, dict[str, Any]]:
    """Small plots by key: t, low and high of at most `bins` equal bins; unit, min, max.

    In JSON's types, None for missing numbers.
    """
    return {key: _bands(trace, bins) for key, trace in traces.channels.items()}


def _bands(trace: Trace, bins: int) -> dict[str, Any]:
    rows = len(trace.values)
    if not rows:
        return {"t": [], "low": [], "high": [], "unit": trace.unit, "min": None, "max": None}
    starts = np.linspace(0, rows, min(bins, rows), endpoint=False).astype(np.intp)
    middle = (starts + np.append(starts[1:], rows)) // 2
    low, high = np.fmin.reduceat(trace.values, starts), np.fmax.reduceat(trace.values, starts)
    return {
        "t": _plain(trace.t[middle]),
        "low": _plain(low),
        "high": _plain(high),
        "unit": trace.unit,
        "min": _plain(np.fmin.reduce(low, keepdims=True))[0],
        "max": _plain(np.fmax.reduce(high, keepdims=True))[0],
    }


def _plain(numbers: Array) -> list[float | None]:
    return [number if number == number else None for number in numbers.tolist()]


def signal_bands(recordings: Recordings, recording_id: str, index: int) -> dict[str, Any]:
    """A signal of a recording in at most BINS bins. NotFound; StoreError."""
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
    """Sample rate of each group with a mapped channel [Hz]."""
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
