"""Times that count from a moment, as the CF conventions write them ("Time coordinate")."""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

SECONDS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0,
}  # fmt: skip
SPELLINGS = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "msecs", "millisecond", "milliseconds"),
    "us": ("us", "microsecond", "microseconds"),
    "ns": ("ns", "nanosecond", "nanoseconds"),
    "min": ("min", "mins", "minute", "minutes"),
    "h": ("h", "hr", "hrs", "hour", "hours"),
    "d": ("d", "day", "days"),
}
SINCE = re.compile(
    r"(?P<unit>[a-z]+)\s+since\s+(?P<Y>\d{1,4})-(?P<m>\d\d?)-(?P<d>\d\d?)"
    r"(?:[T ]+(?P<H>\d\d?):(?P<M>\d\d?)(?::(?P<S>\d\d?)(?P<f>\.\d+)?)?)?"
    r"\s*(?P<zone>Z|UTC|GMT|[+-]\d\d?:?(?:\d\d)?)?",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Since:
    """Time that counts from a moment, in UTC where none is named. unit: key of SECONDS."""

    unit: str
    moment: datetime

    @property
    def iso(self) -> str:
        """Return the moment in ISO 8601."""
        return self.moment.replace(tzinfo=None).isoformat() + "Z"

    def after(self, other: "Since") -> float:
        """How much later this moment is than another, in this unit."""
        return (self.moment - other.moment).total_seconds() / SECONDS[self.unit]


def since(unit: str) -> Since | None:
    """Read "seconds since 2024-05-01 09:30:00"; None where a unit is not of that kind."""
    match = SINCE.fullmatch(unit.strip())
    known = match and next((k for k, v in SPELLINGS.items() if match["unit"].lower() in v), None)
    if not match or not known:
        return None
    try:
        moment = datetime(*(int(match[part] or 0) for part in "YmdHMS"), tzinfo=UTC) + timedelta(
            seconds=float(match["f"] or 0)
        )
    except ValueError:
        return None
    zone = match["zone"] or ""
    if zone[:1] in ("+", "-"):
        hours, minutes = zone[1:].split(":") if ":" in zone else (zone[1:3], zone[3:])
        away = timedelta(hours=int(hours), minutes=int(minutes or 0))
        moment += away if zone[0] == "-" else -away
    return Since(known, moment)
