"""Signals that could be a channel: by name, unit and reach; and which is given to which."""

from dataclasses import dataclass, field, replace

from app.telemetry.contents import Columns, Signal
from app.telemetry.extent import Extent, extent
from app.telemetry.mapping.magnitudes import possible, possible_units
from app.telemetry.mapping.names import Reading, readings
from app.telemetry.targets import TARGETS
from app.telemetry.units import PLAIN, UNSAID, factor, fits, spelled
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

    certainty: of name, unit and reach together, 0 to 1.   unit: in our spelling; "" where none is
    said, and then the reach will tell.
    """

    key: str
    signal: Signal
    certainty: float
    unit: str
    reach: Extent = field(repr=False)
    stem: str = ""
    reasons: tuple[str, ...] = ()


@dataclass(eq=False)
class Candidates:
    """by_key: the surest first.   refused: channel -> why a signal of its name is not it."""

    by_key: dict[str, list[Candidate]] = field(default_factory=dict)
    refused: dict[str, list[str]] = field(default_factory=dict)


def find_candidates(columns: Columns, usable: set[int], taken: set[str]) -> Candidates:
    """Judge all signals of the groups that have a time, without those that are taken."""
    found = Candidates()
    contents = columns.contents
    for signal in contents.signals:
        if signal.group not in usable or signal.name in taken:
            continue
        known = readings(signal.name, contents.groups[signal.group].name)
        meant = [reading for reading in known if reading.key in TARGETS]
        if not meant:
            continue
        reach = extent(columns.values(signal.name))
        for reading in meant:
            judged = _judge(signal, reading, reach)
            if isinstance(judged, str):
                found.refused.setdefault(reading.key, []).append(judged)
            elif judged.certainty >= MENTIONED:
                found.by_key.setdefault(reading.key, []).append(judged)
    support = _support(found)
    for candidates in found.by_key.values():
        candidates.sort(key=lambda c: (-round(c.certainty, 3), -support[c.signal.group]))
    return found


def assign(candidates: Candidates, taken: set[str]) -> dict[str, Candidate]:
    """Give each channel its signal: of all pairs the surest first, each signal and channel once.

    taken: channels that have one already.
    """
    pairs = [
        (-candidate.certainty, rank, candidate)
        for key, ranked in candidates.by_key.items()
        if key not in taken
        for rank, candidate in enumerate(ranked)
        if candidate.certainty >= PROPOSED
    ]
    given: dict[str, Candidate] = {}
    used: set[str] = set()
    for _, _, candidate in sorted(pairs, key=lambda pair: pair[:2]):
        if candidate.key not in given and candidate.signal.name not in used:
            given[candidate.key] = candidate
            used.add(candidate.signal.name)
    return given


def _support(found: Candidates) -> dict[int, int]:
    """Channels that each group offers: of equals, the one beside the others is taken."""
    offers: dict[int, set[str]] = {}
    for key, candidates in found.by_key.items():
        for candidate in candidates:
            offers.setdefault(candidate.signal.group, set()).add(key)
    return {group: len(keys & set(KEYS)) for group, keys in offers.items()}


def _judge(signal: Signal, reading: Reading, reach: Extent) -> Candidate | str:
    """The signal as one target; or why it is not."""
    key, name = reading.key, signal.name
    label = TARGETS[key].label
    if reach.empty:
        return f"{name} is named like it, but holds no number in {reach.n} rows"
    if reach.still and key in MUST_MOVE:
        return f"{name} is named like it, but is {reach.lowest:.4g} throughout: it is not connected"
    named = Candidate(
        key, signal, reading.certainty, "", reach, reading.stem, (f"{name} is named as {label} is",)
    )
    said = _with_unit(named, reading)
    if isinstance(said, str):
        return said
    return _told_apart(said) if said.unit else _by_reach(said)


def _with_unit(candidate: Candidate, reading: Reading) -> Candidate | str:
    """Take the unit that the file or the name says, if it can be one of the target."""
    signal, target = candidate.signal, TARGETS[candidate.key]
    in_file = signal.unit.strip().lower() not in UNSAID
    text, where = (signal.unit, "by the file") if in_file else (reading.unit, "by the name")
    if target.unit == PLAIN:
        return replace(candidate, unit=PLAIN)
    if not text:
        return candidate
    unit = spelled(text)
    if not unit:
        why = f"its unit {text!r} is not known"
        return replace(candidate, reasons=(*candidate.reasons, why))
    if target.unit == "rad/s" and unit in ("rad", "deg"):
        why = f"its unit is said to be {unit} {where}, which is taken for {unit}/s"
        return _checked(replace(candidate, certainty=0.85 * candidate.certainty), f"{unit}/s", why)
    if not fits(text, target.unit):
        return f"{signal.name} is named like it, but its unit {unit} is not one of {target.label}"
    if factor(text, target.unit) == factor(target.unit, target.unit):
        unit = target.unit
    surer = candidate.certainty
    if surer >= PROPOSED:  # else it is named as something else is, in the same unit
        surer = 1.0 - 0.35 * (1.0 - surer)
    why = f"its unit is said {where}: {unit}"
    if in_file and reading.unit and spelled(reading.unit) not in ("", unit):
        surer *= 0.7
        why += f", though its name says {reading.unit}"
    return _checked(replace(candidate, certainty=surer), unit, why)


def _checked(candidate: Candidate, unit: str, why: str) -> Candidate | str:
    """Believe a unit unless no aircraft could move so."""
    key, reach = candidate.key, candidate.reach
    if possible(key, reach, unit):
        return replace(candidate, unit=unit, reasons=(*candidate.reasons, why))
    others = [other for other in possible_units(key, reach) if other != unit]
    far = f"it reaches {reach.peak:.4g} {unit}, which no aircraft does"
    if not others or key in ("V", "h", "v"):
        return f"{candidate.signal.name} is named like it, but {far}"
    doubted = f"{why}, but {far}: read as {others[0]}"
    return replace(
        candidate,
        certainty=0.6 * candidate.certainty,
        unit=others[0],
        reasons=(*candidate.reasons, doubted),
    )


def _by_reach(candidate: Candidate) -> Candidate | str:
    """Whether there is any unit in which an aircraft could move so."""
    key, reach = candidate.key, candidate.reach
    if not possible_units(key, reach):
        return (
            f"{candidate.signal.name} is named like it, but reaches {reach.peak:.4g}, which is no "
            f"{TARGETS[key].label} in any unit"
        )
    return _told_apart(candidate)


def _told_apart(candidate: Candidate) -> Candidate:
    """V is positive and lateral velocity is not, where one letter stands for either."""
    key, reach = candidate.key, candidate.reach
    if key == "v" and reach.lowest > 0.0:
        return replace(candidate, certainty=0.2 * candidate.certainty)  # V in lower case
    if key == "V" and reach.lowest < -0.2 * reach.highest:
        return replace(candidate, certainty=0.2 * candidate.certainty)
    return candidate
