"""The beginning of a manoeuvre and its trim, from the samples so far.

Offline the whole recording is searched (app.assessment.manoeuvres). In flight a manoeuvre begins
when a surface first departs from rest, and trim is the mean of the rest before it.
"""

from collections import deque

import numpy as np

from app.assessment.manoeuvres import BEGINNING, OTHER, RESTED, SHARE, SMALLEST
from app.assessment.planned_test import SURFACES, PlannedTest
from app.assessment.segments import AFTERWARDS, mean_of_rest
from core.channels import N_CHANNELS
from core.types import Array

MEASURED_S = 0.1
"""Interval of trim measurements at rest [s]."""
GUARD_S = 0.2
"""The newest part of the rest does not count for trim [s]: a departure may have begun."""
DEPARTED_SAMPLES = 2
"""Consecutive samples of a departure, so that one outlier is none."""
NOISES = 5.0
"""A departure exceeds this many standard deviations of the rest."""
TRAVEL = 2.0
"""Surfaces rest if they travel less than this many departures within the trim segment."""
MOVING = "the surfaces move: trim is measured as soon as they rest"
RESTING = "no manoeuvre is under way: it begins with the first movement of a surface"
"""These reasons are stored: a journal that is rescored must give the same."""


class CausalTrim:
    """Phases of a flight: rest, in which trim is measured, and manoeuvres.

    manoeuvre: number of the current one; 0 at rest.   trim: (6,); None while unknown.
    """

    def __init__(self, planned: PlannedTest) -> None:
        self.planned, self.manoeuvre = planned, 0
        self.trim: Array | None = None
        dt = planned.dt
        self._n_trim = max(2, round(planned.trim_segment_s / dt))
        self._n_rest = self._n_trim + round(GUARD_S / dt)
        self._rest: deque[Array] = deque(maxlen=self._n_rest)
        self._flown: deque[Array] = deque(maxlen=round(RESTED / dt))
        amplitudes = planned.amplitudes
        sizes = np.where(amplitudes > 0.0, amplitudes, OTHER * amplitudes.max())
        self._limits = self._threshold = np.maximum(BEGINNING * SHARE * sizes, SMALLEST)
        self._departed = self._n_begun = self._length = self._n_since = 0
        self._n_between = max(1, round(MEASURED_S / dt))

    @property
    def level(self) -> Array:
        """Trim (6,); 0 while unknown."""
        return np.zeros(N_CHANNELS) if self.trim is None else self.trim

    @property
    def reason(self) -> str:
        """Why there is no manoeuvre."""
        if self.trim is not None:
            return RESTING
        if len(self._rest) == self._n_rest:
            return MOVING
        needed = self._n_rest * self.planned.dt
        return f"trim is measured: it needs {needed:.3g} s of rest before the manoeuvre"

    def update(self, y: Array) -> bool:
        """Add a sample (6,). Returns whether a manoeuvre begins with it."""
        if self.manoeuvre and not self._is_over(y):
            return False
        if self.trim is not None and self._departs(y, self.trim):
            return self.begin()
        self._rest.append(y)
        self._n_since += 1
        if self._n_since >= self._n_between and len(self._rest) == self._n_rest:
            self._n_since = 0
            self._measure()
        return False

    def begin(self) -> bool:
        """Begin a manoeuvre with the current trim. Returns False during a manoeuvre."""
        if self.manoeuvre > 0:
            return False
        self._n_begun += 1
        self.manoeuvre, self._departed = self._n_begun, 0
        if self.trim is None and self._rest:
            self.trim = np.nan_to_num(mean_of_rest(np.array(self._rest)))
        elif self.trim is None:
            self.trim = np.zeros(N_CHANNELS)
        self._length = 0
        self._flown.clear()
        return True

    def _departs(self, y: Array, trim: Array) -> bool:
        moved = np.abs(y - trim)[SURFACES,] > self._limits
        self._departed = self._departed + 1 if moved.any() else 0
        return self._departed >= DEPARTED_SAMPLES

    def _measure(self) -> None:
        """Measure trim from the rest without its newest part; unknown while surfaces move."""
        rest = np.array([*self._rest][: self._n_trim])
        surfaces = np.nan_to_num(rest[:, SURFACES])
        self._limits = np.maximum(self._threshold, NOISES * surfaces.std(axis=0))
        if (np.ptp(surfaces, axis=0) <= TRAVEL * self._threshold).all():
            self.trim = np.nan_to_num(mean_of_rest(rest))
        elif self._departed == 0:
            self.trim = None

    def _is_over(self, y: Array) -> bool:
        """Whether the manoeuvre ended before this sample; then trim is measured again."""
        self._length += 1
        self._flown.append(y)
        duration, dt = self.planned.duration, self.planned.dt
        if duration is not None:
            over = self._length > round((duration - self.planned.trim_segment_s) / dt)
        else:
            over = self._length > AFTERWARDS / dt and self._rests()
        if over:
            self.manoeuvre, self.trim = 0, None
            self._rest.clear()
        return over

    def _rests(self) -> bool:
        if len(self._flown) < RESTED / self.planned.dt:
            return False
        surfaces = np.nan_to_num(np.array(self._flown)[:, SURFACES])
        return bool((np.ptp(surfaces, axis=0) <= self._threshold).all())
