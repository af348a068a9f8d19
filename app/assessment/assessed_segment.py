"""An assessed segment of a recording, with everything the validity checks need."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.assessment.planned_test import PlannedTest
from app.assessment.segments import Segment
from app.telemetry.recording import Recording
from app.telemetry.traces import Traces
from core.monitor import Assessments, Monitor
from core.types import Array, Flags


@dataclass(frozen=True, eq=False)
class AssessedSegment:
    """A segment of a recording and the monitor's assessments of it.

    traces: repaired.   y: (n, 6) from trim, NaN where not recorded.   y_read: (n, 6) the same, 0 in
    channels that the monitor does not read.   needed: (6,) channels the monitor reads.
    repeats: by channel, how many rows repeat each value (the recorder is faster than the sensor).
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
        """Samples up to and including the first exceedance; all of them if there is none."""
        last = self.monitor.last_counted(self.y_read)
        return len(self.y) if last is None else last + 1

    @cached_property
    def largest(self) -> Array:
        """(6,) largest magnitude of each channel from trim; -inf where not recorded."""
        return largest(self.y)


def largest(y: Array) -> Array:
    """(6,) largest magnitude of each column of y (n, 6), ignoring NaN; -inf if all are NaN."""
    return np.abs(y).max(axis=0, initial=-np.inf, where=np.isfinite(y))
