"""Convert columns of times as text to seconds since the first time."""

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute

from app.telemetry.readers.text_tables.time_forms import DAY, RANGES, SECOND, YEAR, TimeForm
from core.types import Array, Flags

Nanoseconds = npt.NDArray[np.int64]
Times = tuple[Nanoseconds, Flags]
"""(n,) since 1970 or the zero of the form [ns], and (n,) whether they are known."""
compute: Any = pyarrow.compute
"""Typed as Any, because pyarrow creates its functions on import."""


def times_of(texts: pa.ChunkedArray, form: TimeForm) -> Times:
    """The times of a column; ValueError if a cell is neither missing nor in this form."""
    known = compute.is_valid(texts).to_numpy()
    if form.plain is not None:
        iso = compute.binary_join_element_wise(form.plain, texts, "")
        for zone in (None, "UTC"):  # Arrow accepts times with or without a zone, not both
            with suppress(pa.ArrowInvalid):
                stamps = compute.cast(iso, pa.timestamp("ns", zone)).to_numpy()
                return np.where(known, stamps.astype("M8[ns]").astype(np.int64), 0), known
    matched = compute.extract_regex(texts, pattern=rf"^(?:{form.pattern})$")
    is_bad = known & ~compute.is_valid(matched).to_numpy()
    if is_bad.any():
        raise ValueError(f"row {int(is_bad.argmax())} is not a {form.title}")
    names = [matched.type.field(i).name for i in range(matched.type.num_fields)]
    parts = {name: compute.struct_field(matched, name) for name in names}
    numbers = {
        name: _integers(compute.utf8_rpad(part, 9, "0") if name == "fraction" else part, known)
        for name, part in parts.items()
        if name != "zone"
    }
    return _since_zero(numbers, known) - _zone(parts.get("zone")), known


def _since_zero(part: dict[str, Nanoseconds], known: npt.NDArray) -> Nanoseconds:
    """Times [ns] from the parts; ValueError if one is out of its range."""
    for name, (low, high) in RANGES.items():
        if name in part and ((part[name] > high) | (part[name] < low))[known].any():
            raise ValueError(f"a {name} out of {low} to {high}")
    zero = np.int64(0)
    days = part["ordinal"] - 1 if "ordinal" in part else zero
    if "year" in part:
        months = (part["year"] - 1970) * 12 + part.get("month", 1) - 1
        days = days + months.astype("M8[M]").astype("M8[D]").astype(np.int64)
        days = days + part["day"] - 1 if "day" in part else days
    seconds = ((days * 24 + part.get("hour", zero)) * 60 + part["minute"]) * 60 + part["second"]
    return seconds * SECOND + part.get("fraction", zero)


def _zone(texts: pa.ChunkedArray | None) -> Nanoseconds | int:
    """Offset of the clock from UTC [ns]."""
    if texts is None:
        return 0
    offsets = {text: _offset(text) for text in texts.unique().to_pylist()}
    if len(offsets) == 1:
        return next(iter(offsets.values()))
    return np.array([offsets[text] for text in texts.to_pylist()], np.int64)


def _offset(zone: str | None) -> int:
    if not zone or zone[0] not in "+-":
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    minutes = int(digits[:2]) * 60 + int(digits[2:])
    return (-1 if zone[0] == "-" else 1) * minutes * 60 * SECOND


def _integers(texts: pa.ChunkedArray, known: npt.NDArray) -> Nanoseconds:
    filled = compute.if_else(compute.equal(texts, ""), "0", texts)
    return np.where(known, compute.fill_null(compute.cast(filled, pa.int64()), 0).to_numpy(), 0)


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
        text += "Z" * self.form.has_zone(self.example)
        if not self.form.period:
            return text
        clock = text.partition("T")[2]
        if self.form.period == YEAR:
            return f"{self.origin // DAY + 1:03d}:{clock}"
        return clock if self.form.period == DAY else clock.partition(":")[2]

    def notes(self, name: str) -> list[str]:
        """Sentences about the column of this name."""
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
