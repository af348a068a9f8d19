"""Attributes of a NetCDF variable: unit, packing, missing values and time origin.

Climate and Forecast metadata conventions, "Units", "Missing data" and "Packed data". A variable
without a _FillValue has the default of its type, as in the NetCDF library.
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
    """Time counted from a moment, in UTC unless a zone is given. unit: key of SECONDS."""

    unit: str
    moment: datetime

    @property
    def iso(self) -> str:
        return self.moment.replace(tzinfo=None).isoformat() + "Z"

    def offset_from(self, other: "Since") -> float:
        """How much later this moment is than another, in this unit."""
        return (self.moment - other.moment).total_seconds() / SECONDS[self.unit]


def since(unit: str) -> Since | None:
    """Parse "seconds since 2024-05-01 09:30:00"; None for other units."""
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
        offset = timedelta(hours=int(hours), minutes=int(minutes or 0))
        moment += offset if zone[0] == "-" else -offset
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
"""Value of an attribute by its name, None if missing; text as str."""


@dataclass(frozen=True, eq=False)
class Packing:
    """How the numbers of a variable are stored. missing: stored values that mean missing.

    value = scale * stored + offset, valid for lowest <= stored <= highest.
    """

    missing: tuple[float, ...] = ()
    scale: float = 1.0
    offset: float = 0.0
    lowest: float = -np.inf
    highest: float = np.inf

    def unpack(self, stored: npt.NDArray[Any]) -> Array:
        values = stored.astype(np.float64)
        is_missing = (values < self.lowest) | (values > self.highest)
        for value in self.missing:
            is_missing |= values == value
        values[is_missing] = np.nan
        is_unscaled = (self.scale, self.offset) == (1.0, 0.0)
        return values if is_unscaled else self.scale * values + self.offset


@dataclass(eq=False)
class Conventions:
    """The variables of one file. start: origin of the first time variable."""

    start: Since | None = None

    def variable(
        self, name: str, attribute: Attribute, dtype: np.dtype[Any]
    ) -> tuple[Column, Callable[[npt.NDArray[Any]], Array]]:
        """The column of a variable, and a function that unpacks its numbers.

        Later times are shifted to the origin of the first.
        """
        unit, packing = _text(attribute("units")), _packing(attribute, dtype)
        counted = since(unit)
        if counted:
            self.start = self.start or counted
            offset = packing.offset + counted.offset_from(self.start)
            packing = replace(packing, offset=offset)
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
    """Read the packing attributes of a variable; attributes that are not numbers are ignored."""
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
