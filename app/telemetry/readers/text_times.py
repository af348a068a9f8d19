"""Times as text: dates, days of the year and clocks, as seconds since the first time."""

import re
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import date
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute

from core.types import Array, Flags

SECOND = 1_000_000_000
DAY = 86_400 * SECOND
YEAR = 365 * DAY
CLOCK = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2})(?:[.,](?P<fraction>\d{1,9})\d*)?"
    r"\s?(?P<zone>Z|UTC|GMT|[+-]\d{2}(?::?\d{2})?)?"
)
RANGES = {
    "year": (1900, 2150),  # differences in nanoseconds have 64 bits
    "month": (1, 12),
    "day": (1, 31),
    "ordinal": (1, 366),
    "hour": (0, 24),
    "minute": (0, 59),
    "second": (0, 60),
}
Nanoseconds = npt.NDArray[np.int64]
Times = tuple[Nanoseconds, Flags]
"""(n,) since 1970 or the zero of the form [ns], and (n,) whether they are known."""
compute: Any = pyarrow.compute
"""Typed as Any, because pyarrow creates its functions on import."""


@dataclass(frozen=True)
class TimeForm:
    """A form of times. period: after which the text repeats [ns], 0 for never.

    plain: prefix that makes the text ISO 8601, None if there is none.
    """

    title: str
    pattern: str
    period: int = 0
    plain: str | None = None

    def parts(self, cell: str) -> dict[str, str | None] | None:
        """The parts of a time in this form, each number within its range; None for others."""
        match = re.fullmatch(self.pattern, cell, re.ASCII)
        parts = match.groupdict() if match else {}
        in_range = all(RANGES[n][0] <= int(parts[n]) <= RANGES[n][1] for n in RANGES if n in parts)
        return parts if parts and in_range else None

    def nanoseconds(self, cell: str) -> int | None:
        """A time [ns] as in Times, in UTC if the zone is known; None for other cells."""
        parts = self.parts(cell)
        if parts is None:
            return None
        texts = ("fraction", "zone")
        number = {name: int(part or 0) for name, part in parts.items() if name not in texts}
        days = number.get("day", number.get("ordinal", 1)) - 1
        if "year" in number:
            days += (date(number["year"], number.get("month", 1), 1) - date(1970, 1, 1)).days
        hours = 24 * days + number.get("hour", 0)
        seconds = (hours * 60 + number["minute"]) * 60 + number["second"]
        fraction = int((parts["fraction"] or "").ljust(9, "0"))
        return seconds * SECOND + fraction - _offset(parts.get("zone") or "")


TIME_FORMS = (
    TimeForm(
        "date and time",
        rf"(?P<year>\d{{4}})[-/](?P<month>\d{{1,2}})[-/](?P<day>\d{{1,2}})(?:T| +){CLOCK}",
        plain="",
    ),
    TimeForm(
        "date and time",
        rf"(?P<day>\d{{1,2}})\.(?P<month>\d{{1,2}})\.(?P<year>\d{{4}})(?:T| +){CLOCK}",
    ),
    TimeForm(
        "year, day of the year and time",
        rf"(?P<year>\d{{4}})[-:/ ](?P<ordinal>\d{{3}})[-:T ]{CLOCK}",
    ),
    TimeForm("day of the year and time", rf"(?P<ordinal>\d{{1,3}})[-:/T ]{CLOCK}", YEAR),
    TimeForm("time of day", CLOCK, DAY, plain="1970-01-01T"),
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
    return ":" in cell and any(form.parts(cell) for form in TIME_FORMS)


def form_of(cells: list[str]) -> TimeForm:
    return max(TIME_FORMS, key=lambda form: sum(form.parts(cell) is not None for cell in cells))


def times_of(texts: pa.ChunkedArray, form: TimeForm) -> Times:
    """The times of a column; ValueError if a cell is neither missing nor in this form."""
    known = compute.is_valid(texts).to_numpy()
    if form.plain is not None:
        iso = compute.binary_join_element_wise(form.plain, texts, "")
        for zone in (None, "UTC"):  # Arrow accepts times with or without a zone, not both
            with suppress(pa.ArrowInvalid):
                stamps = compute.cast(iso, pa.timestamp("ns", zone)).to_numpy()
                return np.where(known, stamps.astype("M8[ns]").astype(np.int64), 0), known
    values = [0 if text is None else form.nanoseconds(text) for text in texts.to_pylist()]
    if None in values:
        raise ValueError(f"row {values.index(None)} is not a {form.title}")
    return np.array(values, np.int64), known


def _offset(zone: str) -> int:
    """Offset of a clock from UTC [ns]."""
    if zone[:1] not in ("+", "-"):
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    return int(zone[0] + "1") * (int(digits[:2]) * 60 + int(digits[2:])) * 60 * SECOND


@dataclass
class ElapsedTime:
    """Seconds since the first time of a column, block by block.

    A form that repeats is continued: a jump of more than half its period is a turn.
    example: one of the times.
    """

    form: TimeForm
    example: str = ""
    turns: int = 0
    origin: int | None = None
    _before: int = field(default=0, repr=False)

    def seconds(self, of: Times) -> Array:
        """(n,) [s], NaN if unknown."""
        times, known = of
        result = np.full(len(times), np.nan)
        values = times[known]
        if not len(values):
            return result
        if self.origin is None:
            self.origin = self._before = int(values[0])
        if self.form.period:
            steps = np.diff(values, prepend=self._before)
            half = self.form.period // 2
            turn = (steps < -half).astype(np.int64) - (steps > half)
            self._before = int(values[-1])
            values = values + (self.turns + np.cumsum(turn)) * self.form.period
            self.turns += int(turn.sum())
        result[known] = (values - self.origin) / SECOND
        return result

    def start(self) -> str:
        """The first time in ISO 8601, or the part that the form has.

        "234:15:35:50.7" has no year, "15:35:50.7" no date and "35:50.7" no hour.
        """
        if self.origin is None:
            return ""
        text = str(np.datetime64(self.origin, "ns"))
        text = text.rstrip("0").rstrip(".") if "." in text else text
        text += "Z" * bool((self.form.parts(self.example) or {}).get("zone"))
        if not self.form.period:
            return text
        clock = text.partition("T")[2]
        if self.form.period == YEAR:
            return f"{self.origin // DAY + 1:03d}:{clock}"
        return clock if self.form.period == DAY else clock.partition(":")[2]

    def notes(self, name: str) -> list[str]:
        if self.origin is None:
            return []
        since = self.start()
        if self.form.period == YEAR:
            day, _, clock = since.partition(":")
            since = f"{clock} of day {int(day)} of its year"
        notes = [f"{name} is text ({self.form.title}), read as seconds since {since}."]
        if self.turns:
            event = {DAY: "midnight", YEAR: "New Year (taken as 365 days)"}.get(
                self.form.period, "the full hour"
            )
            count = "once" if self.turns == 1 else f"{self.turns} times"
            notes.append(f"{name} passes {event} {count}; its times continue.")
        return notes
