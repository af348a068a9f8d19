"""The clocks of recordings: times as text, and counts of a unit from an origin."""

from datetime import datetime, timedelta, timezone

import numpy as np

T0 = datetime(2026, 3, 1, 12, 34, 56, 789000)
N = 400
EVEN = 0.02 * np.arange(N)


def milli(when: datetime, form: str) -> str:
    """A time to the millisecond."""
    return when.strftime(form) + f"{when.microsecond // 1000:03d}"


CLOCKS = {
    # by name, how a time is written
    "iso": lambda t: t.isoformat(timespec="milliseconds"),
    "iso with a blank": lambda t: t.isoformat(" ", "milliseconds"),
    "iso in UTC": lambda t: t.isoformat(timespec="milliseconds") + "Z",
    "iso in a zone": lambda t: t.replace(tzinfo=timezone(timedelta(hours=-5))).isoformat(),
    "iso to the microsecond": lambda t: t.isoformat(timespec="microseconds"),
    "iso with a decimal comma": lambda t: t.isoformat(timespec="milliseconds").replace(".", ","),
    "slashes": lambda t: milli(t, "%Y/%m/%d %H:%M:%S."),
    "points": lambda t: milli(t, "%d.%m.%Y %H:%M:%S,"),
    "year and day": lambda t: milli(t, "%Y-%jT%H:%M:%S."),
    "year and day with colons": lambda t: milli(t, "%Y:%j:%H:%M:%S."),
    "day": lambda t: milli(t, "%j:%H:%M:%S."),
    "day and blank": lambda t: milli(t, "%j %H:%M:%S."),
    "clock": lambda t: milli(t, "%H:%M:%S."),
    "clock in UTC": lambda t: milli(t, "%H:%M:%S.") + "Z",
    "clock with colons": lambda t: milli(t, "%H:%M:%S:"),
    "minutes": lambda t: milli(t, "%M:%S."),
}

COUNTS = {
    # by name: the signal, its values and their unit
    "seconds": ("time", EVEN, "s"),
    "milliseconds": ("time", 1e3 * EVEN, "ms"),
    "microseconds": ("time", 1e6 * EVEN, "us"),
    "nanoseconds": ("time", 2e9 + 1e9 * EVEN, "ns"),
    "one a second": ("time", 10 + np.arange(float(N)), "s"),
    "seconds of the day": ("irig", 43_000.0 + EVEN, "s"),
    "1970 in seconds": ("timestamp", 1.7e9 + EVEN, "s"),
    "1970 in milliseconds": ("timestamp", 1.7e12 + 1e3 * EVEN, "ms"),
    "1970 in microseconds": ("timestamp", 1.7e15 + 1e6 * EVEN, "us"),
    "1970 in nanoseconds": ("timestamp", 1.7e18 + 1e9 * EVEN, "ns"),
    "days of a spreadsheet": ("time", 45_000.0 + EVEN / 86_400.0, "day"),
    "days of MATLAB": ("time", 738_000.5 + EVEN / 86_400.0, "day"),
}
