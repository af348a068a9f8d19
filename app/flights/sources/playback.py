"""What a seekable flight plays: each sample, and what the monitor says of it.

Whatever the transport does, a sample has the history of the flight, not that of the jump.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from app.flights.exceedance import exceedance
from app.flights.sources.track import Track
from app.messages import MeasuredExceedance
from app.scoring.limits_in_force import InForceFrom, Ruling
from core.monitor import Assessment, Monitor
from core.monitor.peak_forecast import Ahead, RunningForecast
from core.monitor.validity.verdict import exceeds
from core.types import Array, Flags, Indices

MOST_FOLLOWED = 1_000
"""Samples that a forecast of the rest is brought up to date by at once: some 30 ms."""
Angles = tuple[float, float, float]
"""Bank, pitch and heading [rad]."""


class Script(ABC):
    """A flight to play.

    t: (n,) rising [s].   dt: sample interval [s].   theta: parameters of a simulated aircraft.
    fail_t: when it exceeds a limit, if known [s].   is_checked: whether it was asked if the flight
    is like those that its monitor was trained on.   alerts, exceedances: rising, samples at which
    an alert or a measured exceedance begins.   shows_rulings: whether it says which limits held for
    each sample when it was flown.   delay: that a live flight stated [s], by
    which its lead is less than the monitor's.   manoeuvres: plain, of a scored recording.
    """

    t: Array
    dt: float
    is_checked: bool
    alerts: Indices
    exceedances: Indices
    shows_rulings: bool = False
    delay: float = 0.0
    theta: dict[str, float] | None = None
    fail_t: float | None = None
    manoeuvres: Sequence[Mapping[str, Any]] | None = None

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.t[-1] - self.t[0])

    @abstractmethod
    def y(self, k: int) -> Array:
        """Sample k, (6,)."""

    @abstractmethod
    def attitude(self, k: int) -> Angles:
        """Bank, pitch and heading at sample k [rad]."""

    @abstractmethod
    def assessment(self, k: int) -> Assessment:
        """What the monitor says of sample k."""

    def display(self, k: int) -> tuple[Assessment, ...]:
        """What the monitors say of sample k that are flown for display."""
        return ()

    def forecast_ahead(self, k: int) -> Ahead | None:
        """What the monitor forecast of the rest of the card by sample k; None where none is known.

        k: of a sample that is `ok`.
        """
        return None

    def ruling(self, k: int) -> Ruling | None:
        """Which limits held for sample k when it was flown; None where it was not, or its own."""
        return None

    def held_until(self, k: int) -> list[InForceFrom]:
        """Which limits held for the samples up to k when they were flown; empty where its own."""
        return []

    def exceeding(self, limits: Array | None) -> Indices:
        """Samples at which an exceedance of limits begins. limits: (6,), None for none known."""
        n = len(self.t)
        over = (k for k in range(n) if self.exceedance(k, limits) is not None)
        return onsets(_flags(over, n))

    def late(self, k: int) -> str:
        """Why sample k was not of now when it was shown; empty where it was."""
        return ""

    def stale_after(self, k: int) -> float | None:
        """How long after sample k its source was stale [s]; None where it was not before the next.

        k: -1 before the first.
        """
        return None

    def next_alert(self, k: int) -> int | None:
        """First sample after k at which an alert begins."""
        later = self.alerts[self.alerts > k]
        return int(later[0]) if len(later) else None

    def recorded(self, k: int) -> Array:
        """Sample k before its trim was subtracted, (6,); as it is where nothing was."""
        return self.y(k)

    def exceedance(self, k: int, limits: Array | None) -> MeasuredExceedance | None:
        """Which limit sample k exceeds. limits: (6,), None where they are not known."""
        return exceedance(limits, self.y(k), self.recorded(k))


class FollowedForecast:
    """The forecast of the rest of a card, brought up to any sample of a flight that is stored.

    sample: number to time [s], outputs (6,) as the monitor reads them, and code of its state.
    """

    def __init__(self, monitor: Monitor, sample: Callable[[int], tuple[float, Array, int]]) -> None:
        self._forecast, self._dt, self._sample = monitor.forecast, monitor.dt, sample
        self._first = self._followed = -1
        self._running: RunningForecast | None = None

    def ahead(self, k: int, first: int = 0) -> Ahead | None:
        """The rest by sample k, which is `ok`.   first: sample with which its manoeuvre began.

        After a far seek nothing is known until it has followed, a part with each call.
        """
        if self._forecast is None:
            return None
        if self._running is None or first != self._first or k < self._followed:
            self._running = self._forecast.start(self._dt)
            self._first, self._followed = first, first - 1
        until = min(k, self._followed + MOST_FOLLOWED)
        for at in range(self._followed + 1, until + 1):
            t, y, code = self._sample(at)
            self._running.update(t, np.ascontiguousarray(y, np.float64), code)
        self._followed = until
        return self._running.ahead() if until == k else None


class AssessedTrack(Script):
    """A track through a monitor, assessed and judged whole; slow to make, for a thread.

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
        if track.fail_index is not None:
            self.fail_t = float(track.t[track.fail_index])
        self._track = track
        self._assessments = monitor.assess(track.t, track.y, epsilon)
        self._followed = FollowedForecast(monitor, self._followed_sample)
        self._display = [one.assess(track.t, track.y, at) for one, at in display]
        self.alerts = onsets(self._assessments.alert)
        self.exceedances = self.exceeding(monitor.limits)
        self.is_checked = monitor.support is not None

    def y(self, k: int) -> Array:
        """Sample k, (6,)."""
        return self._track.y[k]

    def attitude(self, k: int) -> Angles:
        """Bank, pitch and heading at sample k [rad]."""
        phi, theta, psi = self._track.attitude[k].tolist()
        return phi, theta, psi

    def assessment(self, k: int) -> Assessment:
        """What the batch says of sample k."""
        return self._assessments[k]

    def forecast_ahead(self, k: int) -> Ahead | None:
        """The rest of the card, by the samples since the last one asked for."""
        return self._followed.ahead(k)

    def _followed_sample(self, k: int) -> tuple[float, Array, int]:
        return float(self.t[k]), self._track.y[k], int(self._assessments.state[k])

    def display(self, k: int) -> tuple[Assessment, ...]:
        """What each batch says of sample k."""
        return tuple(assessments[k] for assessments in self._display)

    def exceeding(self, limits: Array | None) -> Indices:
        """Samples at which an exceedance begins, of the whole track at once."""
        if limits is None:
            return np.empty(0, np.int64)
        return onsets(exceeds(limits, self._track.y))


def _flags(active: Iterable[int], n: int) -> Flags:
    flags = np.zeros(n, bool)
    flags[list(active)] = True
    return flags


def onsets(active: Flags) -> Indices:
    """Samples at which something begins. active: (n,)."""
    return np.flatnonzero(active & ~np.concatenate([[False], active[:-1]]))
