"""What the store says of each thing it keeps: everything but the arrays.

Times are UTC in ISO 8601; recipes are plain data as in `app.recipes`.
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from app.peaks import PeakHistogram

Array = npt.NDArray[np.float64]

JobStatus = Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
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


@dataclass(frozen=True, eq=False)
class StoredAssessments:
    """Assessments of a stretch of a flight, one array a field.

    seq: (n,) sample numbers, ascending; a gap is a sample that was never stored.   t: (n,) [s].
    y: (n, 6) the samples themselves.   p_value: (n,), NaN where there is none.
    alert: (n,) bool.   state: (n,) codes into core.monitor.assessment.STATES.
    y_hat: (n, 6), NaN where there is no forecast.
    """

    seq: npt.NDArray[np.int64]
    t: Array
    y: Array
    p_value: Array
    alert: npt.NDArray[np.bool_]
    state: npt.NDArray[np.uint8]
    y_hat: Array

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
