"""Signals that could be a channel, by name, unit and extent; and which is assigned to which."""

from dataclasses import dataclass, field, replace

from app.telemetry.contents import Columns, Signal
from app.telemetry.mapping.extent import Extent, extent_of
from app.telemetry.mapping.magnitudes import plausible_units, unit_is_plausible
from app.telemetry.mapping.naming.descriptions import rates_by_letter, signal_matches
from app.telemetry.mapping.naming.names import NameMatch
from app.telemetry.targets import TARGETS
from app.telemetry.units import NOT_GIVEN, PLAIN, factor, fits, spelled
from core.channels import KEYS

MUST_MOVE = ("beta", "p", "r", "Ny", "v", "Ay")
"""A constant one of these is a dead sensor; an aileron may be left alone, and h be held."""
PROPOSED = 0.4
"""Certainty from which a signal is proposed."""
MENTIONED = 0.15
"""Certainty from which it is an alternative."""


@dataclass(frozen=True)
class Candidate:
    """A signal as a channel.

    certainty: of name, unit and extent together, 0 to 1.   stem: what of the name means the
    channel.   unit: in our spelling; "" where neither file nor name gives one.
    unit_share: how likely an inferred unit is; 1 where it is given.
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
        """The same with another reason, which multiplies the certainty by a factor."""
        reasons = (*self.reasons, reason)
        return replace(self, certainty=factor * self.certainty, reasons=reasons, **changes)


@dataclass(frozen=True)
class Rejection:
    """Why a signal that is named like a channel is not it."""

    reason: str


@dataclass(eq=False)
class Candidates:
    """by_key: the most certain first.   rejected: channel -> why signals of its name are not it."""

    by_key: dict[str, list[Candidate]] = field(default_factory=dict)
    rejected: dict[str, list[str]] = field(default_factory=dict)


def find_candidates(columns: Columns, usable: set[int], mapped: set[str]) -> Candidates:
    """Judge all signals of the groups that have a time, except those that are mapped already."""
    candidates = Candidates()
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
            if isinstance(judged, Rejection):
                candidates.rejected.setdefault(match.key, []).append(judged.reason)
            elif judged.certainty >= MENTIONED:
                candidates.by_key.setdefault(match.key, []).append(judged)
    support = _support(candidates)
    for ranked in candidates.by_key.values():
        ranked.sort(key=lambda c: (-round(c.certainty, 3), -support[c.signal.group]))
    return candidates


def assign(candidates: Candidates, mapped: set[str]) -> dict[str, Candidate]:
    """Assign signals to channels: of all pairs the most certain first, each of both once.

    mapped: channels that have a source already.
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


def _support(candidates: Candidates) -> dict[int, int]:
    """Channels that each group offers: of equals, the one beside the others is taken."""
    offers: dict[int, set[str]] = {}
    for key, ranked in candidates.by_key.items():
        for candidate in ranked:
            offers.setdefault(candidate.signal.group, set()).add(key)
    return {group: len(keys & set(KEYS)) for group, keys in offers.items()}


def _judge(signal: Signal, match: NameMatch, extent: Extent) -> Candidate | Rejection:
    """The signal as one target; or why it is not."""
    key, label = match.key, TARGETS[match.key].label
    named = f"{signal.name} is named like {label}"
    if extent.empty:
        return Rejection(f"{named}, but has no value in any of its {extent.n} rows")
    if extent.still and key in MUST_MOVE:
        return Rejection(
            f"{named}, but is constant at {extent.lowest:.4g}: check that its sensor is connected"
        )
    candidate = Candidate(key, signal, match.certainty, "", extent, match.stem, (named,))
    with_unit = _with_unit(candidate, match)
    if isinstance(with_unit, Rejection):
        return with_unit
    if not with_unit.unit and not plausible_units(key, extent):
        return Rejection(
            f"{named}, but its values up to {extent.peak:.4g} are implausible in any unit"
        )
    return _told_apart(with_unit)


def _with_unit(candidate: Candidate, match: NameMatch) -> Candidate | Rejection:
    """Take the unit that the file or the name gives, if it can be one of the target."""
    signal, target = candidate.signal, TARGETS[candidate.key]
    if target.unit == PLAIN:
        return replace(candidate, unit=PLAIN)
    in_file = signal.unit.strip().lower() not in NOT_GIVEN
    text, where = (signal.unit, "in the file") if in_file else (match.unit, "in its name")
    if not text:
        return candidate
    unit = spelled(text)
    if not unit:
        return candidate.because(f"its unit {text!r} {where} is not a known unit")
    if target.unit == "rad/s" and unit in ("rad", "deg"):
        why = f"its unit {where} is {unit}, taken as {unit}/s"
        return _checked(replace(candidate, certainty=0.85 * candidate.certainty), f"{unit}/s", why)
    if not fits(text, target.unit):
        return Rejection(
            f"{signal.name} is named like {target.label}, but {unit} is not a unit of it"
        )
    if factor(text, target.unit) == factor(target.unit, target.unit):
        unit = target.unit
    certainty = candidate.certainty
    if certainty >= PROPOSED:  # else it is named as something else is, in the same unit
        certainty = 1.0 - 0.35 * (1.0 - certainty)
    why = f"its unit {where} is {unit}"
    if in_file and match.unit and spelled(match.unit) not in ("", unit):
        certainty *= 0.7
        why += f", although its name gives {match.unit}"
    return _checked(replace(candidate, certainty=certainty), unit, why)


def _checked(candidate: Candidate, unit: str, why: str) -> Candidate | Rejection:
    """Accept a unit in which the values are plausible, else try another."""
    key, extent = candidate.key, candidate.extent
    if unit_is_plausible(key, extent, unit):
        return candidate.because(why, unit=unit)
    others = [other for other in plausible_units(key, extent) if other != unit]
    implausible = f"values up to {extent.peak:.4g} {unit} are implausible"
    if not others or key in ("V", "h", "v"):
        name, label = candidate.signal.name, TARGETS[key].label
        return Rejection(f"{name} is named like {label}, but its {implausible}")
    reason = f"{why}, but {implausible}: taken as {others[0]}"
    return candidate.because(reason, 0.6, unit=others[0])


def _told_apart(candidate: Candidate) -> Candidate:
    """V is positive and lateral velocity is not, where one letter stands for either."""
    key, extent = candidate.key, candidate.extent
    if key == "v" and extent.lowest > 0.0:
        return replace(candidate, certainty=0.2 * candidate.certainty)  # V in lower case
    if key == "V" and extent.lowest < -0.2 * extent.highest:
        return replace(candidate, certainty=0.2 * candidate.certainty)
    return candidate
