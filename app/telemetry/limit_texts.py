"""Limits and computed channels of own rollouts, as people write them.

Nz=-1.4..4.9g    alpha=..12deg    Nz=..4.9 for 0.2 s    load [kN] = 0.7*Nz*mass
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.telemetry.recording import TelemetryError
from app.telemetry.rollouts import RolloutFile
from app.telemetry.targets import check_limits
from app.telemetry.units import PLAIN, convert, si_unit
from core.channels import KEYS, LATERAL, Channel, Dictionary, channel
from core.computed import complete, lasting
from core.limits.limits import IntervalLimits, Limits
from core.limits.temporal import COMPARED, Requirement
from core.simulation.stability_margins import UNITS, LeastMargins
from core.types import Array

VALUE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*((?:[A-Za-z°%]\S*)?)")
"""A number and an optional unit."""
COMPUTED = re.compile(r"\s*([^=\[\]]*[^=\[\]\s])\s*(?:\[([^=\[\]]*)\])?\s*=(.*)", re.DOTALL)
"""KEY [UNIT] = FORMULA."""

JUDGED = "requirement_"
"""Begins the keys of requirements that are judged sample by sample."""

MARGIN = re.compile(r"\s*(gain|phase|disk)\s+margin\s*>=?\s*(\d+\.?\d*|\.\d+)\s*([A-Za-z°]*)\s*")
"""phase margin > 30 deg."""
MARGIN_WORDS = "'gain margin > 6 dB', 'phase margin > 30 deg' or 'disk margin > 0.4'"

Ends = tuple[float | None, float | None]
"""Low and high; None: no limit on that side."""


class Specified(NamedTuple):
    """A dictionary with computed channels, its limits, and requirements that only label flights."""

    dictionary: Dictionary
    limits: Limits | IntervalLimits | None
    requirements: tuple[Requirement, ...] = ()


def margin_bounds(limits: Sequence[str]) -> dict[str, float]:
    """Parameters of `LeastMargins`; empty if the limits are of another kind. TelemetryError."""
    bounds: dict[str, float] = {}
    for text in limits:
        if " margin" not in text:
            continue
        if not (match := MARGIN.fullmatch(text)):
            raise TelemetryError(f"{text!r}: write its least value as {MARGIN_WORDS}")
        kind, least, unit = match[1], float(match[2]), match[3].replace("°", "deg")
        if unit != UNITS[kind]:
            named = f"in {UNITS[kind]}" if UNITS[kind] else "without a unit"
            raise TelemetryError(f"{text!r}: a {kind} margin is {named}: write {MARGIN_WORDS}")
        name = f"{kind}_{UNITS[kind].lower()}".rstrip("_")
        try:
            LeastMargins(**{name: least})
        except ValueError as error:
            raise TelemetryError(f"{text!r}: {str(error).partition(': ')[2]}") from None
        if name in bounds:
            raise TelemetryError(f"{text!r}: the {kind} margin has two least values: omit one")
        bounds[name] = least
    if 0 < len(bounds) < len(limits):
        given = next(text for text in limits if " margin" in text)
        raise TelemetryError(
            f"{given!r} labels the rollouts, so other limits have no effect: omit one"
        )
    return bounds


def specified(flights: RolloutFile, channels: Sequence[str], limits: Sequence[str]) -> Specified:
    """The dictionary of flights with computed channels, and limits; None without any.

    A limit with a time, `Nz=..4.9 for 0.2 s`, is one on a separate computed channel, and so is a
    requirement that needs no later sample. Of channels that are absolute, the first samples are
    trimmed flight.   TelemetryError, ValueError.
    """
    dictionary, ends, requirements = extended(flights.dictionary, channels, limits)
    if requirements and (ends or flights.fail_index is not None):
        raise TelemetryError(
            f"{requirements[0].text!r} needs later samples, so it labels the rollouts: give it "
            "without limits, and rollouts without labels"
        )
    if not ends:
        return Specified(dictionary, None, requirements)
    if dictionary == LATERAL and all(low == -(high or 0) for low, high in ends.values()):
        magnitudes = dict.fromkeys(KEYS) | {k: high for k, (_, high) in ends.items()}
        return Specified(dictionary, Limits(**magnitudes))
    first = complete(dictionary, flights.y[:, :1], flights.dt)[:, 0]
    known = {each.key: rest_of(first[:, c], each) for c, each in enumerate(dictionary.channels)}
    return Specified(dictionary, IntervalLimits.of(dictionary, ends, known))


def extended(
    dictionary: Dictionary, channels: Sequence[str], limits: Sequence[str]
) -> tuple[Dictionary, dict[str, Ends], tuple[Requirement, ...]]:
    """The dictionary with computed channels, limits by key, and requirements that need later
    samples.   TelemetryError, ValueError.
    """
    if margin_bounds(limits):
        raise TelemetryError(
            f"{limits[0]!r} is of a control loop, which rollouts and simulators of others do "
            "not show: give it to forewarn train with an aircraft that Forewarn simulates"
        )
    dictionary = dictionary.plus(*map(computed_channel, channels))
    ends: dict[str, Ends] = {}
    ahead: list[Requirement] = []
    for text in limits:
        if any(sign in text for sign in COMPARED):
            requirement = Requirement.parse(text, dictionary.keys)
            if requirement.formula is None:
                ahead.append(requirement)
                continue
            judged = _robustness(requirement, dictionary)
            dictionary = dictionary.plus(judged)
            ends[judged.key] = 0.0, None
            continue
        known, low, high, seconds = _limit(text, dictionary)
        check_limits(known, low, high)
        if seconds is None:
            ends[known.key] = low, high
            continue
        for added, interval in _lasting(known, low, high, seconds):
            if added.key not in dictionary.keys:
                dictionary = dictionary.plus(added)
            ends[added.key] = interval
    return dictionary, ends, tuple(ahead)


def _robustness(requirement: Requirement, dictionary: Dictionary) -> Channel:
    """The channel that is 0 where a requirement begins to be violated."""
    n = 1 + sum(key.startswith(JUDGED) for key in dictionary.keys)
    key, formula = f"{JUDGED}{n}", requirement.formula or ""
    known = channel(key, key, PLAIN, requirement.text, "output", "absolute")
    return replace(known, formula=formula)


def computed_channel(text: str) -> Channel:
    """The channel of `load [kN] = 0.7*Nz*mass`. TelemetryError."""
    match = COMPUTED.fullmatch(text)
    if match is None:
        raise TelemetryError(
            f"channel {text!r}: write it as KEY [UNIT] = FORMULA, such as load [N] = 0.7*Nz*mass"
        )
    key, unit, formula = match[1], (match[2] or "").strip() or PLAIN, match[3].strip()
    si_unit(unit)  # refuses an unknown one
    return replace(channel(key, key, unit, key, "output", "absolute"), formula=formula)


def _limit(
    text: str, dictionary: Dictionary
) -> tuple[Channel, float | None, float | None, float | None]:
    """Channel, low, high and seconds of `Nz=-1.4..4.9g for 0.2 s`, or of `Ny=0.5g`, a magnitude."""
    key, _, rest = text.partition("=")
    known = dictionary.channels[dictionary.index(key.strip())]
    interval, lasts, duration = rest.partition(" for ")
    low, dots, high = interval.partition("..")
    unit = VALUE.fullmatch(high.strip() or low.strip())
    shared = unit[2] if unit else ""
    if dots:
        least, most = (_number(end, shared, known, text) for end in (low, high))
        if least is not None and most is not None and least >= most:
            raise TelemetryError(
                f"{text!r}: low is not below high: write it as {known.key}=LOW..HIGH"
            )
    else:
        most = _number(interval, shared, known, text)
        least = None if most is None else -most
    if least is None and most is None:
        raise TelemetryError(f"{text!r}: no limit was given: give low, high or both")
    return known, least, most, _seconds(duration, text) if lasts else None


def _lasting(
    known: Channel, low: float | None, high: float | None, seconds: float
) -> list[tuple[Channel, Ends]]:
    """A channel for each end: what it limits is above it, or below it, for the time."""
    channels: list[tuple[Channel, Ends]] = []
    if high is not None:
        channels.append((lasting(known, seconds, "above"), (None, high)))
    if low is not None:
        channels.append((lasting(known, seconds, "below"), (low, None)))
    return channels


def _seconds(duration: str, text: str) -> float:
    match = VALUE.fullmatch(duration.strip())
    if match is None:
        raise TelemetryError(f"{text!r}: write the time as 0.2 s, such as Nz=..4.9 for 0.2 s")
    return float(convert(np.array([float(match[1])]), match[2] or "s", "s")[0])


def _number(end: str, shared: str, known: Channel, text: str) -> float | None:
    """One end of a limit in the channel's unit; None if it is empty.

    shared: unit of the other end, which holds for both.
    """
    if not end.strip():
        return None
    match = VALUE.fullmatch(end.strip())
    if match is None:
        raise TelemetryError(
            f"{text!r}: write it as {known.key}=LOW..HIGH, such as {known.key}=-1..4"
        )
    number, unit = np.array([float(match[1])]), match[2] or shared
    if not np.isfinite(number[0]):
        raise TelemetryError(f"{text!r}: {match[1]} is too large: leave a side without limit empty")
    if not unit and known.largest is not None and abs(number[0]) > known.largest:
        raise TelemetryError(
            f"{text!r}: {match[1]} {known.unit} is more than any aircraft reaches, "
            f"{known.largest:.3g} {known.unit}: write the unit, such as {match[1]} "
            f"{known.display_unit}"
        )
    return float(convert(number, unit or known.unit, known.unit)[0])


def rest_of(first: Array, known: Channel) -> float:
    """Value in trimmed flight.   first: (n,) the first one of each flight, NaN if missing."""
    there = first[np.isfinite(first)]
    return float(np.median(there)) if known.reference == "absolute" and len(there) else 0.0
