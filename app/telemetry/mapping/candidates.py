"""Find the signals that could be each channel, by name, unit and range; assign the best."""

from dataclasses import dataclass, field, replace

from app.telemetry.contents import Columns, Contents, Signal
from app.telemetry.mapping.magnitudes import Extent, extent_of, plausible_units, unit_is_plausible
from app.telemetry.mapping.names import (
    IN_FILE,
    NameMatch,
    given_unit,
    rates_by_letter,
    signal_matches,
)
from app.telemetry.mapping.spelling import spellings
from app.telemetry.targets import TARGETS
from app.telemetry.units import PLAIN, factor, fits, spelled
from core.channels import KEYS

MUST_MOVE = ("beta", "p", "r", "Ny", "v", "Ay")
"""If one of these is constant its sensor is dead; an aileron or h may well be constant."""
PROPOSED = 0.4
"""Least certainty of a signal that is proposed."""
MENTIONED = 0.15
"""Least certainty of an alternative."""
RECORDED_ONCE = {"beta", "delta_a", "delta_r", "delta_a_left", "delta_a_right"}
"""Channels that groups of one flight do not repeat by the same names; inertial units do."""
SAME_CHANNELS = 3
"""Groups that share so many channels by the same names are separate flights."""


@dataclass(frozen=True)
class Candidate:
    """A signal that may be a channel.

    certainty: by name, unit and range together, 0 to 1.   stem: the part of the name that means
    the channel.   unit: in our spelling; "" if neither file nor name gives one.
    unit_share: probability of an inferred unit; 1 if the unit is given.
    """

    key: str
    signal: Signal
    certainty: float
    unit: str
    extent: Extent = field(repr=False)
    stem: str = ""
    reasons: tuple[str, ...] = ()
    unit_share: float = 1.0

    def because(self, reason: str, factor: float = 1.0, **changes: str) -> "Candidate":
        reasons = (*self.reasons, reason)
        return replace(self, certainty=factor * self.certainty, reasons=reasons, **changes)


@dataclass(eq=False)
class Candidates:
    """by_key: the most certain first.   rejected: channel -> why signals were ruled out.

    groups: those of the flight that is mapped.
    """

    by_key: dict[str, list[Candidate]] = field(default_factory=dict)
    rejected: dict[str, list[str]] = field(default_factory=dict)
    groups: set[int] = field(default_factory=set)


def find_candidates(columns: Columns, usable: set[int], mapped: set[str]) -> Candidates:
    """Judge all signals of usable groups, except those that are already mapped."""
    candidates = Candidates(groups=set(usable))
    contents = columns.contents
    rates = rates_by_letter(contents.signals)
    for signal in contents.signals:
        if signal.group not in usable or signal.name in mapped:
            continue
        names = signal_matches(rates.get(signal.name, signal), contents.groups[signal.group].name)
        if not (matches := [match for match in names if match.key in TARGETS]):
            continue
        extent = extent_of(columns.values(signal.name))
        for match in matches:
            judged = _judge(signal, match, extent)
            if isinstance(judged, str):
                candidates.rejected.setdefault(match.key, []).append(judged)
            elif judged.certainty >= MENTIONED:
                candidates.by_key.setdefault(match.key, []).append(judged)
    support = _support(candidates)
    for ranked in candidates.by_key.values():
        ranked.sort(key=lambda c: (-round(c.certainty, 3), -support[c.signal.group]))
    return candidates


def assign(candidates: Candidates, mapped: set[str]) -> dict[str, Candidate]:
    """Assign signals to channels one to one, the most certain pairs first.

    mapped: channels that already have a source.
    """
    pairs = [
        (-candidate.certainty, rank, candidate)
        for key, ranked in candidates.by_key.items()
        if key not in mapped
        for rank, candidate in enumerate(ranked)
        if candidate.certainty >= PROPOSED
    ]
    assigned: dict[str, Candidate] = {}
    used: set[str] = set()
    for _, _, candidate in sorted(pairs, key=lambda pair: pair[:2]):
        if candidate.key not in assigned and candidate.signal.name not in used:
            assigned[candidate.key] = candidate
            used.add(candidate.signal.name)
    return assigned


