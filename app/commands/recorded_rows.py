"""A recording as the rows that its source sent: read, mapped, in the order of time."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.commands.output.mapping_lines import mapping_lines, read_mapping
from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.proposal import Proposal, propose
from app.telemetry.reading import columns_of
from app.telemetry.recording import ATTITUDE, TelemetryError
from app.telemetry.timing.repair import repair
from app.telemetry.traces import GAP_RATIO, Trace
from app.telemetry.units import convert
from core.channels import KEYS
from core.types import Array


class RecordedRows(NamedTuple):
    """Samples to send. t: (n,) [s], when each was taken.   values: (n, k), NaN where missing.

    names: of the columns, time first.   notes: on how they were read.
    """

    t: Array
    names: list[str]
    values: Array
    notes: list[str]


def si_rows(file: Path, mapping: Path | None) -> RecordedRows:
    """Our channels in SI units on the times of the fastest of them. TelemetryError.

    mapping: of a JSON file; as the program proposes it where None.
    """
    with columns_of(file) as columns:
        given, proposal = _mapping(columns, mapping)
        traces = repair(apply_mapping(columns, given)).traces
        notes = [*mapping_lines(given, proposal), *traces.notes]
    channels = {k: x for k, x in traces.channels.items() if k in (*KEYS, *ATTITUDE) and len(x.t)}
    measured = [trace for key, trace in channels.items() if key in KEYS]
    if not measured:
        raise TelemetryError(f"{file}: none of {', '.join(KEYS)} is mapped: give a --mapping")
    t = max((trace.t for trace in measured), key=len)
    on_others = [key for key, trace in channels.items() if trace.t is not t]
    if on_others:
        notes.append(f"On lines between their own samples: {', '.join(on_others)}.")
    values = [trace.values if trace.t is t else _between(t, trace) for trace in channels.values()]
    return RecordedRows(t, ["t", *channels], np.column_stack([t, *values]), notes)


def own_rows(file: Path, mapping: Path | None, names: Sequence[str]) -> RecordedRows:
    """The signals of these names as the file has them, time first. TelemetryError."""
    with columns_of(file) as columns:
        given, _ = _mapping(columns, mapping)
        known = {signal.name: signal.group for signal in columns.contents.signals}
        if lacking := [name for name in names if name not in known]:
            raise TelemetryError(
                f"{file} has no signal {', '.join(lacking)}: the flight was started to read other "
                "names; leave --as-is out, or start one with the mapping of this recording"
            )
        if len({known[name] for name in names}) > 1:
            raise TelemetryError(
                f"the signals of {file} were not sampled together: leave --as-is out"
            )
        values = np.column_stack([np.array(columns.values(name)) for name in names])
        units = [time.unit for time in given.times.values() if time.signal == names[0]]
        t = convert(values[:, 0], units[0] if units else "s", "s")
    timed = np.isfinite(t)
    return RecordedRows(t[timed], [*names], values[timed], [])


def _mapping(columns: Columns, path: Path | None) -> tuple[Mapping, Proposal | None]:
    """What the columns are, with its proposal unless it was given."""
    if path is not None:
        return read_mapping(path), None
    proposal = propose(columns)
    return proposal.mapping, proposal


def _between(t: Array, trace: Trace) -> Array:
    """(n,) values at t on the lines between neighbours; NaN in gaps and beyond either end."""
    known = np.isfinite(trace.values)
    if not known.any():
        return np.full(len(t), np.nan)
    own, values = trace.t[known], trace.values[known]
    at = np.interp(t, own, values, left=np.nan, right=np.nan)
    step = np.median(np.diff(own)) if len(own) > 1 else 0.0
    after = np.searchsorted(own, t).clip(1, max(1, len(own) - 1))
    apart = own[np.minimum(after, len(own) - 1)] - own[after - 1]
    return np.where(apart > GAP_RATIO * step, np.nan, at)
