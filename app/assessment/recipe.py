"""How to score a recording: miss rate, trim, manoeuvres."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, isfinite
from typing import Any, Literal, NamedTuple, get_args

from app.telemetry.recording import TelemetryError

Manoeuvres = Literal["detected", "entire"]
TRIM_SEGMENT = "trim_segment"


class Interval(NamedTuple):
    """A manoeuvre marked by hand. start, end: [s] in the recording's own time."""

    start: float
    end: float
    name: str = ""


@dataclass(frozen=True)
class ScoringRecipe:
    """How to score a recording.

    epsilon: accepted miss rate; None: the monitor's own.
    trim: value to subtract from each channel of a manoeuvre: the mean of its trim segment, or of
        this many seconds before the first input (at the start of a manoeuvre marked by hand); None
        subtracts nothing. Linear models, and so their monitors, describe deviations from trim.
    manoeuvres: detected by control activity, the entire recording as one, or marked by hand.
    Raises TelemetryError for non-finite numbers, empty intervals and overlaps.
    """

    epsilon: float | None = None
    trim: float | Literal["trim_segment"] | None = TRIM_SEGMENT
    manoeuvres: Manoeuvres | tuple[Interval, ...] = "detected"

    def __post_init__(self) -> None:
        if isinstance(self.trim, str):
            _check_word("trim", self.trim, (TRIM_SEGMENT,))
        elif self.trim is not None and not 0.0 < self.trim < inf:
            raise TelemetryError(
                f"the trim segment is {self.trim:g} s long; give a length above zero"
            )
        if isinstance(self.manoeuvres, str):
            _check_word("manoeuvres", self.manoeuvres, get_args(Manoeuvres))
            return
        object.__setattr__(self, "manoeuvres", _ordered(self.manoeuvres))

    def to_plain(self) -> dict[str, Any]:
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


def _ordered(intervals: Sequence[Interval]) -> tuple[Interval, ...]:
    """Sort the intervals and name those without a name."""
    if not intervals:
        raise TelemetryError("no manoeuvre is marked; mark at least one, or have them detected")
    for interval in intervals:
        if not (
            isfinite(interval.start) and isfinite(interval.end) and interval.start < interval.end
        ):
            raise TelemetryError(
                f"the manoeuvre {in_words(interval)} has no length; give an end after its start"
            )
    ordered = sorted(intervals)
    for before, after in pairwise(ordered):
        if after.start < before.end:
            raise TelemetryError(
                f"the manoeuvres {in_words(before)} and {in_words(after)} overlap; end the "
                "first before the second begins"
            )
    return tuple(
        interval._replace(name=interval.name or f"manoeuvre {number}")
        for number, interval in enumerate(ordered, 1)
    )


def in_words(interval: Interval) -> str:
    return f"{interval.start:.10g} to {interval.end:.10g} s"