def separate_flights(contents: Contents) -> list[int]:
    """Groups that are separate flights, the most complete first; [] if groups make one flight.

    They repeat each other's channels under the same names, like structures of manoeuvres.
    """
    named: dict[int, set[tuple[str, tuple[str, ...]]]] = {}
    for signal in contents.signals if len(contents.groups) > 1 else ():
        words = spellings(signal.name)[0].words
        for match in signal_matches(signal, contents.groups[signal.group].name):
            if match.key in TARGETS and match.certainty >= PROPOSED:
                named.setdefault(signal.group, set()).add((match.key, words))

    def repeats(group: int, other: int) -> bool:
        keys = {key for key, _ in named[group] & named[other]}
        return group != other and len(keys) >= SAME_CHANNELS and bool(keys & RECORDED_ONCE)

    flights = [group for group in named if any(repeats(group, other) for other in named)]
    return sorted(flights, key=lambda group: (-len({key for key, _ in named[group]}), group))


def _support(candidates: Candidates) -> dict[int, int]:
    """Number of channels that each group offers, to prefer one group among equals."""
    offers: dict[int, set[str]] = {}
    for key, ranked in candidates.by_key.items():
        for candidate in ranked:
            offers.setdefault(candidate.signal.group, set()).add(key)
    return {group: len(keys & set(KEYS)) for group, keys in offers.items()}


def _judge(signal: Signal, match: NameMatch, extent: Extent) -> Candidate | str:
    """The candidate, or why the signal is not the channel that its name suggests."""
    key = match.key
    named = f"the name {signal.name} suggests {TARGETS[key].label}"
    if extent.empty:
        return f"{named}, but all its {extent.n} rows are empty"
    if extent.still and key in MUST_MOVE:
        at = f"{extent.lowest:.4g}"
        return f"{named}, but it is constant at {at}: check its sensor and connection"
    candidate = Candidate(key, signal, match.certainty, "", extent, match.stem, (named,))
    judged = _with_unit(candidate, match)
    if isinstance(judged, str):
        return f"{named}, but {judged}"
    if not judged.unit and not plausible_units(key, extent):
        return f"{named}, but its values up to {extent.peak:.4g} are implausible in any unit"
    # airspeed V is positive and lateral velocity v is not; one letter stands for both
    is_positive, swings = extent.lowest > 0.0, extent.lowest < -0.2 * extent.highest
    if (key == "v" and is_positive) or (key == "V" and swings):
        return replace(judged, certainty=0.2 * judged.certainty)
    return judged


def _with_unit(candidate: Candidate, match: NameMatch) -> Candidate | str:
    """Apply the unit that the file or the name gives, or say why it does not fit the channel."""
    signal, target = candidate.signal, TARGETS[candidate.key]
    if target.unit == PLAIN:
        return replace(candidate, unit=PLAIN)
    text, where = given_unit(signal, match.unit)
    if not text:
        return candidate
    unit = spelled(text)
    if not unit:
        return candidate.because(f"its unit {text!r} {where} is not a known unit", 0.8)
    why, certainty = f"its unit {where} is {unit}", candidate.certainty
    if target.unit == "rad/s" and unit in ("rad", "deg"):
        why, unit, certainty = f"{why}, taken as {unit}/s", f"{unit}/s", 0.85 * certainty
    elif not fits(text, target.unit):
        return f"its unit {unit} does not fit"
    else:
        if factor(text, target.unit) == 1.0:
            unit = target.unit
        if certainty >= PROPOSED:  # else the name suggests another quantity with the same unit
            certainty = 1.0 - 0.35 * (1.0 - certainty)
        if where == IN_FILE and match.unit and spelled(match.unit) not in ("", unit):
            certainty *= 0.7
            why += f", although its name gives {match.unit}"
    candidate = replace(candidate, certainty=certainty)
    key, extent = candidate.key, candidate.extent
    if unit_is_plausible(key, extent, unit):
        return candidate.because(why, unit=unit)
    implausible = f"values up to {extent.peak:.4g} {unit} are implausible"
    others = [other for other in plausible_units(key, extent) if other != unit]
    if not others or key in ("V", "h", "v"):
        return f"its {implausible}"
    return candidate.because(f"{why}, but {implausible}: taken as {others[0]}", 0.6, unit=others[0])
