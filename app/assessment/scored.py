"""A scored recording: one table of samples, and a verdict on each manoeuvre."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from app.assessment.outcome import Outcome, RecordedExceedance
from app.telemetry.timing.quality import Quality
from core.clearance.sensors import SensorCheck
from core.monitor import Monitor

Level = tuple[float, float]
"""Accepted miss rate, and the risk above which a sample alerts."""
BETWEEN = -1
"""Manoeuvre number of samples between manoeuvres."""


def sample_type(n_channels: int) -> np.dtype:
    """Type of a scored sample.

    t: [s].   y: from trim, as assessed, as recorded where its trim is unknown, NaN where not
    recorded.   p_value: NaN unless state is `ok`.   withdrawn: p-value where the monitor was not
    applicable, NaN elsewhere.   alert: false unless state is `ok`.   state: index into
    core.monitor.assessment.STATES.   manoeuvre: number, or BETWEEN.   y_hat: forecast, NaN without
    one.   attitude: phi, theta, psi [rad], NaN where not recorded.   trim: that y is measured from,
    NaN where unknown.
    """
    return np.dtype(
        [
            ("t", "<f8"),
            ("y", "<f8", (n_channels,)),
            ("p_value", "<f8"),
            ("withdrawn", "<f8"),
            ("alert", "?"),
            ("state", "u1"),
            ("manoeuvre", "<i2"),
            ("y_hat", "<f8", (n_channels,)),
            ("attitude", "<f8", (3,)),
            ("trim", "<f8", (n_channels,)),
        ]
    )


BLOCK = 4096
"""Rows that fit in a processor's cache."""
MOST_MANOEUVRES = int(np.iinfo(np.int16).max)


@dataclass(frozen=True)
class Check:
    """One validity check. ok: None where unknown."""

    name: str
    ok: bool | None
    text: str


@dataclass(frozen=True)
class Validity:
    """Whether the monitor was applicable to a manoeuvre.

    valid: False where a check failed. None where validity is not calibrated or cannot be judged, or
    too few samples were assessed; the guarantee does not apply then either.
    p_value: of a deviation this large in a flight like the simulated ones, residual and distance
    together; residual_p, distance_p: of each alone; None without one.
    reasons: why valid is not True.
    """

    valid: bool | None
    p_value: float | None = None
    residual_p: float | None = None
    distance_p: float | None = None
    reasons: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()


@dataclass(frozen=True)
class ScoredManoeuvre:
    """One manoeuvre and its outcome.

    start, end: [s], with the trim segment before it.   begins: with its first input, as in flight
    [s]; None for one that was not detected.   first, last: numbers of its samples, both included.
    trim: subtracted from each channel, in order; None where unknown.
    peak_risk, peak_t: largest p-value and its time [s]; None where nothing was assessed, the time
    also where no p-value exceeds the smallest possible one.
    alerts: first and last time of each run of alerts [s].
    exceedance: the first recorded sample that exceeds a limit, from trim.
    recorded_exceedance: without one, the first that exceeds it as recorded, with bias and trim;
    else the first that no aircraft can reach, or one as recorded that is earlier.
    lead: from the first alert to the exceedance [s], in a live flight from when it was shown; None
    where either is missing.   promised: lead time in effect [s].
    look_ahead: how long a sample waits for later ones in flight [s]; alerts come this much later.
    withdrawn_t: time from which the monitor is withdrawn to the end [s]; None if it is not.
    withdrawn_reason: as the flight gives it then; the p-values of `validity` are of the whole.
    limits_in_force: of a limit set, in plain data, see InForceTimeline.intervals. They decide what
    an exceedance is; where they differ from the monitor's, it is not applicable.
    worst, worst_recorded: of each channel that exceeds a limit, see Limited.
    own_exceedance: of the monitor's own limits, where others were in force.
    amplitude: largest deflection as a share of the planned one; None where unknown.
    remarks: what limits the verdict.   guarantee: what is guaranteed, or why nothing is.
    monitor, alert_above: name of the monitor in use of a set, and the risk above which it alerts;
    empty and None for a scoring by one monitor.
    """

    name: str
    start: float
    end: float
    first: int
    last: int
    trim: tuple[float | None, ...]
    validity: Validity
    outcome: Outcome
    guarantee: str
    peak_risk: float | None = None
    peak_t: float | None = None
    alerts: tuple[tuple[float, float], ...] = ()
    exceedance: RecordedExceedance | None = None
    lead: float | None = None
    look_ahead: float = 0.0
    withdrawn_t: float | None = None
    remarks: tuple[str, ...] = ()
    amplitude: float | None = None
    recorded_exceedance: RecordedExceedance | None = None
    withdrawn_reason: str = ""
    limits_in_force: tuple[dict[str, Any], ...] = ()
    own_exceedance: RecordedExceedance | None = None
    monitor: str = ""
    alert_above: float | None = None
    worst: tuple[RecordedExceedance, ...] = ()
    begins: float | None = None
    worst_recorded: tuple[RecordedExceedance, ...] = ()
    promised: float | None = None


@dataclass(frozen=True, eq=False)
class ScoredRecording:
    """A recording scored by a monitor.

    samples: (n,) of sample_type, one each dt [s].   notes: assumptions and steps, oldest first.
    alert_above: risk above which a sample alerts.
    quality: of the recorded times and channels.
    outside_exceedances: first recorded sample of each exceedance that begins in no manoeuvre.
    compatibility: whether the sensors agree.
    limits_in_force: over the whole recording, as in ScoredManoeuvre; None without a limit set.
    """

    samples: npt.NDArray[np.void]
    manoeuvres: tuple[ScoredManoeuvre, ...]
    dt: float
    epsilon: float
    alert_above: float
    quality: Quality
    notes: tuple[str, ...] = field(default=())
    outside_exceedances: tuple[RecordedExceedance, ...] = ()
    compatibility: tuple[SensorCheck, ...] = ()
    limits_in_force: tuple[dict[str, Any], ...] | None = None


def level_of(monitor: Monitor, epsilon: float | None) -> Level:
    """A miss rate, None for the monitor's own, and its alert threshold. ValueError."""
    epsilon = monitor.check_epsilon(epsilon)
    return epsilon, monitor.alert_above(epsilon)
