"""What a seekable flight plays: each sample, and what the monitor says of it.

Whatever the transport does, a sample has the history of the flight, not that of the jump.
"""

from abc import ABC, abstractmethod

import numpy as np

from app.flights.sources import Array, Track
from app.flights.withdrawal import withdrawal, withdrawn
from core.monitor import Assessment, Monitor, State
from core.monitor.assessment import REASONS, STATES

Angles = tuple[float, float, float]
"""Bank, pitch and heading [rad]."""


class Script(ABC):
    """A flight to play.

    t: (n,) rising [s].   dt: sample interval [s].   theta: parameters of a simulated aircraft.
    fail_t: when it breaks a limit, if known [s].   is_checked: whether it was asked if the flight
    is like those that its monitor was trained on.
    """

    t: Array
    dt: float
    is_checked: bool
    theta: dict[str, float] | None = None
    fail_t: float | None = None

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
    def said(self, k: int) -> Assessment:
        """What the monitor says of sample k."""

    @abstractmethod
    def next_alert(self, k: int) -> int | None:
        """First sample after k at which an alert begins."""


class AssessedTrack(Script):
    """A track through a monitor, assessed and judged whole; slow to make, for a thread."""

    def __init__(self, track: Track, monitor: Monitor, epsilon: float) -> None:
        self.t, self.dt, self.theta = track.t, track.dt, track.theta
        if track.fail_index is not None:
            self.fail_t = float(track.t[track.fail_index])
        self._track = track
        self._forecasts = monitor.recipe.predictor.forecasts
        self._said = monitor.assess(track.t, track.y, epsilon)
        self._withdrawal = withdrawal(monitor, track.t, track.y, self._said)
        self._alert = self._said.alert.copy()
        if self._withdrawal is not None:
            self._alert[self._withdrawal.first :] = False
        self.is_checked = monitor.support is not None

    def y(self, k: int) -> Array:
        """Sample k, (6,)."""
        return self._track.y[k]

    def attitude(self, k: int) -> Angles:
        """Bank, pitch and heading at sample k [rad]."""
        phi, theta, psi = self._track.attitude[k].tolist()
        return phi, theta, psi

    def said(self, k: int) -> Assessment:
        """What the batch says of sample k, unless that was withdrawn."""
        said, lost = self._said, self._withdrawal
        if lost is not None and k >= lost.first:
            return withdrawn(float(said.t[k]), lost.reason)
        code = int(said.state[k])
        t, state, reason = float(said.t[k]), STATES[code], REASONS[code]
        if state is not State.OK:
            return Assessment(t, None, None, state, reason)
        y_hat = said.y_hat[k] if self._forecasts else None
        return Assessment(t, float(said.p_value[k]), bool(self._alert[k]), state, reason, y_hat)

    def next_alert(self, k: int) -> int | None:
        """First sample after k at which an alert begins."""
        alert = self._alert
        onsets = np.flatnonzero(alert & ~np.concatenate([[False], alert[:-1]]))
        later = onsets[onsets > k]
        return int(later[0]) if len(later) else None
