"""How late the samples of a source are, compared with its best arrival of the flight."""

from collections import deque
from math import inf
from typing import NamedTuple

import numpy as np

PART_S, PARTS = 60.0, 3
"""The best arrival of each part [s] counts for the drift; fewer parts give none."""
INTERVALS_KEPT = 50
MOST_DRIFT = 1e-4
"""Clocks differ by less. Ages that grow faster are those of late samples."""


class Late(NamedTuple):
    """Times between which samples came late [s]. end: None while they do."""

    start: float
    end: float | None


class Lag:
    """The lag of a source [s]: the age of its newest sample less the best age of the flight.

    late: lag from which on samples are no longer shown as current [s].
    drift: estimated drift of the source's clock behind that of arrivals, at most MOST_DRIFT.
    intervals: in which samples came late, the newest INTERVALS_KEPT.
    """

    def __init__(self, late: float) -> None:
        self._late, self.now, self.drift = late, 0.0, 0.0
        self._parts: dict[int, tuple[float, float]] = {}
        self._part = -1
        self._best, self._arrived = inf, 0.0
        self.intervals = deque[Late](maxlen=INTERVALS_KEPT)
        self._t = 0.0

    @property
    def reason(self) -> str:
        """Why the display is not current; empty if it is.

        It does not contain the changing lag: each new text is sent to every watcher.
        """
        return f"samples come more than {self._late:g} s late" if self.now > self._late else ""

    def note(self, arrived: float, t: float) -> None:
        """Add a sample: arrival time and sample time, each on its own clock [s]."""
        part, age, was_late = int(arrived / PART_S), arrived - t, bool(self.reason)
        if part != self._part:
            self._part = part
            self._estimate_drift()
        if age < self._parts.get(part, (0.0, inf))[1]:
            self._parts[part] = arrived, age
        self._best, self._arrived = min(self._best, age - self.drift * arrived), arrived
        self.now = arrived - self.taken(t)
        if self.reason and not was_late:
            self.intervals.append(Late(self._t, None))
        elif was_late and not self.reason:
            self.intervals[-1] = Late(self.intervals[-1].start, t)
        self._t = t

    def taken(self, t: float) -> float:
        """Time at which a sample of t was taken, on the clock of arrivals [s]."""
        return t if self._best == inf else t + self._best + self.drift * self._arrived

    def due(self, t: float, arrived: float) -> float:
        """When a sample of t that arrived late [s] would have arrived without lag."""
        return arrived if self._best == inf else min(arrived, self.taken(t))

    def _estimate_drift(self) -> None:
        """Least squares over the best arrivals of the parts so far."""
        if len(self._parts) < PARTS:
            return
        arrived, age = np.array([*self._parts.values()]).T
        from_mean = arrived - arrived.mean()
        slope = float(from_mean @ age / (from_mean @ from_mean))
        self.drift = min(max(slope, -MOST_DRIFT), MOST_DRIFT)
        self._best = float((age - self.drift * arrived).min())
