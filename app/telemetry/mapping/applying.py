"""A mapping applied to the columns of a file: channels in our units, on the times of the file."""

from dataclasses import replace
from textwrap import shorten
from typing import Any

import numpy as np

from app.telemetry.contents import Columns, Signal
from app.telemetry.mapping.derivations import DERIVATIONS, derive
from app.telemetry.mapping.group_times import dead_time, no_clock
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.plausibility import believed
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import TARGETS
from app.telemetry.traces import Array, Trace, Traces
from app.telemetry.units import convert, spelled

WILD = np.errstate(over="ignore", invalid="ignore", divide="ignore")
"""A file may hold any numbers; what overflows is infinite, and so missing, without a warning."""


@WILD
def apply_mapping(columns: Columns, mapping: Mapping) -> Traces:
    """Read the channels that a mapping names, and derive those that it derives.

    What needs no conversion stays in the memory of the file. An infinity is a missing value, and
    nothing is derived from a value that no aircraft shows.
    Raises TelemetryError, which names the channel, where the mapping does not fit the file.
    """
    if not mapping.channels:
        raise TelemetryError(
            _without_time(columns, mapping)
            or "the mapping names no channel: say which signals are " + ", ".join(list(TARGETS)[:6])
        )
    times: dict[str, Array] = {}
    found = {
        key: _read(columns, mapping, key, times)
        for key, source in mapping.channels.items()
        if source.signal
    }
    for key in derivation_order(mapping):
        source = mapping.channels[key]
        way = DERIVATIONS[source.derivation]
        known = {need: found[need] for need in (*way.needs, *way.helps) if need in found}
        made = derive(way, {need: believed(need, trace) for need, trace in known.items()})
        found[key] = replace(made, values=_signed(made.values, source))
    channels = {key: found[key] for key in TARGETS if key in found}
    return Traces(channels, tuple(_notes(mapping, channels)))


@WILD
def preview(columns: Columns, mapping: Mapping, n: int = 120) -> dict[str, dict[str, Any]]:
    """Small plots by key: t, low and high of at most n equal stretches of rows; unit, min, max.

    In JSON's types, None for what is no number. A channel that cannot be applied is left out.
    """
    try:
        traces = apply_mapping(columns, mapping).channels
    except TelemetryError:
        traces = {}
        for key in mapping.channels:
            try:
                traces[key] = apply_mapping(columns, part_of(mapping, key)).channels[key]
            except TelemetryError:
                continue
    return {key: _tiles(traces[key], TARGETS[key].unit, n) for key in TARGETS if key in traces}


def derivation_order(mapping: Mapping) -> list[str]:
    """Derived channels, each behind what it is derived from; TelemetryError where that is not."""
    ready = {key for key, source in mapping.channels.items() if source.signal}
    pending = {
        key: source.derivation for key, source in mapping.channels.items() if not source.signal
    }
    for key, name in pending.items():
        way = DERIVATIONS.get(name)
        if way is None or way.target != key:
            known = [way.key for way in DERIVATIONS.values() if way.target == key]
            raise TelemetryError(
                f"{key} cannot be derived by {name!r}: choose {', '.join(known) or 'a signal'}"
            )
        if lacking := [need for need in way.needs if need not in mapping.channels]:
            raise TelemetryError(
                f"{key} is to be derived from {' and '.join(way.needs)}, but "
                f"{' and '.join(lacking)} is not mapped: map a signal to it"
            )
    order: list[str] = []
    while pending:
        free = [key for key, name in pending.items() if not _waits(name, pending)]
        if not free:
            raise TelemetryError(
                f"{' and '.join(pending)} would be derived from each other: map a signal to one"
            )
        order += free
        ready |= set(free)
        pending = {key: name for key, name in pending.items() if key not in ready}
    return order


def _waits(derivation: str, pending: dict[str, str]) -> bool:
    way = DERIVATIONS[derivation]
    return any(key in pending for key in (*way.needs, *way.helps))


def part_of(mapping: Mapping, key: str) -> Mapping:
    """Return one channel of a mapping, with all that it is derived from."""
    kept, wanted = {}, [key]
    while wanted:
        name = wanted.pop()
        if name in mapping.channels and name not in kept:
            kept[name] = mapping.channels[name]
            way = DERIVATIONS.get(kept[name].derivation)
            wanted += (*way.needs, *way.helps) if way else ()
    return Mapping(kept, mapping.times)


