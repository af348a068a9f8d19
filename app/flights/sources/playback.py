"""What a seekable flight plays: each sample with its assessment.

An assessment uses the history in the source, whatever the transport did before.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
import numpy.typing as npt

from app.assessment.grid import Angles, IntegratedAngles
from app.assessment.input_checks import Doubt
from app.assessment.planned_test import input_of, known_test, needed_channels
from app.assessment.rulings import InForceFrom, Ruling
from app.assessment.scorer import ReceivedExceedance
from app.flights.planned_card import first_input
from app.flights.sources.simulated import Track
from app.recordings.scoring_answers import stored_assessment
from core.channels import LATERAL
from core.flight_events import TrimChange
from core.limits.exceedance import Exceeded, exceeded_at
from core.limits.limits import Envelope
from core.monitor import Assessment, Monitor, State
from core.monitor.assessment import STATES, Cause, code_of
from core.monitor.peak_forecast import Ahead, RunningForecast
from core.types import Array, Flags, Indices

MOST_FOLLOWED = 1_000
"""Most samples per call by which a forecast catches up: about 30 ms."""


class Script(ABC):
    """A flight to play.

    t: (n,) rising [s].   dt: sample interval [s].   theta: parameters of a simulated aircraft.
    fail_t: time at which it exceeds a limit, if known [s].   is_checked: whether its monitor's
    validity is calibrated.   alerts, exceedances: rising, samples at which an alert or a measured
    exceedance begins.   shows_rulings: whether it knows the limits in force when it was flown.
    delay: stated delay of a live flight [s], subtracted from the monitor's lead.
    manoeuvres: plain, of a scored recording.   keys: of the channels.   near: see Exceedances.
    planned: (n, 3) attitude of
    the planned flight at each sample [rad]; None, and why in `no_plan`.   begun: times of the first
    input of each manoeuvre [s].   trims: see Flight.trims.
    """

    keys: Sequence[str] = LATERAL.keys
    t: Array
    dt: float
    is_checked: bool
    alerts: Indices
    exceedances: Indices
    shows_rulings: bool = False
    near: float = 0.0
    delay: float = 0.0
    theta: dict[str, float] | None = None
    fail_t: float | None = None
    manoeuvres: Sequence[Mapping[str, Any]] | None = None
    planned: Array | None = None
    no_plan: str = "a recording has no planned flight to the same times"
    begun: Sequence[float] = ()
    trims: list[TrimChange] | None = None
    _followed: "FollowedForecast | None" = None

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.t[-1] - self.t[0])

    @abstractmethod
    def y(self, k: int) -> Array:
        """Sample k, (n_channels,)."""

    @abstractmethod
    def attitude(self, k: int) -> Angles:
        """Bank, pitch and heading at sample k [rad]."""

    @abstractmethod
    def assessment(self, k: int) -> Assessment:
        """Assessment of sample k."""

    def display(self, k: int) -> tuple[Assessment, ...]:
        return ()

    def forecast_ahead(self, k: int) -> Ahead | None:
        """Forecast of the rest of the card by sample k, which is `ok`; None if there is none."""
        first = self._first_of_card(k)
        return None if self._followed is None or first is None else self._followed.ahead(k, first)

    def _first_of_card(self, k: int) -> int | None:
        """First sample of the test card that sample k is part of."""
        return 0

    def ruling(self, k: int) -> Ruling | None:
        """Limits in force for sample k when it was flown; None for the monitor's own."""
        return None

    def held_until(self, k: int) -> list[InForceFrom]:
        """Limits in force for the samples up to k when flown; empty for the monitor's own."""
        return []

    @abstractmethod
    def exceeding(self, limits: Envelope | None) -> Indices:
        """Samples at which an exceedance begins. limits: None if unknown."""

    def late(self, k: int) -> str:
        """Why sample k was late when it was shown; empty if it was not."""
        return ""

    def stale_after(self, k: int) -> float | None:
        """Time after sample k at which the source became stale [s]; None if it did not.

        k: -1 before the first sample.
        """
        return None

    def doubts(self, k: int) -> tuple[Doubt, ...]:
        """Why sample k was no picture of the aircraft when it was shown."""
        return ()

    def next_alert(self, k: int) -> int | None:
        """First sample after k at which an alert begins; None if there is none."""
        later = self.alerts[self.alerts > k]
        return int(later[0]) if len(later) else None

    def recorded(self, k: int) -> Array:
        """Sample k including trim, (n_channels,)."""
        return self.y(k)

    def far(self, k: int) -> Mapping[str, int]:
        """Channels whose trim at sample k is a notable share of their limit, see TrimCheck."""
        return {}

    def manoeuvre(self, k: int) -> int:
        """Number of the manoeuvre that sample k is part of, 0 for none or where not known."""
        return 0

    def arrived(self, k: int) -> float | None:
        """When sample k of a live flight was shown in it, see Alarm."""
        return None

    def judged(self, k: int) -> Array:
        """Sample k from trim, (n_channels,), NaN where that is unknown."""
        return self.y(k)

    def received(self, k: int, limits: Envelope | None) -> Sequence[ReceivedExceedance]:
        """Received samples beyond a limit since sample k - 1 was shown, up to sample k.

        limits: in force; None if unknown.
        """
        return ()

    def exceeded(self, k: int, limits: Envelope | None) -> Exceeded | None:
        """The limit that sample k exceeds, or one received before it. limits: None if unknown.

        The sensor's own sample gives an exceedance its time and value.
        """
        received = [sample.exceeded(self.keys) for sample in self.received(k, limits)]
        if received:
            return min(received, key=attrgetter("t"))
        samples = self.judged(k), self.recorded(k)
        return exceeded_at(float(self.t[k]), self.keys, limits, *samples)


