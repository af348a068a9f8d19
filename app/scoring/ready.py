"""A recording made ready for a monitor: its times repaired, its channels on the monitor's grid."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Self

from app.scoring.limits_history import HeldLimits, LimitsHistory
from app.scoring.planned_test import PlannedTest, needed_channels, planned_test
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.recording import Recording, TelemetryError
from app.telemetry.resampling.resampling import on_grid
from app.telemetry.timing.quality import Quality
from app.telemetry.timing.repair import RepairedTraces
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
    held: the limits that were in force when; None where no limit set was.
    """

    monitor: Monitor
    planned: PlannedTest
    traces: Traces
    quality: Quality
    recording: Recording
    needed: Flags
    notes: tuple[str, ...]
    held: HeldLimits | None = None

    @classmethod
    def of(
        cls, monitor: Monitor, repaired: RepairedTraces, history: LimitsHistory | None = None
    ) -> Self:
        """MissingChannels; TelemetryError where one is too slow."""
        traces, quality = repaired.traces, repaired.quality
        planned = planned_test(monitor)
        needed = needed_channels(monitor, planned.limits)
        recorded = [c.key for c in quality.channels if c.missing < 1.0 or c.implausible]
        absent = [key for key in KEYS if key not in recorded]
        if lacking := [key for key in absent if needed[KEYS.index(key)]]:
            raise MissingChannels(lacking, recorded)
        read = [key for key, is_needed in zip(KEYS, needed, strict=True) if is_needed]
        recording = on_grid(traces, monitor.dt, read)
        notes = list(recording.notes)
        if absent:
            notes.append(f"Not recorded, and the monitor does not read it: {', '.join(absent)}.")
        held = None if history is None else history.held([monitor.limits])
        return cls(monitor, planned, traces, quality, recording, needed, tuple(notes), held)
