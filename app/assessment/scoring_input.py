"""The input of scoring: a recording with repaired times, its channels on the monitor's grid."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Self

from app.assessment.limits_history import InForceTimeline, LimitsHistory
from app.assessment.planned_test import PlannedTest, needed_channels, planned_test
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
    """Channels a monitor needs and a recording lacks; the message offers derivations.

    recorded: keys of TARGETS in the recording.
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
            f"to the missing channels, {derive}or choose a monitor that does not need them or "
            "train one for these channels (see the recording's training proposal)"
        )


@dataclass(frozen=True, eq=False)
class ScoringInput:
    """A recording and the monitor that scores it.

    traces: repaired.   recording: on the monitor's grid.   needed: (6,) channels the monitor needs.
    timeline: limits in force over time; None where no limit set was in force.
    """

    monitor: Monitor
    planned: PlannedTest
    traces: Traces
    quality: Quality
    recording: Recording
    needed: Flags
    notes: tuple[str, ...]
    timeline: InForceTimeline | None = None

    @classmethod
    def of(
        cls, monitor: Monitor, repaired: RepairedTraces, history: LimitsHistory | None = None
    ) -> Self:
        """Raises MissingChannels, or TelemetryError for a channel that is too slow."""
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
            notes.append(f"Not recorded and not read by the monitor: {', '.join(absent)}.")
        timeline = None if history is None else history.timeline([monitor.limits])
        return cls(monitor, planned, traces, quality, recording, needed, tuple(notes), timeline)
