"""Apply a mapping to the columns of a file: channels in our units, at the times of the file."""

from contextlib import suppress
from dataclasses import replace
from difflib import get_close_matches
from textwrap import shorten

import numpy as np

from app.telemetry.contents import Columns, Contents, Signal, release
from app.telemetry.mapping.derivations import DERIVATIONS, derive
from app.telemetry.mapping.group_times import dead_time, no_clock, repeated_time
from app.telemetry.mapping.mapping import ChannelSource, Mapping, rate_words
from app.telemetry.recording import TelemetryError, Trace, Traces
from app.telemetry.scaling import has_fractions, read_bits
from app.telemetry.targets import in_order, plausible, target_of
from app.telemetry.units import convert, spelled
from core.channels import KEYS
from core.types import Array

MOST_CLOSE = 5
"""Signals with names like a wrong one, which are listed first."""
BITS_429 = 31
"""Bits of an ARINC 429 word without its parity."""
ANY_NUMBERS = np.errstate(over="ignore", invalid="ignore", divide="ignore")
"""A file may hold any numbers; an overflow becomes infinite and so missing, without a warning."""


@ANY_NUMBERS
def apply_mapping(columns: Columns, mapping: Mapping) -> Traces:
    """Read the mapped channels and compute the derived ones.

    Values that need no conversion stay memory-mapped. Infinite values count as missing, and
    implausible values are not used in derivations.
    Raises TelemetryError with the channel if the mapping does not fit the file.
    """
    if not mapping.channels:
        raise TelemetryError(
            _without_time(columns, mapping)
            or f"the mapping has no channel: map signals to {', '.join(KEYS)}, or to others"
        )
    times: dict[str, Array] = {}
    traces = {
        key: _read(columns, mapping, key, times)
        for key, source in mapping.channels.items()
        if source.signal
    }
    for key in derivation_order(mapping):
        source = mapping.channels[key]
        way = DERIVATIONS[source.derivation]
        inputs = {need: traces[need] for need in (*way.needs, *way.helps) if need in traces}
        derived = derive(way, {need: plausible(need, trace) for need, trace in inputs.items()})
        values = _signed(derived.values, source)
        traces[key] = replace(derived, values=values, bias=source.bias)
    channels = {key: traces[key] for key in in_order(traces)}
    return Traces(channels, tuple(_notes(mapping, channels)))


def applicable(columns: Columns, mapping: Mapping) -> Traces:
    """The channels that can be applied alone, for a mapping that fails as a whole."""
    channels: dict[str, Trace] = {}
    for key in in_order(mapping.channels):
        with suppress(TelemetryError):
            channels[key] = apply_mapping(columns, part_of(mapping, key)).channels[key]
    return Traces(channels)


def derivation_order(mapping: Mapping) -> list[str]:
    """Derived channels, each after its inputs; TelemetryError if there is no such order."""
    pending = {
        key: source.derivation for key, source in mapping.channels.items() if not source.signal
    }
    for key, name in pending.items():
        _check_derivation(mapping, key, name)
    order: list[str] = []
    while pending:
        free = [key for key, name in pending.items() if not _waits(name, pending)]
        if not free:
            raise TelemetryError(
                f"{' and '.join(pending)} depend on each other: map a signal to one of them"
            )
        order += free
        pending = {key: name for key, name in pending.items() if key not in free}
    return order


def _check_derivation(mapping: Mapping, key: str, name: str) -> None:
    way = DERIVATIONS.get(name)
    if way is None or way.target != key:
        known = [way.key for way in DERIVATIONS.values() if way.target == key]
        raise TelemetryError(
            f"{key} cannot be derived by {name!r}: choose {', '.join(known) or 'a signal'}"
        )
    if lacking := [need for need in way.needs if need not in mapping.channels]:
        raise TelemetryError(
            f"{key} is derived from {' and '.join(way.needs)}, but "
            f"{' and '.join(lacking)} is not mapped: map a signal to it"
        )


def _waits(derivation: str, pending: dict[str, str]) -> bool:
    way = DERIVATIONS[derivation]
    return any(key in pending for key in (*way.needs, *way.helps))


def part_of(mapping: Mapping, key: str) -> Mapping:
    channels, wanted = {}, [key]
    while wanted:
        name = wanted.pop()
        if name in mapping.channels and name not in channels:
            channels[name] = mapping.channels[name]
            way = DERIVATIONS.get(channels[name].derivation)
            wanted += (*way.needs, *way.helps) if way else ()
    return Mapping(channels, mapping.times)


def time_zero(contents: Contents, mapping: Mapping) -> str:
    """Zero of the channels' times as the file gives it, see `Contents.start`; "" if it does not."""
    used = {source.signal for source in mapping.channels.values()}
    groups = {contents.groups[s.group] for s in contents.signals if s.name in used}
    times = {name: source.signal for name, source in mapping.times.items()}
    is_known = all(group.time and times.get(group.name) == group.time for group in groups)
    return contents.start if groups and is_known else ""


