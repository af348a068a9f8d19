"""How late the samples of a source are, compared with its quickest recent one."""

from collections import deque

LAG_OVER, LAG_PARTS = 60.0, 6
"""Span over which the quickest arrival counts [s], and its parts: clocks drift."""


class Lag:
    """The lag of a source [s]: the age of its newest sample less that of the quickest recent one.

    late: lag from which on samples are no longer shown as current [s].
    """

    def __init__(self, late: float) -> None:
        self._quickest: deque[tuple[int, float]] = deque(maxlen=LAG_PARTS)
        self._late, self.now, self._least = late, 0.0, 0.0

    @property
    def reason(self) -> str:
        """Why the display is not current; empty if it is.

        It does not contain the changing lag: each new text is sent to every watcher.
        """
        return f"samples come more than {self._late:g} s late" if self.now > self._late else ""

    def note(self, arrived: float, t: float) -> None:
        """Add a sample: arrival time and sample time, each on its own clock [s]."""
        part, age = int(arrived / (LAG_OVER / LAG_PARTS)), arrived - t
        if not self._quickest or self._quickest[-1][0] != part:
            self._quickest.append((part, age))
            self._least = min(age for _, age in self._quickest)
        elif age < self._quickest[-1][1]:
            self._quickest[-1] = part, age
            self._least = min(age, self._least)
        self.now = arrived - self.taken(t)

    def taken(self, t: float) -> float:
        """Time at which a sample of t was taken, on the clock of arrivals [s]."""
        return t + self._least
