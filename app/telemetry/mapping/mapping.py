"""A mapping: the signal, scale, unit, sign and bias of each channel, or its derivation."""

import re
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Strict, TypeAdapter, ValidationError

from app.telemetry.contents import Columns, Contents
from app.telemetry.recording import TelemetryError
from app.telemetry.scaling import AS_RECORDED, Scaling
from app.telemetry.targets import in_order
from core.channels import LATERAL, Channel

OF_REQUEST = ConfigDict(extra="forbid", use_attribute_docstrings=True)
"""Pydantic reads requests into the classes below with these settings."""
LEAST_RATE_HZ, MOST_RATE_HZ = 0.1, 5e4


def _bits_read(given: Any) -> Any:
    """Read one bit, given as a number."""
    if isinstance(given, bool) or not isinstance(given, int | str):
        raise TelemetryError('give a bit such as 7, or bits such as "5-16" or "5-16 signed"')
    return str(given)


@dataclass(frozen=True)
class ChannelSource:
    """Source of a channel: a signal of the file, or a derivation from other channels.

    value = sign * (scale * signal + offset in the target's unit, or derived value) - bias.
    """

    __pydantic_config__ = OF_REQUEST

    signal: str = ""
    unit: str = ""
    """of the signal's values, in any common spelling: deg/s, kt ..."""
    sign: Literal[1, -1] = 1
    bias: Annotated[float, Strict()] = 0.0
    """in the target's unit"""
    derivation: str = ""
    """key of a derivation in the catalog; signal and unit are then empty"""
    scale: Annotated[float, Strict()] = 1.0
    """of raw counts, [`unit`] per count"""
    offset: Annotated[float, Strict()] = 0.0
    """of raw counts: the value at a count of zero, in `unit`"""
    bits: Annotated[str, BeforeValidator(_bits_read)] = ""
    """of the raw word, such as `5-16 signed`; bit 1 is the least significant"""

    @property
    def scaling(self) -> Scaling:
        """From the signal's raw numbers to values in `unit`."""
        return Scaling(self.scale, self.offset, self.bits)

    def problem(self) -> str:
        """The fault in words, "" if valid."""
        if bool(self.signal) == bool(self.derivation):
            return "needs either a signal or a derivation: give one of them, or omit the entry"
        if self.derivation and self.scaling != AS_RECORDED:
            return "is derived, and has a scale, offset or bits: only a signal has raw counts"
        if problem := self.scaling.problem():
            return problem
        return "" if isfinite(self.bias) else "has a bias that is not finite: give a number"

    def to_plain(self) -> dict[str, Any]:
        """Without a scale, offset and bits that change nothing, as earlier versions wrote it."""
        plain = asdict(self)
        return {k: x for k, x in plain.items() if k not in OF_COUNTS or x != OF_COUNTS[k]}


OF_COUNTS = asdict(AS_RECORDED)


def source_of(columns: Columns, signal: str, unit: str) -> ChannelSource:
    """A signal as a source, scaled as the file declares."""
    return ChannelSource(signal, unit, **asdict(columns.scaling(signal)))


def _source_read(given: Any) -> Any:
    """Read an entry of version 0.1.0, which called its bias offset."""
    if not isinstance(given, dict) or "offset" not in given or {"bias", "scale"} & {*given}:
        return given
    if given.keys() != ENTRY_0_1_0:
        raise TelemetryError(
            "an offset without a scale can be meant in two ways: give `scale` (1.0 for none) beside"
            " `offset`, or `bias`, which is subtracted in the unit of the channel"
        )
    return {"bias" if name == "offset" else name: value for name, value in given.items()}


ENTRY_0_1_0 = {"signal", "unit", "sign", "offset", "derivation"}


@dataclass(frozen=True)
class TimeSource:
    """Source of a group's times: one of its signals, or a sample rate."""

    __pydantic_config__ = OF_REQUEST

    signal: str = ""
    unit: str = "s"
    rate: Annotated[float, Strict()] = 0.0
    """sample rate [Hz], if no signal is the time"""
    start: Annotated[float, Strict()] = 0.0
    """time of the first row, with a rate [s]"""

    def problem(self) -> str:
        """The fault in words, "" if valid."""
        if bool(self.signal) == bool(self.rate):
            return "needs either a signal or a rate: give one of them"
        if self.rate and not LEAST_RATE_HZ <= self.rate <= MOST_RATE_HZ:
            return (
                f"has a rate of {self.rate:g} Hz: give one of {LEAST_RATE_HZ:g} to "
                f"{MOST_RATE_HZ:g} Hz"
            )
        return "" if isfinite(self.start) else "has a start that is not finite: give a number"


def _rate_read(given: Any) -> Any:
    return read_rate(given) if isinstance(given, str) else given


