"""A scored recording: its samples as one table, and a verdict on each manoeuvre."""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from app.scoring.outcome import Outcome, RecordedExceedance, exceedance_verdict
from app.telemetry.timing.quality import Quality
from core.compatibility import SensorCheck

BETWEEN = -1
"""Segment of a sample that lies in none: between manoeuvres."""
SAMPLE = np.dtype(
    [
        ("t", "<f8"),
        ("y", "<f8", 6),
        ("p_value", "<f8"),
        ("withdrawn", "<f8"),
        ("alert", "?"),
        ("state", "u1"),
        ("manoeuvre", "<i2"),
        ("y_hat", "<f8", 6),
        ("attitude", "<f8", 3),
    ]
)
"""A scored sample.

t: [s].   y: from trim, as assessed; NaN where it was not recorded; between manoeuvres, from the
trim of the one before.   p_value: NaN unless state is `ok`.   withdrawn: the p-value of a sample
where the monitor was not applicable, NaN elsewhere.   alert: false unless state is `ok`.
state: code into core.monitor.assessment.STATES.   manoeuvre: number of its manoeuvre, or BETWEEN.
y_hat: forecast, NaN where there is none.   attitude: phi, theta, psi [rad], NaN where not recorded.
"""
OBSERVATIONS = "observations within training"
"""Name of the check that only calibration can make."""
BLOCK = 4096
"""Rows that a processor's cache holds."""
MOST_MANOEUVRES = int(np.iinfo(np.int16).max)


@dataclass(frozen=True)
class Check:
    """One condition of applicability. ok: None where it is not known."""

    name: str
    ok: bool | None
    text: str


@dataclass(frozen=True)
class Validity:
    """Whether the monitor was applicable to a manoeuvre.

    valid: False where a check failed; None where its validity is not calibrated or was not to be
    judged, or too few samples could be assessed; and then nothing is promised either.
    p_value: that a flight like the simulated ones deviates so far, of the residual and the distance
    together; residual_p, distance_p: of each; None where there is none.
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
    """One manoeuvre and what came of it.

    start, end: [s].   first, last: numbers of its samples, both included.
    trim: what was subtracted of each channel, in order; None where it is unknown.
    peak_risk, peak_t: largest p-value and its time [s]; None where nothing was assessed.
    alerts: first and last time of each run of alerts [s].
    exceedance: the first recorded sample that exceeds a limit, from trim.
    recorded_exceedance: where there is none, the first that does as recorded, bias and trim in it.
    lead: from the first alert to the exceedance [s]; None where one of them is missing.
    look_ahead: how far resampling let its samples look into the future [s]: in flight an alert
    could come so much later; 0 where they are as recorded.
    withdrawn_t: first sample of which nothing is said any more [s]; None where there is none.
    withdrawn_reason: why, by what was known at that time; `validity` is of the whole manoeuvre.
    limits_in_force: those of a limit set, in plain data, see HeldLimits.intervals; by them an
    exceedance is judged, and nothing is said where they are others than the monitor's.
    own_exceedance: of the monitor's own limits, where others were in force meanwhile.
    amplitude: largest deflection as a share of the planned; None where that is not known.
    remarks: what limits the verdict.   guarantee: what is promised, or that nothing is.
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

    @property
    def exceedance_verdict(self) -> str:
        """What came of an exceedance; "" where there was none."""
        exceeded, recorded = (
            each is not None for each in (self.exceedance, self.recorded_exceedance)
        )
        return exceedance_verdict(self.outcome, self.lead, exceeded=exceeded, recorded=recorded)

    def to_plain(self) -> dict[str, Any]:
        """Return JSON's types."""
        plain = asdict(self)
        plain["validity"]["reasons"] = list(self.validity.reasons)
        plain["validity"]["checks"] = [asdict(check) for check in self.validity.checks]
        names = "trim", "remarks", "limits_in_force"
        lists = {name: list(getattr(self, name)) for name in names}
        return plain | lists | {"alerts": [list(run) for run in self.alerts]}


@dataclass(frozen=True, eq=False)
class ScoredRecording:
    """A recording as a monitor scored it.

    samples: (n,) of SAMPLE, one each dt [s].   notes: what was assumed and done, oldest first.
    alert_above: risk above which a sample alerts.
    quality: of the recorded times and channels.
    outside_exceedances: those that begin in no manoeuvre, by their first recorded sample.
    compatibility: whether its sensors agree.
    limits_in_force: over the whole recording, as in ScoredManoeuvre; None where no limit set was.
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
