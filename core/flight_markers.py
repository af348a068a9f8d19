"""Markers that a crew or a control room sets in a flight under way: a family.

ABORT is called for the safety of flight, KNOCK IT OFF where no useful data come. Neither ends nor
pauses the flight: what follows is monitored and recorded as before.
"""

from dataclasses import dataclass
from typing import Literal

from core.monitor.status import Level

FlightMarkerKey = Literal["abort", "knock_it_off"]


@dataclass(frozen=True)
class FlightMarkerKind:
    """How a kind of marker is called, what it means, how urgent it is, and the page's key."""

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
