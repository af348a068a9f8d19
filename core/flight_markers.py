"""Markers that a crew or control room sets during a flight: a family.

ABORT is for the safety of flight, KNOCK IT OFF for no useful data. Neither ends nor pauses the
flight: monitoring and recording continue.
"""

from dataclasses import dataclass
from typing import Literal

from core.monitor.status import Level

FlightMarkerKey = Literal["abort", "knock_it_off"]


@dataclass(frozen=True)
class FlightMarkerKind:
    """The word of a kind of marker, its meaning, its urgency, and its key on the page."""

    kind: FlightMarkerKey
    word: str
    meaning: str
    level: Level
    shortcut: str


FLIGHT_MARKERS: dict[FlightMarkerKey, FlightMarkerKind] = {
    kind.kind: kind
    for kind in (
        FlightMarkerKind("abort", "ABORT", "safety of flight", Level.WARNING, "x"),
        FlightMarkerKind("knock_it_off", "KNOCK IT OFF", "no useful data", Level.CAUTION, "q"),
    )
}
