"""What the attributes of a NetCDF variable say: unit, packing, missing values, the start of time.

Climate and Forecast metadata conventions, "Units", "Missing data" and "Packed data". A variable
without a _FillValue has the default one of its type, as the NetCDF library reads it.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import numpy.typing as npt

from app.telemetry.readers.declared_rates import declared_rate
from app.telemetry.readers.signal_tables import Column, is_time_name
from core.types import Array

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


DEFAULT_FILL: dict[str, float] = {
    "i2": -32767,
    "u2": 65535,
    "i4": -2147483647,
    "u4": 4294967295,
    "i8": -9223372036854775806,
    "u8": 18446744073709551614,
    "f4": 9.969209968386869e36,
    "f8": 9.969209968386869e36,
}
MOST_FILLS = 16

Attribute = Callable[[str], Any]
"""The value of an attribute by its name, None where there is none; texts as str."""


@dataclass(frozen=True, eq=False)
class Packing:
    """How the numbers of a variable are stored. missing: values that stand for none.

    value = scale * stored + offset, where lowest <= stored <= highest.
    """

    missing: tuple[float, ...] = ()
    scale: float = 1.0
    offset: float = 0.0
    lowest: float = -np.inf
    highest: float = np.inf

    def unpack(self, stored: npt.NDArray[Any]) -> Array:
        """Return the values, NaN where missing."""
        values = stored.astype(np.float64)
        bad = (values < self.lowest) | (values > self.highest)
        for value in self.missing:
            bad |= values == value
        values[bad] = np.nan
        plain = (self.scale, self.offset) == (1.0, 0.0)
        return values if plain else self.scale * values + self.offset


@dataclass(eq=False)
class Conventions:
    """The variables of one file as they are met. start: from when the first time of them counts."""

    start: Since | None = None

    def variable(
        self, name: str, attribute: Attribute, dtype: np.dtype[Any]
    ) -> tuple[Column, Callable[[npt.NDArray[Any]], Array]]:
        """Return the column of a variable and how its numbers are unpacked.

        A time that counts from another moment than the first one is moved to that.
        """
        unit, packing = _text(attribute("units")), _packing(attribute, dtype)
        counted = since(unit)
        if counted:
            self.start = self.start or counted
            away = counted.after(self.start)
            packing = replace(packing, offset=packing.offset + away)
        time = counted is not None or (
            is_time_name(name.split("/")[-1])
            or _text(attribute("axis")).upper() == "T"
            or _text(attribute("standard_name")) == "time"
        )
        column = Column(
            name,
            counted.unit if counted else unit,
            _text(attribute("long_name")),
            time,
            *declared_rate(attribute),
        )
        return column, packing.unpack


def _packing(attribute: Attribute, dtype: np.dtype[Any]) -> Packing:
    """Read the attributes of a variable of a type; those that are no numbers are left out."""
    fill = _numbers(attribute("_FillValue"))
    if not fill and (kind := dtype.str[1:]) in DEFAULT_FILL:
        fill = (float(dtype.type(DEFAULT_FILL[kind])),)
    valid = _numbers(attribute("valid_range"))
    low, high = valid if len(valid) == 2 else (-np.inf, np.inf)
    return Packing(
        fill + _numbers(attribute("missing_value")),
        _first(attribute("scale_factor"), 1.0),
        _first(attribute("add_offset"), 0.0),
        _first(attribute("valid_min"), low),
        _first(attribute("valid_max"), high),
    )


def _numbers(value: Any) -> tuple[float, ...]:
    values = np.asarray(() if value is None else value).reshape(-1)[:MOST_FILLS]
    if values.dtype.kind not in "iuf":
        return ()
    return tuple(float(value) for value in values if not np.isnan(value))


def _first(value: Any, default: float) -> float:
    return (*_numbers(value), default)[0]


def _text(value: Any) -> str:
    return value.strip() if isinstance(value, str) else ""
