"""What the signals of a file most likely are: a mapping to look over, with reasons."""

from dataclasses import dataclass, field

from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import WILD
from app.telemetry.mapping.candidates import (
    PROPOSED,
    Candidate,
    Candidates,
    assign,
    find_candidates,
)
from app.telemetry.mapping.derivations import DERIVATIONS, ways
from app.telemetry.mapping.draft import Draft, Guess
from app.telemetry.mapping.evidence import weigh
from app.telemetry.mapping.group_times import dead_time, find_time
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.mapping.names import readings
from app.telemetry.mapping.remembering import recall
from app.telemetry.mapping.signs import CONVENTION
from app.telemetry.mapping.unsaid_units import settle_units
from app.telemetry.targets import TARGETS
from core.channels import KEYS
from core.simulation.attitude import SurfaceSigns

RIVALS = 0.08
"""Signals whose certainty differs by less would do as well."""
DERIVED = 0.7
"""Confidence in a derived channel, as a share of that in what it is derived from."""
DERIVED_FROM = 0.4
"""Confidence that each of its inputs must have."""
DERIVED_FIRST = ("phi", "theta", "psi")
"""Others are derived from these."""
MOST_NAMED = 8

__all__ = ["Guess", "Proposal", "propose"]


@dataclass(frozen=True)
class Proposal:
    """A mapping and why.

    guesses: by key of TARGETS, or "t:" and the name of a group; channels without a source too,
        where there is something to say of them.
    alternatives: key -> signals that it could be instead, the likeliest first.
    derivable: key -> derivations that what is mapped suffices for.
    missing: channels of the monitor without any source.
    """

    mapping: Mapping
    guesses: dict[str, Guess] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    derivable: dict[str, tuple[str, ...]] = field(default_factory=dict)
    missing: tuple[str, ...] = ()


@WILD
def propose(
    columns: Columns,
    remembered: Mapping | None = None,
    *,
    aircraft: str = "",
    expected: SurfaceSigns = CONVENTION,
) -> Proposal:
    """Propose what the signals of a file are, by names, units, reach and motion.

    remembered: a confirmed mapping, which is taken wherever the file has its signals.
    aircraft: whom it was confirmed for, in words.
    expected: which way the monitor's aircraft goes at positive deflections.
    """
    draft = Draft(columns)
    if remembered is not None:
        recall(draft, remembered, aircraft)
    _find_times(draft)
    taken = {source.signal for source in (*draft.channels.values(), *draft.times.values())}
    contents = columns.contents
    usable = {n for n, group in enumerate(contents.groups) if group.name in draft.times}
    candidates = find_candidates(columns, usable, taken)
    given = settle_units(assign(candidates, set(draft.channels)))
    for key in TARGETS:
        if key in given:
            _take(draft, given[key], candidates)
    _derive(draft)
    weigh(draft, expected)
    _explain_missing(draft, candidates)
    return Proposal(
        Mapping(
            {key: draft.channels[key] for key in TARGETS if key in draft.channels}, draft.times
        ),
        draft.guesses,
        _alternatives(draft, candidates),
        _derivable(draft),
        tuple(key for key in KEYS if key not in draft.channels),
    )


def _find_times(draft: Draft) -> None:
    """The time of each group; a group without one is not used, which its guess says."""
    contents = draft.columns.contents
    for number, group in enumerate(contents.groups):
        if group.name in draft.times:
            continue
        if found := find_time(draft.columns, number):
            draft.times[group.name] = found.source
            draft.guesses[f"t:{group.name}"] = Guess(round(found.confidence, 4), found.reasons)
            continue
        names = [signal.name for signal in contents.signals if signal.group == number]
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        why = "it has fewer than two rows" if group.n_rows < 2 else "none of its signals is a time"
        listed = f"{', '.join(names[:MOST_NAMED])}{more}"
        unused = f"{why}, so it is not used: {listed}"
        if dead := dead_time(draft.columns, number):
            unused = f"{dead}, until then it is not used: {listed}"
        draft.guesses[f"t:{group.name}"] = Guess(0.0, (unused,))


def _take(draft: Draft, candidate: Candidate, candidates: Candidates) -> None:
    """Enter a candidate, less sure where another would do as well."""
    key, name = candidate.key, candidate.signal.name
    source = ChannelSource(name, candidate.unit)
    draft.take(key, source, round(candidate.certainty, 4), *candidate.reasons)
    if any(reason.startswith("no unit is said") for reason in candidate.reasons):
        draft.unsaid.add(key)
    ranked = candidates.by_key[key]
    named = next(other for other in ranked if other.signal.name == name)
    rivals = [
        other.signal.name
        for other in ranked
        if other is not named and other.certainty > named.certainty - RIVALS
    ]
    if rivals:
        draft.comment(key, f"{', '.join(rivals[:MOST_NAMED])} would do as well", 0.85)


def _derive(draft: Draft) -> None:
    """Propose a derivation for what has no signal, where all that it needs has."""
    for key in (*DERIVED_FIRST, *KEYS):
        if key in draft.channels:
            continue
        for way in DERIVATIONS.values():
            if way.target != key or not all(need in draft.channels for need in way.needs):
                continue
            sure = min(draft.guesses[need].confidence for need in way.needs)
            if sure >= DERIVED_FROM:
                reason = f"no signal of the file is it: derived as {way.title}"
                source = ChannelSource(derivation=way.key)
                draft.take(key, source, round(DERIVED * sure, 4), reason)
                break


def _explain_missing(draft: Draft, candidates: Candidates) -> None:
    """Say of each channel without a source why, and what could derive it."""
    timeless = _timeless(draft)
    for key, target in TARGETS.items():
        refused = [*timeless.get(key, []), *candidates.refused.get(key, [])]
        if key in draft.channels:
            continue
        reasons = [*draft.guesses.get(key, Guess(0.0)).reasons, *refused[:MOST_NAMED]]
        if key in KEYS:
            if not reasons:
                reasons.append(f"no signal is named as {target.label} is")
            if made_of := ways(key):
                reasons.append(f"it could be derived from {made_of}")
        if reasons:
            draft.guesses[key] = Guess(0.0, tuple(reasons))


def _timeless(draft: Draft) -> dict[str, list[str]]:
    """Signals named as a channel is that nothing times, by channel, in words."""
    contents = draft.columns.contents
    found: dict[str, list[str]] = {}
    dead: dict[int, str] = {}
    for signal in contents.signals:
        group = contents.groups[signal.group]
        if group.name in draft.times:
            continue
        for reading in readings(signal.name, group.name):
            if reading.key in TARGETS and reading.certainty >= PROPOSED:
                if signal.group not in dead:
                    dead[signal.group] = dead_time(draft.columns, signal.group)
                why = dead[signal.group] or "nothing in its group is a time"
                label = TARGETS[reading.key].label
                text = f"{signal.name} is named as {label} is, but has no time: {why}"
                found.setdefault(reading.key, []).append(text)
    return found


def _alternatives(draft: Draft, candidates: Candidates) -> dict[str, tuple[str, ...]]:
    found = {}
    for key, ranked in candidates.by_key.items():
        chosen = draft.channels[key].signal if key in draft.channels else ""
        if names := tuple(c.signal.name for c in ranked if c.signal.name != chosen):
            found[key] = names
    return found


def _derivable(draft: Draft) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    for way in DERIVATIONS.values():
        if all(need in draft.channels for need in way.needs):
            found[way.target] = (*found.get(way.target, ()), way.key)
    return found
