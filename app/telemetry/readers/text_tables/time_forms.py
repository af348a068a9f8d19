"""Forms of times as text: dates, days of the year, clocks."""

import re
from dataclasses import dataclass

SECOND = 1_000_000_000
DAY = 86_400 * SECOND
YEAR = 365 * DAY
FRACTION = r"(?:[.,](?P<fraction>\d{1,9})\d*)?"
CLOCK = rf"(?P<hour>\d{{1,2}}):(?P<minute>\d{{2}}):(?P<second>\d{{2}}){FRACTION}"
RANGES = {
    "year": (1900, 2150),  # differences in nanoseconds have 64 bits
    "month": (1, 12),
    "day": (1, 31),
    "ordinal": (1, 366),
    "hour": (0, 24),
    "minute": (0, 59),
    "second": (0, 60),
}
ZONE = r"\s?(?P<zone>Z|UTC|GMT|[+-]\d{2}(?::?\d{2})?)?"


@dataclass(frozen=True)
class TimeForm:
    """A form of times. period: after which the text repeats [ns], 0 for never.

    plain: prefix that makes the text ISO 8601, None if there is none.
    """

    title: str
    pattern: str
    period: int = 0
    plain: str | None = None

    def has_zone(self, cell: str) -> bool:
        """Whether a cell gives the zone of its clock."""
        match = re.fullmatch(self.pattern, cell, re.ASCII)
        return bool(match and match.groupdict().get("zone"))

    def matches(self, cell: str) -> bool:
        """Whether a cell has this form, with each number within its range."""
        match = re.fullmatch(self.pattern, cell, re.ASCII)
        return match is not None and all(
            low <= int(match[name]) <= high
            for name, (low, high) in RANGES.items()
            if name in match.re.groupindex
        )


TIME_FORMS = (
    TimeForm(
        "date and time",
        rf"(?P<year>\d{{4}})[-/](?P<month>\d{{1,2}})[-/](?P<day>\d{{1,2}})(?:T| +){CLOCK}{ZONE}",
        plain="",
    ),
    TimeForm(
        "date and time",
        rf"(?P<day>\d{{1,2}})\.(?P<month>\d{{1,2}})\.(?P<year>\d{{4}})(?:T| +){CLOCK}{ZONE}",
    ),
    TimeForm(
        "year, day of the year and time",
        rf"(?P<year>\d{{4}})[-:/ ](?P<ordinal>\d{{3}})[-:T ]{CLOCK}{ZONE}",
    ),
    TimeForm("day of the year and time", rf"(?P<ordinal>\d{{1,3}})[-:/T ]{CLOCK}{ZONE}", YEAR),
    TimeForm("time of day", rf"{CLOCK}{ZONE}", DAY, plain="1970-01-01T"),
    TimeForm(
        "time of day",
        r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2}):(?P<fraction>\d{3,9})",
        DAY,
    ),
    TimeForm(
        "time in minutes and seconds",
        r"(?P<minute>\d{1,2}):(?P<second>\d{2})[.,](?P<fraction>\d{1,9})",
        3600 * SECOND,
    ),
)


def is_time(cell: str) -> bool:
    return ":" in cell and any(form.matches(cell) for form in TIME_FORMS)


def form_of(cells: list[str]) -> TimeForm:
    """The form of most of the cells."""
    return max(TIME_FORMS, key=lambda form: sum(map(form.matches, cells)))
