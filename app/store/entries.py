"""What the store says of each thing it keeps: everything but the arrays.

Times are UTC in ISO 8601; recipes are plain data as in `app.recipes`.
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from app.store.peaks import PeakHistogram
from core.types import Array, Flags, Indices

JobStatus = Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
MappingState = Literal["proposed", "remembered", "confirmed"]
MarkerKind = Literal["note", "marker"]
ENDED: tuple[JobStatus, ...] = ("done", "failed", "cancelled", "interrupted")


@dataclass(frozen=True)
class DatasetInfo:
    """A stored dataset.

    digest: SHA-256 of what a monitor can learn from it.   dt: sample interval [s].
    n_safe: safe rollouts kept, of the n_safe_met met.   n_samples: of each rollout.
    n_obs: observation times of each safe rollout.
    unsafe_rate: share of unsafe rollouts, None where too few were met to say.
    peaks: one histogram for each limited channel; none where the specification has no limits.
    """

    id: str
    name: str
    created: str
    digest: str
    seed: int | None
    version: str
    recipe: dict[str, Any]
    dt: float
    n_unsafe: int
    n_safe: int
    n_safe_met: int
    n_samples: int
    n_obs: int
    unsafe_rate: float | None
    theta_names: tuple[str, ...]
    peaks: tuple[PeakHistogram, ...]


@dataclass(frozen=True)
class MonitorInfo:
    """A stored monitor.

    digest: SHA-256 of its portable file.   dataset_id: None where its dataset is not stored here.
    dt: sample interval [s].   h: lead [samples].   lead: lead in effect [s].
    n_unsafe: failures it is calibrated on, n_early of them before any warning could come.
    epsilon: of its recipe.
    support: fresh flights that its validity is calibrated on, n_safe and n_unsafe, and the level at
    which they are wrongly called invalid; None where it is not calibrated.
    """

    id: str
    name: str
    created: str
    digest: str
    dataset_id: str | None
    dataset_digest: str
    dataset_recipe: dict[str, Any]
    recipe: dict[str, Any]
    seed: int | None
    version: str
    dt: float
    h: int
    lead: float
    n_unsafe: int
    n_early: int
    smallest_epsilon: float
    epsilon: float
    support: dict[str, Any] | None


@dataclass(frozen=True)
class JobInfo:
    """A long piece of work. progress of total, in the job's own units; None until it says."""

    id: str
    kind: str
    request: dict[str, Any]
    status: JobStatus
    progress: float | None
    total: float | None
    message: str
    result: Any
    error: Any
    created: str
    started: str | None
    ended: str | None


@dataclass(frozen=True)
class FlightInfo:
    """A run of a source through a monitor.

    status: `running`, `interrupted`, or the word it was ended with.
    head: last sample number stored, None where there is none.
    """

    id: str
    source: dict[str, Any]
    monitor_id: str
    epsilon: float
    status: str
    created: str
    ended: str | None
    head: int | None


@dataclass(frozen=True)
class Alarm:
    """A latched alert. number: 1, 2, ... in its flight.   seq, t: sample number, time [s]."""

    id: str
    flight_id: str
    number: int
    seq: int
    t: float
    p_value: float | None
    raised: str
    acknowledged: str | None
    by: str | None


@dataclass(frozen=True)
class RecordingInfo:
    """An uploaded recording, without what its columns are taken for.

    size: of the file [bytes].   digest: SHA-256 of the file.   format: key of FORMATS.
    duration: of the mapped channels [s], None where the mapping cannot be applied.
    """

    id: str
    name: str
    created: str
    size: int
    digest: str
    format: str
    aircraft: str | None
    duration: float | None
    mapping_state: MappingState
    n_scorings: int


@dataclass(frozen=True)
class MappedColumns:
    """What the columns of a recording are taken for, as plain data.

    mapping: of app.telemetry.mapping.mapping.
    proposal: why it was proposed, and what else could be.
    quality: of the times and channels so mapped.   problem: why it cannot be applied.
    duration: [s].   statistics: [n, missing, min, max, mean] of each signal.
    """

    mapping: dict[str, Any]
    mapping_state: MappingState
    proposal: dict[str, Any]
    quality: dict[str, Any] | None
    problem: str | None
    duration: float | None
    statistics: list[list[float | None]]


@dataclass(frozen=True)
class RememberedMapping:
    """A mapping that was confirmed, and for which aircraft; "" where none was said."""

    aircraft: str
    mapping: dict[str, Any]


@dataclass(frozen=True)
class ScoringInfo:
    """A recording as a monitor scored it, without the samples.

    digest: SHA-256 of the samples.   order_digest: of all that decides them.
    specification: the limits the monitor warns of.   stretches: one manoeuvre each.
    outside: limits reached in none of them, as a stretch's crossing.
    lead, dt, start, end: [s].
    """

    id: str
    recording_id: str
    monitor_id: str
    monitor_name: str
    monitor_digest: str
    specification: dict[str, Any]
    order_digest: str
    digest: str
    created: str
    version: str
    epsilon: float
    lead: float
    dt: float
    order: dict[str, Any]
    mapping: dict[str, Any]
    n_samples: int
    start: float
    end: float
    notes: list[str]
    quality: dict[str, Any] | None
    stretches: list[dict[str, Any]]
    outside: list[dict[str, Any]]


@dataclass(frozen=True)
class Marker:
    """A remark on a moment of a recording, or on a stretch where `end` is given. t, end: [s]."""

    id: str
    created: str
    kind: MarkerKind
    t: float
    end: float | None
    text: str


@dataclass(frozen=True, eq=False)
class StoredAssessments:
    """Assessments of a stretch of a flight, one array a field.

    seq: (n,) sample numbers, ascending; a gap is a sample that was never stored.   t: (n,) [s].
    y: (n, 6) the samples themselves.   p_value: (n,), NaN where there is none.
    alert: (n,) bool.   state: (n,) codes into core.monitor.assessment.STATES.
    y_hat: (n, 6), NaN where there is no forecast.   reasons: (n,) why a sample was not assessed.
    """

    seq: Indices
    t: Array
    y: Array
    p_value: Array
    alert: Flags
    state: npt.NDArray[np.uint8]
    y_hat: Array
    reasons: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.seq)


class StoredRollout(NamedTuple):
    """One rollout of a dataset.

    y: (k, 6), up to and with the failure sample.   theta: its parameters by name.
    fail_index: the failure sample, None for a safe rollout.
    """

    y: Array
    theta: dict[str, float]
    fail_index: int | None
