"""Propose a mapping from the signals of a file to channels, with confidence and reasons."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import ANY_NUMBERS
from app.telemetry.mapping.candidates import (
    PROPOSED,
    Candidate,
    Candidates,
    assign,
    find_candidates,
    separate_flights,
)
from app.telemetry.mapping.checks import check_against_motion, doubt_normalised, remove_bias
from app.telemetry.mapping.derivations import DERIVATIONS, ways
from app.telemetry.mapping.exact_names import assign_by_name
from app.telemetry.mapping.group_times import (
    DOUBTED,
    TimeProposal,
    dead_time,
    find_time,
    repeated_time,
)
from app.telemetry.mapping.inferred_units import decide_units
from app.telemetry.mapping.mapping import (
    EXAMPLE,
    ChannelSource,
    Mapping,
    TimeSource,
    rate_words,
    source_of,
)
from app.telemetry.mapping.names import signal_matches
from app.telemetry.mapping.proposal_builder import (
    ProposalBuilder,
    Rationale,
    as_scaled,
    recall,
)
from app.telemetry.mapping.recorded_motion import choose_rates
from app.telemetry.mapping.signs import CONVENTION
from app.telemetry.recording import ATTITUDE, TelemetryError
from app.telemetry.targets import KNOWN, TARGETS, in_order
from core.channels import KEYS, LATERAL, Channel, Dictionary
from core.simulation.attitude import SurfaceSigns

RIVALS = 0.08
"""Signals whose certainty differs by less are rivals."""
DERIVED = 0.7
"""Confidence in a derived channel, as a share of the confidence in its inputs."""
DERIVED_FROM = 0.4
"""Least confidence in each input of a derivation."""
DERIVED_FIRST = ("phi", "theta", "psi")
"""Inputs of other derivations."""
MOST_NAMED = 8
UNCHECKED = {
    "V": "the flight condition is not compared with the monitor's",
    "phi": "roll rate and lateral acceleration are not checked against it",
    "psi": "the yaw rate is not checked against it",
}
"""Checks that a missing channel prevents; attitude only checks lateral channels."""
NO_TIME = f"no signal is a time: choose one as the time, or give the sample rate ({EXAMPLE})"


@dataclass(frozen=True)
class Proposal:
    """A mapping with its reasons.

    rationales: by key, or "t:" and the name of a group. A channel without a source can have one.
    alternatives: key -> other signals that fit, the likeliest first.
    derivable: key -> derivations whose inputs are mapped.
    missing: channels of the monitor without a source.
    notes: sentences about the mapping as a whole.
    """

    mapping: Mapping
    rationales: dict[str, Rationale] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    derivable: dict[str, tuple[str, ...]] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@ANY_NUMBERS
def propose(
    columns: Columns,
    remembered: Mapping | None = None,
    *,
    aircraft: str = "",
    expected: SurfaceSigns = CONVENTION,
    rate: TimeSource | None = None,
    group: str = "",
    dictionary: Dictionary = LATERAL,
    others: Iterable[Channel] = (),
    removes_bias: bool = True,
) -> Proposal:
    """Propose a mapping: TARGETS by names, units, ranges and motion, others by exact name.

    remembered: a confirmed mapping; it applies to each of its signals that the file has.
    aircraft: name of the aircraft that it was confirmed for.
    expected: how the monitor's aircraft responds to positive deflections.
    rate: sample rate given by a person, for groups without a time signal.
    group: the flight to map, if groups are separate flights; "" for the most complete.
    dictionary: of the monitor; computed channels are not mapped.
    others: further channels that the file may have, mapped last.
    removes_bias: whether a constant N_y before the first input is taken for a bias.
    """
    builder = ProposalBuilder(columns)
    if remembered is not None:
        recall(builder, remembered, aircraft)
    _find_times(builder, rate)
    measured = tuple(known for known in dictionary.channels if not known.formula)
    named = () if dictionary == LATERAL else measured
    usable = _usable(builder, group)
    alternatives = assign_by_name(builder, (c for c in named if c.key not in TARGETS), usable)
    candidates = _assign_signals(builder, usable, group)
    others = (*named, *(c for c in others if c.key not in TARGETS and not c.formula))
    alternatives |= assign_by_name(builder, others, candidates.groups)
    _derive(builder, dictionary)
    check_against_motion(builder, expected)
    if removes_bias:
        remove_bias(builder)
    doubt_normalised(builder)
    _explain_missing(builder, candidates, measured)
    _note_unchecked(builder, candidates)
    channels = {key: builder.channels[key] for key in in_order(builder.channels)}
    derivable = dict[str, tuple[str, ...]]()
    for key, ranked in candidates.by_key.items():
        chosen = channels[key].signal if key in channels else ""
        if names := tuple(c.signal.name for c in ranked if c.signal.name != chosen):
            alternatives[key] = names
    for way in DERIVATIONS.values():
        if all(need in channels for need in way.needs):
            derivable[way.target] = (*derivable.get(way.target, ()), way.key)
    return Proposal(
        Mapping(channels, builder.times),
        builder.rationales,
        alternatives,
        derivable,
        tuple(key for key in dictionary.measured if key not in channels),
        tuple(builder.notes),
    )


def _usable(builder: ProposalBuilder, group: str) -> set[int]:
    """Groups whose signals are proposed: all that have a time; only `group` if it is given."""
    groups = builder.columns.contents.groups
    if group and group not in (names := [each.name for each in groups]):
        known = f"choose one of {', '.join(names)}" if names else "it has no groups, so give none"
        raise TelemetryError(f"the file has no group {group!r}: {known}")
    return {
        n
        for n, each in enumerate(groups)
        if (not group or each.name == group)
        and (
            each.name in builder.times
            or not (builder.times or each.n_rows < 2 or dead_time(builder.columns, n))
        )
    }


def _assign_signals(builder: ProposalBuilder, usable: set[int], group: str) -> Candidates:
    """Assign to each of TARGETS the signal that fits best; return all that fit."""
    own = {key: source for key, source in builder.channels.items() if key not in KNOWN}
    mapped = {source.signal for key, source in builder.channels.items() if key not in own}
    mapped |= {source.signal for source in builder.times.values()}
    candidates = find_candidates(builder.columns, usable, mapped)
    _choose_flight(builder, candidates, group)
    assigned = assign(candidates, set(builder.channels))
    before = Mapping(
        {key: source for key, source in builder.channels.items() if key in TARGETS}, builder.times
    )
    assigned = choose_rates(builder.columns, before, candidates, assigned)
    decision = decide_units(builder.columns, before, assigned)
    for key in TARGETS:
        if key in decision.assigned and _agrees(decision.assigned[key], own.values()):
            _enter(builder, decision.assigned[key], candidates.by_key[key])
        if key in builder.channels and key in decision.contradictions:
            builder.comment(key, *decision.contradictions[key])
    return candidates


def _agrees(candidate: Candidate, own: Iterable[ChannelSource]) -> bool:
    """Whether own channels of its signal are the same quantity: in the same unit."""
    name = candidate.signal.name
    return all(
        (source.signal, source.unit) == (name, candidate.unit)
        for source in own
        if source.signal == name
    )


def _choose_flight(builder: ProposalBuilder, candidates: Candidates, group: str) -> None:
    """Limit the candidates to one group if groups are separate flights.

    It is the group that a person chose or confirmed, else the most complete.
    """
    contents = builder.columns.contents
    names = [each.name for each in contents.groups]
    flights = separate_flights(contents)
    sources = [builder.channels[key].signal for key in builder.confirmed]
    confirmed = [builder.columns.signal(name).group for name in sources if name]
    if group:
        chosen = names.index(group)
    elif flights:
        chosen = (*confirmed, *flights)[0]
    else:
        return
    for key, ranked in candidates.by_key.items():
        candidates.by_key[key] = [c for c in ranked if c.signal.group == chosen]
    candidates.groups &= {chosen}
    candidates.rejected.clear()
    if others := [names[other] for other in sorted(flights) if other != chosen]:
        more = f" and {len(others) - MOST_NAMED} more" if len(others) > MOST_NAMED else ""
        builder.notes.append(
            f"each group is a separate flight: {names[chosen]} is mapped; the others are "
            f"{', '.join(others[:MOST_NAMED])}{more}"
        )


def _find_times(builder: ProposalBuilder, rate: TimeSource | None) -> None:
    """Find the time of each group; record why a group without one is not used.

    If no group has a time, signals are proposed anyway: a person may still give the sample rate.
    """
    columns, without = builder.columns, list[int]()
    for number, group in enumerate(columns.contents.groups):
        if group.name in builder.times:
            continue
        time = find_time(columns, number)
        if rate and (time is None or time.confidence < DOUBTED):
            time = TimeProposal(rate, 0.99, (f"sample rate given: {rate_words(rate)}",))
        if time:
            builder.times[group.name] = time.source
            rationale = Rationale(round(time.confidence, 4), time.reasons)
            builder.rationales[f"t:{group.name}"] = rationale
        else:
            without.append(number)
    for number in without:
        group = columns.contents.groups[number]
        if builder.times or group.n_rows < 2 or dead_time(columns, number):
            why = _unused(columns, number)
        else:
            why = repeated_time(columns, number) or NO_TIME
        builder.rationales[f"t:{group.name}"] = Rationale(0.0, (why,))


def _unused(columns: Columns, number: int) -> str:
    """Why the signals of a group are not used, with their names."""
    names = [signal.name for signal in columns.contents.signals if signal.group == number]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    few = columns.contents.groups[number].n_rows < 2
    why = "their group has fewer than two rows" if few else "no signal of their group is a time"
    why = dead_time(columns, number) or repeated_time(columns, number) or why
    return f"{why}; signals not used: {', '.join(names[:MOST_NAMED])}{more}"


def _enter(builder: ProposalBuilder, candidate: Candidate, ranked: list[Candidate]) -> None:
    """Assign a candidate, with less confidence if other signals fit as well."""
    key, name = candidate.key, candidate.signal.name
    source = source_of(builder.columns, name, candidate.unit)
    reasons = (*candidate.reasons, *as_scaled(source))
    builder.assign(key, source, round(candidate.certainty, 4), *reasons)
    builder.most_confident[key] = round(candidate.unit_share, 4)
    chosen = next(other for other in ranked if other.signal.name == name)
    rivals = [
        other.signal.name
        for other in ranked
        if other is not chosen and other.certainty > chosen.certainty - RIVALS
    ]
    if rivals:
        builder.comment(key, f"{', '.join(rivals[:MOST_NAMED])} would also fit", 0.85)


def _derive(builder: ProposalBuilder, dictionary: Dictionary) -> None:
    """Propose a derivation for each channel without a signal, if its inputs are mapped."""
    for key in (*DERIVED_FIRST, *(key for key in KEYS if key in dictionary.keys)):
        if key in builder.channels:
            continue
        for way in DERIVATIONS.values():
            if way.target != key or not all(need in builder.channels for need in way.needs):
                continue
            confidence = min(builder.rationales[need].confidence for need in way.needs)
            if confidence >= DERIVED_FROM:
                reason = f"the file has no signal for {TARGETS[key].label}: derived ({way.title})"
                source = ChannelSource(derivation=way.key)
                builder.assign(key, source, round(DERIVED * confidence, 4), reason)
                break


def _explain_missing(
    builder: ProposalBuilder, candidates: Candidates, measured: tuple[Channel, ...]
) -> None:
    """Record why a channel has no source, and what it could be derived from."""
    timeless = list(_timeless(builder))
    needed = {known.key: known for known in measured}
    for key, target in (needed | TARGETS).items():
        if key in builder.channels:
            continue
        rejected = [why for of, why in timeless if of == key] + candidates.rejected.get(key, [])
        reasons = [*builder.rationales.get(key, Rationale(0.0)).reasons, *rejected[:MOST_NAMED]]
        if key in needed:
            if not reasons and key in TARGETS:
                reasons.append(f"no signal name suggests {target.label}")
            elif not reasons:
                names = dict.fromkeys([target.key, target.symbol, target.label])
                reasons.append(f"no signal has the name {', '.join(names)}")
            if inputs := ways(key):
                reasons.append(f"it can be derived from {inputs}")
        if reasons:
            builder.rationales[key] = Rationale(0.0, tuple(reasons))


def _note_unchecked(builder: ProposalBuilder, candidates: Candidates) -> None:
    is_lateral = any(key in builder.channels for key in KEYS)
    for key, check in UNCHECKED.items():
        if key not in builder.channels and (is_lateral or key not in ATTITUDE):
            similar = [candidate.signal.name for candidate in candidates.by_key.get(key, ())][:1]
            but = f" ({similar[0]} is doubtful)" if similar else ""
            builder.notes.append(f"no {TARGETS[key].label} in the file{but}: {check}")


def _timeless(builder: ProposalBuilder) -> Iterator[tuple[str, str]]:
    """(channel, reason) of signals whose names suggest it, but whose group has no time."""
    contents = builder.columns.contents
    for number, group in enumerate(contents.groups):
        if group.name in builder.times:
            continue
        why = dead_time(builder.columns, number) or "no signal of its group is a time"
        for signal in (signal for signal in contents.signals if signal.group == number):
            for match in signal_matches(signal, group.name):
                if match.key in TARGETS and match.certainty >= PROPOSED:
                    label = TARGETS[match.key].label
                    named = f"the name {signal.name} suggests {label}"
                    yield match.key, f"{named}, but the signal has no time: {why}"
