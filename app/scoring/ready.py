"""A recording made ready for a monitor: its times repaired, its channels on the monitor's grid."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Self

import numpy as np

from app.scoring.plan import Plan, needed_channels, plan_of
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.recording import Recording, TelemetryError
from app.telemetry.resampling.resampling import on_grid
from app.telemetry.timing.timing import Quality, repaired
from app.telemetry.traces import Traces
from core.channels import KEYS
from core.monitor import Monitor
from core.types import Flags


class MissingChannels(TelemetryError):
    """Channels that a monitor reads and a recording lacks; says what each could be derived from.

    recorded: keys of TARGETS that it has.
    """

    def __init__(self, keys: list[str], recorded: Collection[str] = ()) -> None:
        self.keys = tuple(keys)
        ways = [
            f"{way.target} from {' and '.join(way.needs)}"
            for way in DERIVATIONS.values()
            if way.target in keys and all(key in recorded for key in way.needs)
        ]
        derive = f"derive {', '.join(ways)}, " if ways else ""
        super().__init__(
            f"the monitor needs {', '.join(keys)}, which the recording does not have: map signals "
            f"to what is missing, {derive}or choose a monitor that does not need it"
        )


@dataclass(frozen=True, eq=False)
class Ready:
    """A recording and the monitor that is to judge it.

    traces: repaired.   recording: on the monitor's grid.   needed: (6,) channels it reads.
    """

    monitor: Monitor
    plan: Plan
    traces: Traces
    quality: Quality
    recording: Recording
    needed: Flags
    notes: tuple[str, ...]

    @classmethod
    def of(cls, monitor: Monitor, traces: Traces) -> Self:
        """MissingChannels; TelemetryError where one is too slow or the times cannot be told."""
        plan = plan_of(monitor)
        needed = needed_channels(monitor, plan.limits)
        absent = [key for key in KEYS if not _is_recorded(traces, key)]
        if lacking := [key for key in absent if needed[KEYS.index(key)]]:
            recorded = [key for key in traces.channels if _is_recorded(traces, key)]
            raise MissingChannels(lacking, recorded)
        traces, quality = repaired(traces)
        read = [key for key, is_needed in zip(KEYS, needed, strict=True) if is_needed]
        recording = on_grid(traces, monitor.dt, read)
        notes = list(recording.notes)
        if absent:
            notes.append(f"Not recorded, and the monitor does not read it: {', '.join(absent)}.")
        return cls(monitor, plan, traces, quality, recording, needed, tuple(notes))


def _is_recorded(traces: Traces, key: str) -> bool:
    return key in traces.channels and bool(np.isfinite(traces.channels[key].values).any())
