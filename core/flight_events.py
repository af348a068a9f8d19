"""What happens during a flight and is kept: alarms, markers, changes of trim and of limits."""

from dataclasses import dataclass
from typing import Any, Literal

from core.limits.exceedance import MeasuredExceedance
from core.monitor.assessment import Cause
from core.monitor.status import AlarmKind, Level

ON_THE_WIRE = {"extra": "forbid", "use_attribute_docstrings": True}


@dataclass(frozen=True)
class Alarm:
    """A warning or caution, latched until someone acknowledges it."""

    __pydantic_config__ = ON_THE_WIRE

    number: int
    """1, 2, 3 ... in the order raised"""
    seq: int
    """sample that raised it; for a late source the last one received, -1 for none"""
    t: float
    """[s]"""
    p_value: float | None
    kind: AlarmKind
    """warnings: a predicted (`risk`) or measured (`limit`) exceedance; cautions: a monitor that is
    not applicable (`invalid`), a late source (`stale`), samples in doubt: `surfaces` that rest
    while the aircraft moves, `frozen`, `contradiction`, a `trim` near a limit"""
    level: Level
    """14 CFR 25.1322: `warning` needs action now, `caution` attention now"""
    raised: str
    """UTC, ISO 8601"""
    exceedance: MeasuredExceedance | None = None
    """for kind `limit`"""
    reason: str | None = None
    """of a caution"""
    channels: list[str] | None = None
    """keys of the channels in doubt, of a caution; null where not recorded"""
    acknowledged: str | None = None
    """UTC, ISO 8601"""
    by: str | None = None
    """who acknowledged it"""
    stored: bool = False
    """false until it is stored: a crash would lose it"""
    id: str = ""
    """its number; part of the path of its acknowledgement"""
    cause: Cause | None = None
    """for kind `invalid`, as in a frame"""
    arrived: float | None = None
    """of a live flight: time since it began at which the sample arrived or was shown [s]; an
    alarm warns from then on"""
    manoeuvre: int | None = None
    """number of the manoeuvre in progress, 0 for none; null where not known"""

    def __post_init__(self) -> None:
        object.__setattr__(self, "id", str(self.number))


FlightMarkerKey = Literal["abort", "knock_it_off", "call_cleared", "event"]


@dataclass(frozen=True)
class FlightMarkerKind:
    """The word of a kind of marker, its meaning, its urgency, and its key on the page."""

    kind: FlightMarkerKey
    word: str
    meaning: str
    level: Level
    shortcut: str
    asks_text: bool = False


FLIGHT_MARKERS: dict[FlightMarkerKey, FlightMarkerKind] = {
    kind.kind: kind
    for kind in (
        FlightMarkerKind("abort", "ABORT", "safety of flight", Level.WARNING, "x"),
        FlightMarkerKind("knock_it_off", "KNOCK IT OFF", "no useful data", Level.CAUTION, "q"),
        FlightMarkerKind("call_cleared", "CALL CLEARED", "no call is in force", Level.NONE, "u"),
        FlightMarkerKind("event", "EVENT", "in words", Level.NONE, "e", asks_text=True),
    )
}
"""ABORT is for the safety of flight, KNOCK IT OFF for no useful data, EVENT for anything else.

A call is the headline of the page until CALL CLEARED or the next manoeuvre."""


def _title_kind(schema: dict[str, Any]) -> None:
    """Tell the choices of `kind` from FlightMarkerKind in generated clients."""
    schema["properties"]["kind"]["title"] = "Call"


@dataclass(frozen=True)
class FlightMarker:
    """A marker set by a person; it neither ends nor pauses the flight."""

    __pydantic_config__ = ON_THE_WIRE | {"json_schema_extra": _title_kind}

    number: int
    """1, 2, 3 ... in the order set"""
    kind: FlightMarkerKey
    seq: int
    """newest sample when it was set; -1 before the first"""
    t: float
    """time of that sample [s]; of an event the time it is about"""
    created: str
    """UTC, ISO 8601"""
    by: str
    text: str | None = None
    stored: bool = False
    """false until it is stored: a crash would lose it"""
    word: str = ""
    """name of its kind"""
    meaning: str = ""
    """meaning of its kind"""
    level: Level = Level.NONE

    def __post_init__(self) -> None:
        for name in ("word", "meaning", "level"):
            object.__setattr__(self, name, getattr(FLIGHT_MARKERS[self.kind], name))


@dataclass(frozen=True)
class TrimChange:
    """The trim that is subtracted from a limited channel became known, moved or was lost."""

    __pydantic_config__ = ON_THE_WIRE

    t: float
    """first sample that counts from it [s]"""
    channel: str
    value: float | None
    """trim in the channel's unit; null: values are as recorded from here on"""
    by_hand: bool = False
    """whether a person began the manoeuvre for which it was taken"""
    is_far: bool = False
    """whether it is so large a share of a limit that values as recorded are shown beside"""


@dataclass(frozen=True)
class FlightLimits:
    """A version of a limit set put in force during a flight."""

    __pydantic_config__ = ON_THE_WIRE

    number: int
    """1, 2, 3 ... in the order put in force during the flight"""
    limit_set: str
    """id"""
    name: str
    """of the limit set"""
    version: int
    fixed: dict[str, float]
    """declared values of the flight condition"""
    seq: int
    """first sample under this version"""
    t: float
    """time of the sample before [s]; 0 before the first"""
    created: str
    """UTC, ISO 8601"""
    by: str
    """who put it in force"""
