"""A recording as rows to send to a live flight, in order of time."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.commands.output.scores import mapping_lines, read_mapping
from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.derivations import on_times_of
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.proposal import Proposal, propose
from app.telemetry.reading import columns_of
from app.telemetry.recording import ATTITUDE, TelemetryError
from app.telemetry.targets import TARGETS
from app.telemetry.timing.repair import repair
from app.telemetry.units import convert
from core.channels import LATERAL, Dictionary
from core.types import Array


class RecordedRows(NamedTuple):
    """t: (n,) time of each sample [s].   values: (n, k), NaN where missing.

    names: of the columns, time first.   notes: on how the file was read.
    """

    t: Array
    names: list[str]
    values: Array
    notes: list[str]


def si_rows(file: Path, mapping: Path | None, dictionary: Dictionary = LATERAL) -> RecordedRows:
    """The mapped channels in SI units at the times of the fastest channel. TelemetryError.

    mapping: a JSON file; the program's proposal if None.   dictionary: of the monitor.
    """
    with columns_of(file) as columns:
        used, proposal = _mapping(columns, mapping, dictionary)
        traces = repair(apply_mapping(columns, used)).traces
        notes = [*mapping_lines(used, proposal), *traces.notes]
    channels = {key: trace for key, trace in traces.channels.items() if len(trace.t)}
    needed = dictionary.measured
    if channels.keys() <= TARGETS.keys():  # no condition of limits that only the flight knows
        channels = {k: trace for k, trace in channels.items() if k in (*needed, *ATTITUDE)}
    measured = [trace for key, trace in channels.items() if key in needed or key not in ATTITUDE]
    if not measured:
        raise TelemetryError(f"{file}: none of {', '.join(needed)} is mapped: give a --mapping")
    fastest = max(measured, key=lambda trace: len(trace.t))
    t = fastest.t
    interpolated = [key for key, trace in channels.items() if trace.t is not t]
    if interpolated:
        notes.append(f"Interpolated linearly: {', '.join(interpolated)}.")
    values = [on_times_of(fastest, trace, key) for key, trace in channels.items()]
    return RecordedRows(t, ["t", *channels], np.column_stack([t, *values]), notes)


def raw_rows(file: Path, mapping: Path | None, names: Sequence[str]) -> RecordedRows:
    """The named signals with the file's own values, time first. TelemetryError."""
    with columns_of(file) as columns:
        used, _ = _mapping(columns, mapping, LATERAL)
        groups = {signal.name: signal.group for signal in columns.contents.signals}
        if missing := [name for name in names if name not in groups]:
            raise TelemetryError(
                f"{file} has no signal {', '.join(missing)}, which the flight expects: leave out "
                "--as-is, or start a flight with the mapping of this recording"
            )
        if len({groups[name] for name in names}) > 1:
            raise TelemetryError(
                f"the signals of {file} have different sample times: leave out --as-is"
            )
        values = np.column_stack([np.array(columns.values(name)) for name in names])
        units = [time.unit for time in used.times.values() if time.signal == names[0]]
        t = convert(values[:, 0], units[0] if units else "s", "s")
    timed = np.isfinite(t)
    return RecordedRows(t[timed], [*names], values[timed], [])


def _mapping(
    columns: Columns, path: Path | None, dictionary: Dictionary
) -> tuple[Mapping, Proposal | None]:
    """The mapping of a JSON file; without one, the program's with its proposal."""
    if path is not None:
        return read_mapping(path), None
    proposal = propose(columns, dictionary=dictionary)
    return proposal.mapping, proposal