class FollowedForecast:
    """The forecast of the rest of a card, at any sample of a stored flight.

    sample: number -> time [s], outputs (n_channels,) as the monitor reads them, and state code.
    """

    def __init__(self, monitor: Monitor, sample: Callable[[int], tuple[float, Array, int]]) -> None:
        self._forecast, self._dt, self._sample = monitor.forecast, monitor.dt, sample
        self._first = self._followed = -1
        self._running: RunningForecast | None = None

    def ahead(self, k: int, first: int) -> Ahead | None:
        """Forecast by sample k, which is `ok`.   first: first sample of its manoeuvre.

        After a long seek it returns None until several calls have caught up.
        """
        if self._forecast is None:
            return None
        if self._running is None or first != self._first or k < self._followed:
            self._running = self._forecast.start(self._dt)
            self._first, self._followed = first, first - 1
        until = min(k, self._followed + MOST_FOLLOWED)
        for at in range(self._followed + 1, until + 1):
            t, y, code = self._sample(at)
            self._running.update(t, np.ascontiguousarray(y, np.float64), code, np.nan)
        self._followed = until
        return self._running.ahead() if until == k else None


class StoredScript(Script):
    """Samples with stored assessments.

    samples: (n,) with t, y, p_value, alert, state and y_hat.   forecasts: whether y_hat is known.
    """

    def __init__(self, samples: npt.NDArray, dt: float, forecasts: bool) -> None:
        self.samples, self.dt, self._forecasts = samples, dt, forecasts

    def y(self, k: int) -> Array:
        """Sample k as assessed, from trim, (n_channels,)."""
        return self.samples["y"][k]

    def assessment(self, k: int) -> Assessment:
        sample = self.samples[k]
        y_hat = sample["y_hat"] if self._forecasts else None
        reason = "" if STATES[sample["state"]] is State.OK else self._reason(k)
        return stored_assessment(sample["t"], sample, reason, y_hat, self._cause(k))

    @abstractmethod
    def _reason(self, k: int) -> str:
        """Why sample k was not assessed."""

    def _cause(self, k: int) -> Cause | None:
        """In one word; None where only the reason tells."""
        return None

    def _of_card(self, k: int) -> Array:
        """Sample k from the trim of the followed card, (n_channels,)."""
        return self.y(k)

    def _follow(self, monitor: Monitor) -> None:
        self.keys, self._needed = monitor.dictionary.keys, needed_channels(monitor)
        self._followed = FollowedForecast(monitor, self._followed_sample)

    def _followed_sample(self, k: int) -> tuple[float, Array, int]:
        """Sample k, also if the limits in force withdrew its assessment."""
        y, code = input_of(self._of_card(k), self._needed), int(self.samples["state"][k])
        if STATES[code] is State.INVALID and np.isfinite(y).all():
            code = code_of(State.OK)
        return float(self.samples["t"][k]), y, code


class AssessedTrack(Script):
    """A track, assessed as a whole; slow to make, for a thread.

    display: further monitors, each with its epsilon.
    """

    def __init__(
        self,
        track: Track,
        monitor: Monitor,
        epsilon: float,
        display: Iterable[tuple[Monitor, float]] = (),
    ) -> None:
        self.t, self.dt, self.theta = track.t, track.dt, track.theta
        self.keys = monitor.dictionary.keys
        if track.fail_index is not None:
            self.fail_t = float(track.t[track.fail_index])
        self._track, self.planned = track, track.planned
        self.no_plan = "" if track.planned is not None else "this test has no simulated plan"
        onset = first_input(track.y, known_test(monitor))
        self.begun = [] if onset is None else [float(track.t[onset])]
        self._assessments = monitor.assess(track.t, track.y, epsilon)
        self._followed = FollowedForecast(monitor, self._followed_sample)
        self._display = [shown.assess(track.t, track.y, epsilon) for shown, epsilon in display]
        self.alerts = onsets(self._assessments.alert)
        self.exceedances = self.exceeding(monitor.envelope)
        self.is_checked = monitor.support is not None

    def y(self, k: int) -> Array:
        return self._track.y[k]

    def attitude(self, k: int) -> Angles:
        phi, theta, psi = self._track.attitude[k].tolist()
        is_integrated = self.keys == LATERAL.keys
        return IntegratedAngles(phi, theta, psi) if is_integrated else (phi, theta, psi)

    def assessment(self, k: int) -> Assessment:
        return self._assessments[k]

    def _followed_sample(self, k: int) -> tuple[float, Array, int]:
        return float(self.t[k]), self._track.y[k], int(self._assessments.state[k])

    def display(self, k: int) -> tuple[Assessment, ...]:
        return tuple(assessments[k] for assessments in self._display)

    def exceeding(self, limits: Envelope | None) -> Indices:
        if limits is None:
            return np.empty(0, np.int64)
        return onsets(limits.exceeds(self._track.y))


def onsets(active: Flags) -> Indices:
    """Samples at which a condition begins. active: (n,)."""
    return np.flatnonzero(active & ~np.concatenate([[False], active[:-1]]))
