"""How much later samples of a source come than the quickest of them did."""

from collections import deque

LAG_OVER, LAG_PARTS = 60.0, 6
"""The quickest arrival is looked for over so long [s], in so many parts: clocks drift apart."""


class Lag:
    """The lag of a source [s]: the age of its newest sample, less that of the quickest of late.

    late: what comes so much later than the quickest did is no longer shown as now [s].
    """

    def __init__(self, late: float) -> None:
        self._quickest: deque[tuple[int, float]] = deque(maxlen=LAG_PARTS)
        self._late, self.now, self._least = late, 0.0, 0.0

    @property
    def reason(self) -> str:
        """Why what is shown is not now; empty where it is.

        The same whatever the lag is, which changes with each sample: every watcher is told anew.
        """
        return f"samples come more than {self._late:g} s late" if self.now > self._late else ""

    def note(self, arrived: float, t: float) -> None:
        """A sample of t came at `arrived`, each by a clock of its own [s]."""
        part, age = int(arrived / (LAG_OVER / LAG_PARTS)), arrived - t
        if not self._quickest or self._quickest[-1][0] != part:
            self._quickest.append((part, age))
            self._least = min(each for _, each in self._quickest)
        elif age < self._quickest[-1][1]:
            self._quickest[-1] = part, age
            self._least = min(age, self._least)
        self.now = arrived - self.taken(t)

    def taken(self, t: float) -> float:
        """When a sample of t was taken, by the clock of the arrivals [s]: had it come at once."""
        return t + self._least
