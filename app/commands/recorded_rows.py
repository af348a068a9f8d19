"""A recording as rows to send to a live flight, in order of time."""

import collections.abc as abc
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from app.commands.output.scores import mapping_lines, read_mapping
from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.derivations import on_times_of
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.proposal import Proposal, propose
from app.telemetry.mapping.signs import quiet_bias
from app.telemetry.reading import columns_of
from app.telemetry.recording import ATTITUDE, TelemetryError, Trace
from app.telemetry.targets import TARGETS
from app.telemetry.timing.repair import repair
from app.telemetry.units import PLAIN, convert, fits
from core.channels import LATERAL, Dictionary, channel
from core.conditions import CONDITIONS, ConditionKey
from core.types import Array

FLIGHT_CONDITION = tuple(
    channel(known.key, known.key, known.unit or PLAIN, known.label)
    for known in CONDITIONS.values()
    if known.key not in (*TARGETS, "altitude")
)
"""Channels of the flight condition that a file names exactly; altitude is mapped as `h`."""
NO_NAMES: abc.Mapping[str, str] = MappingProxyType({})


class RecordedRows(NamedTuple):
    """t: (n,) time of each sample [s].   values: (n, k), NaN where missing.

    names: of the columns, time first.   notes: on how the file was read.
    """

    t: Array
    names: list[str]
    values: Array
    notes: list[str]


def si_rows(
    file: Path,
    mapping: Path | None,
    dictionary: Dictionary = LATERAL,
    condition: abc.Mapping[str, str] = NO_NAMES,
) -> RecordedRows:
    """The mapped channels in SI units at the times of the fastest channel. TelemetryError.

    mapping: a JSON file; the program's proposal if None, without a bias: a source sends it.
    dictionary: of the monitor.
    condition: names under which the flight expects channels of its condition, if not their own.
    """
    with columns_of(file) as columns:
        used, proposal = _mapping(columns, mapping, dictionary)
        traces = repair(apply_mapping(columns, used)).traces
        notes = [*mapping_lines(used, proposal), *traces.notes]
    if proposal and "Ny" in traces.channels and (bias := quiet_bias(traces.channels["Ny"])):
        notes.append(f"Ny is sent with its {bias.text}. A flight that counts from trim takes it.")
    mapped = {k: trace for k, trace in traces.channels.items() if np.isfinite(trace.values).any()}
    needed = dictionary.measured
    measured = [trace for key, trace in mapped.items() if key in needed]
    if not measured:
        raise TelemetryError(f"{file}: none of {', '.join(needed)} is mapped: give a --mapping")
    fastest = max(measured, key=lambda trace: len(trace.t))
    t = fastest.t
    sent = {key: mapped[key] for key in (*needed, *ATTITUDE) if key in mapped}
    sent |= {
        condition.get(key, key): trace for key, trace in _condition(mapped) if key not in needed
    }
    if interpolated := [key for key, trace in sent.items() if trace.t is not t]:
        notes.append(f"Interpolated linearly: {', '.join(interpolated)}.")
    if unread := [
        key for key, trace in mapped.items() if all(trace is not x for x in sent.values())
    ]:
        notes.append(f"Not sent, because a live flight does not read it: {', '.join(unread)}.")
    values = [
        convert(_on_times_of(fastest, trace, key), trace.unit, dictionary.by_key[key].unit)
        if key in needed
        else _on_times_of(fastest, trace, key)
        for key, trace in sent.items()
    ]
    return RecordedRows(t, ["t", *sent], np.column_stack([t, *values]), notes)


def _on_times_of(fastest: Trace, trace: Trace, key: str) -> Array:
    """Values at the times of another trace: interpolated, or the last one of a number of a case."""
    if key != "configuration" or trace.t is fastest.t:
        return on_times_of(fastest, trace, key)
    known = np.isfinite(trace.t) & np.isfinite(trace.values)
    order = np.argsort(trace.t[known], kind="stable")
    values = np.append(np.nan, trace.values[known][order])
    return values[np.searchsorted(trace.t[known][order], fastest.t, "right")]


def _condition(mapped: abc.Mapping[str, Trace]) -> Iterator[tuple[ConditionKey, Trace]]:
    """The mapped channels of the flight condition. TelemetryError for a unit of another kind."""
    for key, known in CONDITIONS.items():
        trace = mapped.get(key) or (mapped.get("h") if key == "altitude" else None)
        if trace is None:
            continue
        if not fits(trace.unit, known.unit or PLAIN):
            raise TelemetryError(
                f"{key} ({trace.source}) is mapped in {trace.unit}: give the unit of a "
                f"{known.label}"
            )
        yield key, trace


def _mapping(
    columns: Columns, path: Path | None, dictionary: Dictionary
) -> tuple[Mapping, Proposal | None]:
    """The mapping of a JSON file; without one, the program's with its proposal."""
    if path is not None:
        return read_mapping(path), None
    proposal = propose(columns, dictionary=dictionary, others=FLIGHT_CONDITION, removes_bias=False)
    return proposal.mapping, proposal