def _read(columns: Columns, mapping: Mapping, key: str, times: dict[str, Array]) -> Trace:
    """One mapped signal in the target's unit."""
    source = mapping.channels[key]
    signal = _signal(columns, key, source.signal)
    group = columns.contents.groups[signal.group].name
    if group not in times:
        times[group] = _time(columns, mapping, signal, group)
    values = np.asarray(columns.values(signal.name))
    if len(values) != len(times[group]):
        raise TelemetryError(
            f"{key} is taken from {signal.name!r} with {len(values)} values, but its time has "
            f"{len(times[group])}: choose a time of its own group"
        )
    try:
        values = _known(convert(values, source.unit, TARGETS[key].unit))
    except TelemetryError as error:
        raise TelemetryError(f"unit of {key} ({signal.name}): {error}") from None
    return Trace(times[group], _signed(values, source), group, signal.name)


def _signal(columns: Columns, what: str, name: str) -> Signal:
    try:
        return columns.signal(name)
    except KeyError:
        there = shorten(
            ", ".join(s.name for s in columns.contents.signals), 300, placeholder=" ..."
        )
        raise TelemetryError(
            f"the mapping takes {what} from {name!r}, which the file does not hold: choose one of "
            f"{there}"
        ) from None


def _time(columns: Columns, mapping: Mapping, signal: Signal, group: str) -> Array:
    """Times of a group (n,) [s]."""
    if group not in mapping.times:
        where = f"the group {group!r}" if group else "the table"
        raise TelemetryError(
            f"{signal.name!r} has no time: say which signal is the time of {where}"
        )
    source = mapping.times[group]
    values = np.asarray(columns.values(_signal(columns, "time", source.signal).name))
    if why := no_clock(source.signal, values):
        raise TelemetryError(why)
    try:
        return _known(convert(values, source.unit, "s"))
    except TelemetryError as error:
        raise TelemetryError(f"unit of the time {source.signal}: {error}") from None


def _without_time(columns: Columns, mapping: Mapping) -> str:
    """Why the signals of a file go without a time, where what is named as one is none."""
    contents = columns.contents
    reasons = [
        why
        for number, group in enumerate(contents.groups)
        if group.name not in mapping.times and (why := dead_time(columns, number))
    ]
    return "; ".join(reasons)


def _known(values: Array) -> Array:
    return np.where(np.isinf(values), np.nan, values) if np.isinf(values).any() else values


def _signed(values: Array, source: ChannelSource) -> Array:
    if source.sign < 0:
        values = -values
    return values - source.offset if source.offset else values


def _notes(mapping: Mapping, channels: dict[str, Trace]) -> list[str]:
    """What was done to the numbers of the file, a sentence each."""
    sources = {key: mapping.channels[key] for key in channels}
    converted = [
        f"{key} from {spelled(source.unit)}"
        for key, source in sources.items()
        if source.signal and spelled(source.unit) not in ("", TARGETS[key].unit)
    ]
    reversed_ = [key for key, source in sources.items() if source.sign < 0]
    shifted = [
        f"{key} {source.offset:.4g} {TARGETS[key].unit}"
        for key, source in sources.items()
        if source.offset
    ]
    derived = [
        f"{key} ({channels[key].source.removeprefix('derived: ')})"
        for key in channels
        if channels[key].derived
    ]
    said = (
        ("Converted", converted),
        ("Reversed in sign", reversed_),
        ("Constant offset subtracted", shifted),
        ("Derived, not measured", derived),
    )
    return [f"{what}: {', '.join(parts)}." for what, parts in said if parts]


def _tiles(trace: Trace, unit: str, n: int) -> dict[str, Any]:
    rows = len(trace.values)
    if not rows:
        return {"t": [], "low": [], "high": [], "unit": unit, "min": None, "max": None}
    starts = np.linspace(0, rows, min(n, rows), endpoint=False).astype(np.intp)
    middle = (starts + np.append(starts[1:], rows)) // 2
    low, high = np.fmin.reduceat(trace.values, starts), np.fmax.reduceat(trace.values, starts)
    return {
        "t": _plain(trace.t[middle]),
        "low": _plain(low),
        "high": _plain(high),
        "unit": unit,
        "min": _plain(np.fmin.reduce(low, keepdims=True))[0],
        "max": _plain(np.fmax.reduce(high, keepdims=True))[0],
    }


def _plain(numbers: Array) -> list[float | None]:
    return [number if number == number else None for number in numbers.tolist()]
