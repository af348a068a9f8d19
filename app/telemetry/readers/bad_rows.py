"""Rows of a table that cannot be read: listed, left out up to a share, then too many."""

from dataclasses import dataclass, field

from app.telemetry.contents import MOST_LISTED, BadRow
from app.telemetry.recording import TelemetryError

ALWAYS_ALLOWED = 3
"""So many may be bad in a small table too, if twice as many are good."""
SHOWN = 5


@dataclass
class BadRows:
    """The bad rows so far. share: of all rows that may be bad."""

    share: float
    n: int = 0
    listed: list[BadRow] = field(default_factory=list)

    def add(self, line: int, reason: str, text: str) -> None:
        """Note a row that was left out, in the order of lines."""
        self.n += 1
        if len(self.listed) < MOST_LISTED:
            shown = text if text.isprintable() else ascii(text[:200])[1:-1]
            self.listed.append(BadRow(line, reason, shown[:80]))

    def check(self, n_good: int, share_read: float = 1.0) -> None:
        """Raise TelemetryError where there are too many.

        share_read: of the file. Before its end it is refused only if the rest can hardly save it.
        """
        expected = (n_good + self.n) / share_read * (1.0 if share_read == 1.0 else 1.5)
        few = min(ALWAYS_ALLOWED, n_good // 2)
        if self.n <= max(self.share * expected, few):
            return
        first = "; ".join(f"line {row.line}: {row.reason}" for row in self.listed[:SHOWN])
        seen = f"of the {n_good + self.n} rows" + (" so far" if share_read < 1.0 else "")
        raise TelemetryError(
            f"{self.n} {seen} cannot be read, where {100 * self.share:g} % is the most ({first}"
            f"{'; ...' if self.n > SHOWN else ''}): repair them or export the file again"
        )

    def notes(self, n_good: int) -> list[str]:
        """What was left out, in a sentence."""
        if not self.n:
            return []
        percent = 100 * self.n / (n_good + self.n)
        return [f"{self.n} of {n_good + self.n} rows ({percent:.2g} %) are bad and were left out."]
