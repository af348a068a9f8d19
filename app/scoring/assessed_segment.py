"""A segment of a recording as it was assessed, with all that its validity is judged by."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.scoring.planned_test import PlannedTest
from app.scoring.segments import Segment
from app.telemetry.recording import Recording
from app.telemetry.traces import Traces
from core.monitor import Assessments, Monitor
from core.types import Array, Flags


@dataclass(frozen=True, eq=False)
class AssessedSegment:
    """A segment of a recording as a monitor assessed it.

    traces: repaired.   y: (n, 6) from trim, NaN where not recorded.   y_read: (n, 6) the same, 0 in
    channels that the monitor does not read.   needed: (6,) channels.   repeats: rows for which each
    value of a channel is repeated, by a recorder that is faster than its sensor.
    """

    monitor: Monitor
    planned: PlannedTest
    traces: Traces
    recording: Recording
    segment: Segment
    needed: Flags
    y: Array
    y_read: Array
    assessments: Assessments
    repeats: Mapping[str, int]

    @cached_property
    def n_counted(self) -> int:
        """Samples up to the first that exceeds a limit, all where none does: those judged."""
        last = self.monitor.last_counted(self.y_read)
        return len(self.y) if last is None else last + 1

    @cached_property
    def largest(self) -> Array:
        """(6,) largest magnitude of each channel from trim; -inf where it is not recorded."""
        return largest(self.y)


def largest(y: Array) -> Array:
    """(6,) largest magnitude of each column of y (n, 6), NaN left out; -inf where all are."""
    return np.abs(y).max(axis=0, initial=-np.inf, where=np.isfinite(y))
