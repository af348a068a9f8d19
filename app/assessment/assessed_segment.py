"""An assessed segment of a recording, with everything the validity checks need."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.assessment.planned_test import PlannedTest
from app.assessment.segments import Segment
from app.telemetry.recording import Recording, Traces
from core.monitor import Assessments, Monitor
from core.types import Array, Flags


@dataclass(frozen=True, eq=False)
class AssessedSegment:
    """A segment of a recording and the monitor's assessments of it.

    traces: repaired.   trim: (6,), NaN where unknown.   y: (n, 6) from trim, NaN where not
    recorded, with the samples before a manoeuvre that fill the history; n_history of them.
    y_read: (n, 6) the same, 0 in unknown channels that the monitor does not read.   streamed: their
    assessments.   needed: (6,) channels the monitor reads.
    repeats: by channel, how many rows repeat each value (the recorder is faster than the sensor).
    """

    monitor: Monitor
    planned: PlannedTest
    traces: Traces
    recording: Recording
    segment: Segment
    needed: Flags
    trim: Array
    y: Array
    y_read: Array
    streamed: Assessments
    n_history: int
    repeats: Mapping[str, int]

    @cached_property
    def assessments(self) -> Assessments:
        """Those of the segment itself."""
        return self.streamed.from_sample(self.n_history)

    @cached_property
    def counted(self) -> Assessments:
        """Those up to and including the first exceedance; all of them if there is none."""
        last = self.monitor.last_counted(self.y_read[self.n_history :])
        return self.assessments if last is None else self.assessments.from_sample(0, last + 1)

    @cached_property
    def largest(self) -> Array:
        """(6,) largest magnitude of each channel from trim; -inf where not recorded."""
        return largest(self.y)


def largest(y: Array) -> Array:
    """(6,) largest magnitude of each column of y (n, 6), ignoring NaN; -inf if all are NaN."""
    return np.abs(y).max(axis=0, initial=-np.inf, where=np.isfinite(y))