def _read(columns: Columns, mapping: Mapping, key: str, times: dict[str, Array]) -> Trace:
    source = mapping.channels[key]
    signal = _signal(columns, key, source.signal)
    group = columns.contents.groups[signal.group].name
    if group not in times:
        times[group] = _time(columns, mapping, signal, group)
    raw = np.asarray(columns.raw(signal.name))
    if len(raw) != len(times[group]):
        raise TelemetryError(
            f"{key} comes from {signal.name!r} with {len(raw)} values, but its time has "
            f"{len(times[group])}: choose a time from the same group"
        )
    if problem := source.scaling.problem() or _beyond(source, signal):
        raise TelemetryError(f"{key} ({signal.name}) {problem}")
    why_missing = ""
    if source.bits:
        if has_fractions(raw):
            raise TelemetryError(
                f"{key} has bits {source.bits}, but bits need whole numbers; {signal.name} has "
                "fractions: leave out its bits, or choose the signal with the raw words"
            )
        why_missing = read_bits(source.bits).why_missing(raw)
    try:
        unit = target_of(key, source.unit).unit
        values = _finite(convert(source.scaling(raw), source.unit, unit))
    except TelemetryError as error:
        raise TelemetryError(f"unit of {key} ({signal.name}): {error}") from None
    release(raw)
    values = _signed(values, source)
    return Trace(
        times[group],
        values,
        group,
        signal.name,
        bias=source.bias,
        unit=unit,
        why_missing=why_missing,
    )


def _beyond(source: ChannelSource, signal: Signal) -> str:
    """Why a word of a signal does not have the bits of a source; "" if it may."""
    if not (source.bits and signal.n_bits):
        return ""
    field = read_bits(source.bits)
    if field.kind == "bnr" and signal.n_bits < BITS_429:
        return (
            f"has bits {source.bits}, but no status, which a whole ARINC 429 word has: choose the "
            "signal that ends in /word"
        )
    if field.high > signal.n_bits:
        return f"has bits {source.bits}, but its words have bits 1 to {signal.n_bits}"
    return ""


def _signal(columns: Columns, role: str, name: str) -> Signal:
    try:
        return columns.signal(name)
    except KeyError:
        known = [signal.name for signal in columns.contents.signals]
        names = ", ".join(dict.fromkeys([*get_close_matches(name, known, MOST_CLOSE), *known]))
        raise TelemetryError(
            f"the mapping takes {role} from {name!r}, which is not in the file: choose one of "
            f"{shorten(names, 300, placeholder=' ...')}"
        ) from None


def _time(columns: Columns, mapping: Mapping, signal: Signal, group: str) -> Array:
    """Times of a group (n,) [s]."""
    where = f"the group {group!r}" if group else "the table"
    if group not in mapping.times:
        why = (
            f"{signal.name!r} has no time: choose a signal as the time of {where}, or give "
            "the sample rate, such as 50 Hz"
        )
        raise TelemetryError(repeated_time(columns, signal.group) or why)
    source = mapping.times[group]
    if problem := source.problem():
        raise TelemetryError(f"the time of {where} {problem}")
    if source.rate:
        n_rows = columns.contents.groups[signal.group].n_rows
        return source.start + np.arange(n_rows) / source.rate
    values = np.asarray(columns.values(_signal(columns, "time", source.signal).name))
    if why := no_clock(source.signal, values):
        raise TelemetryError(why)
    try:
        return _finite(convert(values, source.unit, "s"))
    except TelemetryError as error:
        raise TelemetryError(f"unit of the time {source.signal}: {error}") from None


def _without_time(columns: Columns, mapping: Mapping) -> str:
    """Why signals have no time, if a signal is named as the time but is not usable."""
    contents = columns.contents
    reasons = [
        why
        for number, group in enumerate(contents.groups)
        if group.name not in mapping.times and (why := dead_time(columns, number))
    ]
    return "; ".join(reasons)


def _finite(values: Array) -> Array:
    return np.where(np.isinf(values), np.nan, values) if np.isinf(values).any() else values


def _signed(values: Array, source: ChannelSource) -> Array:
    if source.sign < 0:
        values = -values
    return values - source.bias if source.bias else values


def _notes(mapping: Mapping, channels: dict[str, Trace]) -> list[str]:
    sources = {key: mapping.channels[key] for key in channels}
    scaled = [f"{key} = {source.scaling}" for key, source in sources.items() if str(source.scaling)]
    converted = [
        f"{key} from {spelled(source.unit)}"
        for key, source in sources.items()
        if source.signal and spelled(source.unit) not in ("", channels[key].unit)
    ]
    reversed_ = [key for key, source in sources.items() if source.sign < 0]
    shifted = [
        f"{key} {target_of(key, source.unit).read(source.bias)}"
        for key, source in sources.items()
        if source.bias
    ]
    derived = [
        f"{key} ({channels[key].source.removeprefix('derived: ')})"
        for key in channels
        if channels[key].derived
    ]
    used = {trace.group for trace in channels.values()}
    by_rate = [
        f"{rate_words(source)}{f' ({group})' if group else ''}"
        for group, source in mapping.times.items()
        if source.rate and group in used
    ]
    changes = (
        ("Scaled", scaled),
        ("Converted", converted),
        ("Sign reversed", reversed_),
        ("Bias removed", shifted),
        ("Derived, not measured", derived),
        ("Times computed from the sample rate, not recorded", by_rate),
    )
    return [f"{change}: {', '.join(parts)}." for change, parts in changes if parts]
