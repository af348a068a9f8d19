"""The stored mapping of a recording, proposed or confirmed, with the quality of its channels."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from app import json_codec
from app.assessment import ScoredRecording
from app.recordings.mapped_recording import MappedRecording
from app.store.recordings import MappedColumns, MappingState, RememberedMapping
from app.telemetry.contents import Columns, Contents
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.proposal import propose
from app.telemetry.recording import TelemetryError, Traces
from app.telemetry.timing.quality import Quality
from core.channels import LATERAL, Channel, Dictionary
from core.clearance.sensors import TOLERANCES

BLOCK = 2**18
"""Values that are read at once."""


def propose_mapping(
    columns: Columns,
    remembered: RememberedMapping | None,
    dictionary: Dictionary = LATERAL,
    others: Iterable[Channel] = (),
    summaries: list[list[float | None]] | None = None,
) -> tuple[MappedColumns, MappedRecording]:
    """Propose a mapping of a recording; return it in stored form, and applied.

    dictionary: of the monitor.   others: further channels that the file may have.
    summaries: of the signals, as `statistics` gives them, if they are known.
    """
    before = _still_known(remembered)
    aircraft = remembered.aircraft if remembered else ""
    proposal = propose(columns, before, aircraft=aircraft, dictionary=dictionary, others=others)
    unchanged = before is not None and before.channels.items() <= proposal.mapping.channels.items()
    described = {
        "rationales": proposal.rationales,
        "alternatives": proposal.alternatives,
        "notes": proposal.notes,
        "derivable": {
            key: [
                {"key": way.key, "title": way.title, "needs": way.needs}
                for way in map(DERIVATIONS.__getitem__, names)
            ]
            for key, names in proposal.derivable.items()
        },
    }
    state: MappingState = "remembered" if unchanged else "proposed"
    summaries = statistics(columns) if summaries is None else summaries
    unmapped = MappedColumns({}, state, plain(described), None, None, None, summaries)
    mapped = MappedRecording.of(columns, proposal.mapping)
    return with_mapping(unmapped, mapped), mapped


def with_mapping(before: MappedColumns, mapped: MappedRecording) -> MappedColumns:
    """The stored form with another mapping and the quality of its channels."""
    repaired = mapped.repaired
    return replace(
        before,
        mapping=mapped.mapping.to_plain(),
        quality=plain_quality(repaired.quality) if repaired else None,
        problem=mapped.problem,
        duration=_duration(repaired.traces) if repaired else None,
    )


def _still_known(remembered: RememberedMapping | None) -> Mapping | None:
    """The remembered mapping; None if this version does not know all of its names."""
    try:
        return None if remembered is None else Mapping.from_plain(remembered.mapping)
    except TelemetryError:
        return None


def signature(contents: Contents) -> str:
    """Digest of the names and units of a recorder's signals, in any order."""
    names = sorted((signal.name, signal.unit) for signal in contents.signals)
    return hashlib.sha256(json.dumps(names).encode()).hexdigest()


def statistics(columns: Columns) -> list[list[float | None]]:
    """n, missing, min, max and mean of each signal, in the file's unit."""
    return [_summary(columns.values(signal.name)) for signal in columns.contents.signals]


def _summary(values: np.ndarray) -> list[float | None]:
    n, total, low, high = 0, 0.0, np.inf, -np.inf
    for first in range(0, len(values), BLOCK):
        block = values[first : first + BLOCK]
        block = block[np.isfinite(block)]
        if len(block):
            n, total = n + len(block), total + float(block.sum())
            low, high = min(low, float(block.min())), max(high, float(block.max()))
    missing = len(values) - n
    return [len(values), missing, *((low, high, total / n) if n else (None, None, None))]


def _duration(traces: Traces) -> float | None:
    """From the first time to the last [s]; repaired times are finite."""
    clocks = {id(trace.t): trace.t for trace in traces.channels.values() if len(trace.t)}
    ends = [(float(t.min()), float(t.max())) for t in clocks.values()]
    return max(e for _, e in ends) - min(b for b, _ in ends) if ends else None


def plain_quality(quality: Quality) -> dict[str, Any]:
    """Quality as JSON's types, with its sentences."""
    return plain(quality) | {"sentences": list(quality.sentences())}


def quality_of(scored: ScoredRecording) -> dict[str, Any]:
    """Quality of a scored recording, and whether its sensors agree."""
    checks = [check.to_plain() for check in scored.compatibility]
    compatibility = {"compatibility": plain(checks), "compatibility_tolerances": TOLERANCES}
    return plain_quality(scored.quality) | compatibility


def plain(content: Any) -> Any:
    """Dataclasses and arrays as JSON's types; NaN and infinity become null."""
    return json_codec.decode(json_codec.encode(content))
