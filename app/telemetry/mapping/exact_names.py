"""Map signals to channels of any dictionary by exact name and by unit.

Case, spaces, punctuation, the path of the name and a unit at its end do not matter.
"""

import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from app.telemetry.contents import Signal
from app.telemetry.mapping.mapping import ChannelSource, source_of
from app.telemetry.mapping.names import given_unit
from app.telemetry.mapping.proposal_builder import ProposalBuilder, Rationale, as_scaled
from app.telemetry.mapping.spelling import place, unit_suffixes
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import may_be_one_quantity, target_of
from app.telemetry.units import PLAIN, factor, fits, spelled, unit_in, without_unit
from core.channels import Channel

SURE, LESS_SURE = 0.95, 0.9
"""Certainty of the key, and of a name after a path, a name with a unit, a symbol or a label."""
WITHOUT_UNIT = 0.7
"""Factor on the certainty if neither file nor name gives a unit."""
RIVALLED = 0.85
"""Factor on the certainty if another signal has the same name."""


class NamedSignal(NamedTuple):
    """A signal with the name of a channel.

    grade: less is closer.   unit: given by the name, "" for none.
    """

    grade: tuple[int, int, bool]
    channel: Channel
    signal: Signal
    unit: str


def assign_by_name(
    builder: ProposalBuilder, channels: Iterable[Channel], groups: set[int]
) -> dict[str, tuple[str, ...]]:
    """Assign signals of some groups to the channels that have no source yet.

    channels: of several dictionaries, so that a key may come with several units.
    Returns the other signals of each channel's name. A reason explains each that does not fit.
    """
    wanted = [c for c in dict.fromkeys(channels) if c.key not in builder.channels]
    refused: dict[str, list[str]] = {}
    fitting: dict[str, list[str]] = {}
    for match in _in_order(builder, wanted, groups):
        key, source = match.channel.key, _source(builder, match)
        if isinstance(source, str):
            refused.setdefault(key, []).append(source)
            continue
        fitting.setdefault(key, []).append(source.signal)
        if key not in builder.channels and _is_free(builder, key, source):
            _enter(builder, match, source)
    for key, reasons in refused.items():
        if key not in builder.channels:
            builder.rationales[key] = Rationale(0.0, tuple(dict.fromkeys(reasons)))
    others: dict[str, tuple[str, ...]] = {}
    for key, names in fitting.items():
        source = builder.channels.get(key, ChannelSource())
        if rivals := tuple(name for name in dict.fromkeys(names) if name != source.signal):
            others[key] = rivals
            if source.signal:
                builder.comment(key, f"{', '.join(rivals)} would also fit", RIVALLED)
    return others


def _in_order(
    builder: ProposalBuilder, channels: list[Channel], groups: set[int]
) -> list[NamedSignal]:
    """The matches, the closest first; among equals those of the group with most channels."""
    names: dict[str, list[tuple[int, str, Channel]]] = {}
    for channel in channels:
        for rank, name in enumerate((channel.key, channel.symbol, channel.label)):
            names.setdefault(_plain(name), []).append((rank, name, channel))
    times = {source.signal for source in builder.times.values()}
    named = [
        match
        for signal in builder.columns.contents.signals
        if signal.group in groups and signal.name not in times
        for match in _matches(signal, names)
    ]
    offers: dict[int, set[str]] = {}
    for match in named:
        offers.setdefault(match.signal.group, set()).add(match.channel.key)
    return sorted(named, key=lambda match: (match.grade, -len(offers[match.signal.group])))


def _matches(
    signal: Signal, names: Mapping[str, list[tuple[int, str, Channel]]]
) -> Iterable[NamedSignal]:
    """The closest match of a signal with each channel of its name.   names: by `_plain`."""
    closest: dict[Channel, NamedSignal] = {}
    for n, text, unit in _readings(signal.name):
        for rank, name, channel in names.get(_plain(text), ()):
            match = NamedSignal((n, rank, text != name), channel, signal, unit)
            if channel not in closest or match.grade < closest[channel].grade:
                closest[channel] = match
    return closest.values()


def _readings(name: str) -> Iterator[tuple[int, str, str]]:
    """(distance, name, unit): as it is, without a unit, and without its path."""
    path, last = place(name)
    for n, text in enumerate((name, last) if path else (name,)):
        yield 2 * n, text, ""
        yield 2 * n, without_unit(text), unit_in(text)
        yield from ((2 * n + 1, stem, unit) for stem, unit in unit_suffixes(text))


def _plain(name: str) -> str:
    """Letters and digits, without case; all signs of a name without any."""
    plain = unicodedata.normalize("NFKC", name).casefold()
    return "".join(filter(str.isalnum, plain)) or plain


def _source(builder: ProposalBuilder, match: NamedSignal) -> ChannelSource | str:
    """The source of the channel, or why the signal cannot be it."""
    _, channel, signal, of_name = match
    named = f"the name {signal.name} is that of {channel.label}"
    extent = builder.extent(signal.name)
    if extent.empty:
        return f"{named}, but all its {extent.n} rows are empty"
    text, where = given_unit(signal, of_name)
    unit = channel.unit or PLAIN
    if text:
        if not spelled(text):
            return f"{named}, but its unit {text!r} {where} is not a known unit"
        if not fits(text, channel.unit):
            return f"{named}, but its unit {spelled(text)} {where} is not one of {channel.unit}"
        unit = unit if factor(text, channel.unit) == 1.0 else spelled(text)
    elif channel.largest is not None and extent.peak > channel.largest:
        return (
            f"{named}, but no unit is given and values up to {extent.peak:.4g} {unit} are "
            "implausible: choose its unit"
        )
    try:
        factor(unit, target_of(channel.key, unit).unit)
    except TelemetryError as error:
        return f"{named}, but {error}"
    return source_of(builder.columns, signal.name, unit)


def _is_free(builder: ProposalBuilder, key: str, source: ChannelSource) -> bool:
    """Whether no other channel uses the signal, except the same quantity by another name."""
    return all(
        may_be_one_quantity(key, other) and used == source
        for other, used in builder.channels.items()
        if used.signal == source.signal
    )


def _enter(builder: ProposalBuilder, match: NamedSignal, source: ChannelSource) -> None:
    _, channel, signal, of_name = match
    confidence = SURE if match.grade[:2] == (0, 0) else LESS_SURE
    reasons = [f"the name {signal.name} is that of {channel.label}"]
    text, where = given_unit(signal, of_name)
    if text:
        reasons.append(f"its unit {where} is {source.unit}")
    elif source.unit != PLAIN:
        confidence *= WITHOUT_UNIT
        reasons.append(f"no unit is given: taken as {source.unit}, check it")
    reasons += as_scaled(source)
    builder.assign(channel.key, source, round(confidence, 4), *reasons)