@dataclass(frozen=True)
class Mapping:
    """Sources of channels, and of the times of groups."""

    __pydantic_config__ = OF_REQUEST

    channels: dict[str, Annotated[ChannelSource, BeforeValidator(_source_read)]] = field(
        default_factory=dict
    )
    """by key of a target in the catalog, or of a channel of your own dictionaries"""
    times: dict[str, Annotated[TimeSource, BeforeValidator(_rate_read)]] = field(
        default_factory=dict
    )
    """by name of a group, a rate also as `50 Hz from 12:31:05`; other groups are not used"""

    def to_plain(self) -> dict[str, Any]:
        channels = {key: source.to_plain() for key, source in self.channels.items()}
        return asdict(self) | {"channels": channels}

    @classmethod
    def from_plain(cls, plain: Any) -> "Mapping":
        """Rebuild a mapping; TelemetryError names an invalid entry."""
        try:
            mapping = _MAPPING.validate_python(plain)
        except ValidationError as error:
            fault = error.errors()[0]
            place = " of ".join(repr(part) for part in reversed(fault["loc"]))
            raise TelemetryError(
                f"{place or 'the mapping'} {_in_words(fault['type'], fault['msg'], fault['input'])}"
            ) from None
        named = [(f"mapping of {key!r}", source) for key, source in mapping.channels.items()]
        named += [(f"time of {group!r}", source) for group, source in mapping.times.items()]
        for name, source in named:
            if problem := source.problem():
                raise TelemetryError(f"the {name} {problem}")
        return mapping


_MAPPING = TypeAdapter(Mapping)


def _in_words(kind: str, message: str, given: Any) -> str:
    """An error of pydantic in plain words: what was given, what is needed."""
    if kind == "unexpected_keyword_argument":
        return "is unknown: leave it out, or correct its name"
    if kind == "value_error":
        return f"is {given!r:.80}: {message.removeprefix('Value error, ')}"
    needed = "an object" if kind.startswith("dataclass") else NEEDED.get(kind)
    return f"is {given!r:.80}: give {needed or message.removeprefix('Input should be ')}"


NEEDED = {"float_type": "a number", "string_type": "text", "dict_type": "an object"}


def mapping_template(
    mapping: Mapping,
    contents: Contents,
    missing: Collection[str] = LATERAL.keys,
    channels: Iterable[Channel] = LATERAL.channels,
) -> dict[str, Any]:
    """The mapping as plain data, with an empty entry for each missing channel; if no group has a
    time, also one for each group.

    channels: of the monitors, the missing ones among them.
    """
    empty = {
        channel.key: ChannelSource(unit=channel.unit)
        for channel in channels
        if channel.key in missing
    }
    groups = [group.name for group in contents.groups if group.n_rows > 1]
    times = mapping.times or {name: TimeSource() for name in groups}
    return {
        "channels": {
            key: asdict(mapping.channels.get(key) or empty[key])
            for key in in_order([*mapping.channels, *empty])
        },
        "times": {name: asdict(source) for name, source in times.items()},
    }


DAY_S = 86_400.0
EXAMPLE = "50 Hz, or 50 Hz from 12:31:05"
RATE = re.compile(
    r"(?P<rate>\d+(?:[.,]\d*)?) *(?:hz|1/s|samples/s)?"
    r"(?: +from +(?:(?:(?P<hour>\d{1,2}):)?(?P<minute>[0-5]?\d):)?"
    r"(?P<second>\d+(?:[.,]\d*)?) *(?:s|z|utc)?)?",
    re.IGNORECASE,
)


def read_rate(text: str) -> TimeSource:
    """Read a rate and an optional start: a time of day, or a number of seconds.

    Raises TelemetryError for any other text.
    """
    match = RATE.fullmatch(text.strip())
    parts = {
        name: float((part or "0").replace(",", "."))
        for name, part in (match.groupdict() if match else {"rate": "0"}).items()
    }
    is_late = match and match["minute"] and (parts["hour"] > 23 or parts["second"] >= 60.0)
    if not parts["rate"] or is_late:
        raise TelemetryError(f"{text!r} is not a sample rate: write {EXAMPLE}")
    start = 3600.0 * parts["hour"] + 60.0 * parts["minute"] + parts["second"]
    source = TimeSource(rate=parts["rate"], start=start)
    if problem := source.problem():
        raise TelemetryError(f"{text!r} {problem}")
    return source


def rate_words(source: TimeSource) -> str:
    """A rate in the form that `read_rate` reads; a start of 60 s or more is a time of day."""
    rate = f"{source.rate:.10g} Hz"
    if not source.start:
        return rate
    if not _is_time_of_day(source.start):
        return f"{rate} from {source.start:.10g} s"
    hours_and_minutes, seconds = time_of_day(source.start, 6).rsplit(":", 1)
    return f"{rate} from {hours_and_minutes}:{seconds.rstrip('0').rstrip('.')}"


def counts_the_day(times: Iterable[TimeSource]) -> bool:
    """Whether times are seconds of the day: all are rates with a start at a time of day."""
    sources = list(times)
    return bool(sources) and all(each.rate and _is_time_of_day(each.start) for each in sources)


def time_of_day(t: float, decimals: int = 2) -> str:
    """Seconds of the day as `12:31:13.76`; midnight starts again at zero."""
    minutes, seconds = divmod(round(t, decimals) % DAY_S, 60.0)
    return f"{minutes // 60:02.0f}:{minutes % 60:02.0f}:{seconds:0{3 + decimals}.{decimals}f}"


def _is_time_of_day(start: float) -> bool:
    return 60.0 <= start < DAY_S
