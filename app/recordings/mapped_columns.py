"""What the columns of a recording are taken for, and how good they are as such."""

import hashlib
import json
from dataclasses import replace
from typing import Any

import numpy as np

from app import json_codec
from app.store.mappings import RememberedMapping
from app.store.recordings import MappedColumns, MappingState
from app.telemetry.contents import Columns, Contents
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.derivations import DERIVATIONS, Derivation
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.proposal import propose
from app.telemetry.recording import TelemetryError
from app.telemetry.timing.timing import Quality, repaired
from app.telemetry.traces import Traces

BLOCK = 2**18
"""Values looked at together."""


def propose_mapping(columns: Columns, remembered: RememberedMapping | None) -> MappedColumns:
    """Say what the columns of a new recording are likely to be."""
    kept = _still_known(remembered)
    proposal = propose(columns, kept, aircraft=remembered.aircraft if remembered else "")
    taken = kept is not None and kept.channels.items() <= proposal.mapping.channels.items()
    described = {
        "guesses": proposal.guesses,
        "alternatives": proposal.alternatives,
        "derivable": {
            key: [_way(DERIVATIONS[name]) for name in names]
            for key, names in proposal.derivable.items()
        },
    }
    state: MappingState = "remembered" if taken else "proposed"
    return take_mapping(
        columns,
        proposal.mapping,
        MappedColumns({}, state, plain(described), None, None, None, statistics(columns)),
    )


def take_mapping(columns: Columns, mapping: Mapping, before: MappedColumns) -> MappedColumns:
    """Take the columns for something else, and say what comes of it."""
    quality, problem, duration = None, None, None
    try:
        traces, measured = repaired(apply_mapping(columns, mapping))
    except TelemetryError as error:
        problem = str(error)
    else:
        quality = plain_quality(measured)
        duration = _duration(traces)
    return replace(
        before,
        mapping=mapping.to_plain(),
        quality=quality,
        problem=problem,
        duration=duration,
    )


def _still_known(remembered: RememberedMapping | None) -> Mapping | None:
    """The mapping that was kept; None where it names what this program does not know any more."""
    try:
        return None if remembered is None else Mapping.from_plain(remembered.mapping)
    except TelemetryError:
        return None


def _way(derivation: Derivation) -> dict[str, Any]:
    return {"key": derivation.key, "title": derivation.title, "needs": derivation.needs}


def signature(contents: Contents) -> str:
    """Digest of the signals that a recorder writes: their names and units, in any order."""
    names = sorted((signal.name, signal.unit) for signal in contents.signals)
    return hashlib.sha256(json.dumps(names).encode()).hexdigest()


def statistics(columns: Columns) -> list[list[float | None]]:
    """n, missing, min, max and mean of each signal, in the unit of the file."""
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
    """From the first time to the last; repaired times are finite."""
    clocks = {id(trace.t): trace.t for trace in traces.channels.values() if len(trace.t)}
    ends = [(float(t.min()), float(t.max())) for t in clocks.values()]
    return max(e for _, e in ends) - min(b for b, _ in ends) if ends else None


def plain_quality(quality: Quality) -> dict[str, Any]:
    """Quality as JSON's types, its sentences among them."""
    return plain(quality) | {"sentences": list(quality.sentences())}


def plain(content: Any) -> Any:
    """Dataclasses and arrays as JSON's types; what is not a number becomes null."""
    return json_codec.decode(json_codec.encode(content))
