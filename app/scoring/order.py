"""What is asked of a scoring: at which miss rate, from which trim, of which stretches."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, isfinite
from typing import Any, Literal, NamedTuple, get_args

from app.telemetry.recording import TelemetryError

Manoeuvres = Literal["found", "whole"]
LEAD_IN = "lead_in"


class Span(NamedTuple):
    """A stretch of a recording. start, end: [s] of the recording's own time."""

    start: float
    end: float
    name: str = ""


@dataclass(frozen=True)
class ScoringOrder:
    """How a recording is to be scored.

    epsilon: accepted miss rate, the monitor's unless given.
    trim: what is subtracted from each stretch, channel by channel: the mean of its own lead-in, or
        of so many seconds before the first input (of a stretch marked by hand: its first ones);
        None leaves the channels as they are. Linear models, and so monitors, fly about trim.
    manoeuvres: those found by control activity, the whole recording as one, or spans by hand.
    Raises TelemetryError for numbers that are not finite, spans without length and overlaps.
    """

    epsilon: float | None = None
    trim: float | Literal["lead_in"] | None = LEAD_IN
    manoeuvres: Manoeuvres | tuple[Span, ...] = "found"

    def __post_init__(self) -> None:
        if isinstance(self.trim, str):
            _check_word("trim", self.trim, (LEAD_IN,))
        elif self.trim is not None and not 0.0 < self.trim < inf:
            raise TelemetryError(
                f"a trim stretch of {self.trim:g} s was asked for; give a length above zero"
            )
        if isinstance(self.manoeuvres, str):
            _check_word("manoeuvres", self.manoeuvres, get_args(Manoeuvres))
            return
        object.__setattr__(self, "manoeuvres", _ordered(self.manoeuvres))

    def to_plain(self) -> dict[str, Any]:
        """Return JSON's types."""
        marked = self.manoeuvres
        return {
            "epsilon": self.epsilon,
            "trim": self.trim,
            "manoeuvres": marked
            if isinstance(marked, str)
            else [{"start": s.start, "end": s.end, "name": s.name} for s in marked],
        }


def _check_word(name: str, word: str, known: tuple[str, ...]) -> None:
    if word not in known:
        raise TelemetryError(f"{name} is {word!r}; give {' or '.join(known)}, or numbers")


def _ordered(spans: Sequence[Span]) -> tuple[Span, ...]:
    """Spans by their starts, each with a name."""
    if not spans:
        raise TelemetryError("no stretch was marked; mark one at least, or let them be found")
    for span in spans:
        if not (isfinite(span.start) and isfinite(span.end) and span.start < span.end):
            raise TelemetryError(
                f"the stretch {said(span)} has no length; give an end after its start"
            )
    ordered = sorted(spans)
    for before, after in pairwise(ordered):
        if after.start < before.end:
            raise TelemetryError(
                f"the stretches {said(before)} and {said(after)} overlap; end the first before "
                "the second begins"
            )
    return tuple(
        span._replace(name=span.name or f"stretch {number}")
        for number, span in enumerate(ordered, 1)
    )


def said(span: Span) -> str:
    """The span in words."""
    return f"{span.start:.10g} to {span.end:.10g} s"
