"""Check a mapping against the file and the motion that it implies: units, signs, gravity and bias.

A proposal is corrected. A person's mapping only gets warnings: an aircraft may be unusual, and a
file may state a wrong unit.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import ANY_NUMBERS, apply_mapping, part_of
from app.telemetry.mapping.candidates import separate_flights
from app.telemetry.mapping.magnitudes import extent_of, is_seldom
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.mapping.motion import ANGLE_OF, Motion, motion
from app.telemetry.mapping.names import name_matches
from app.telemetry.mapping.proposal_builder import ProposalBuilder, other_scaling
from app.telemetry.mapping.signs import (
    SignEvidence,
    find_signs,
    gravity_effect,
    quiet_bias,
)
from app.telemetry.recording import TelemetryError, Trace, Traces
from app.telemetry.scaling import AS_RECORDED, COUNTS
from app.telemetry.targets import (
    TARGETS,
    in_order,
    label_of,
    may_be_one_quantity,
    plausible,
    target_of,
)
from app.telemetry.units import factor, fits, spelled, unit_in
from core.channels import KEYS
from core.simulation.attitude import SurfaceSigns

SURFACES = ("delta_a", "delta_r")
LEFT, RIGHT = "delta_a_left", "delta_a_right"
NORMALISED = 0.7
"""Factor on the confidence in a surface that may be a normalised command."""
ALIKE = 0.6
"""Two ailerons with a higher correlation have the same sign convention."""


def check_against_motion(builder: ProposalBuilder, expected: SurfaceSigns) -> None:
    """Correct a proposed mapping and comment on it. Confirmed channels only get comments.

    expected: response of the aircraft to positive deflections.
    """
    traces = _applied(builder)
    if traces is None:
        return
    if _oppose_ailerons(builder, traces):
        traces = _applied(builder) or traces
    moves = motion(traces)
    if moves is not None:
        bank = builder.channels.get("phi")
        _check_signs(builder, moves, expected)
        same_bank = 1 if builder.channels.get("phi") == bank else -1
        _take_out_gravity(builder, moves, same_bank)


def _check_signs(builder: ProposalBuilder, moves: Motion, expected: SurfaceSigns) -> None:
    signs = find_signs(moves, expected, yaw_is_known="r" in builder.confirmed)
    for key, evidence in signs.items():
        _check_sign(builder, key, evidence)
    for key in SURFACES:
        if key in builder.channels and key not in signs:
            builder.comment(key, "its sign cannot be verified from the motion", 0.98)


def _applied(builder: ProposalBuilder) -> Traces | None:
    try:
        traces = apply_mapping(builder.columns, builder.mapping)
    except TelemetryError:
        return None
    return replace(traces, channels={k: plausible(k, x) for k, x in traces.channels.items()})


def _oppose_ailerons(builder: ProposalBuilder, traces: Traces) -> bool:
    """Reverse the left aileron if both move alike; real ailerons move in opposition."""
    if not {LEFT, RIGHT} <= traces.channels.keys() or {LEFT, RIGHT} & builder.confirmed:
        return False
    left, right = traces.channels[LEFT], traces.channels[RIGHT]
    if left.t is not right.t:
        return False
    known = np.isfinite(left.values) & np.isfinite(right.values)
    pair = np.array([left.values[known], right.values[known]])
    if known.sum() < 2 or not pair.std(axis=1).all():
        return False
    correlation = float(np.corrcoef(pair).ravel()[1])
    if not correlation > ALIKE:
        return False
    builder.change(LEFT, sign=-builder.channels[LEFT].sign)
    builder.comment(
        LEFT, f"reversed: it moves like the right aileron (correlation {correlation:.2f})"
    )
    return True


def _check_sign(builder: ProposalBuilder, key: str, evidence: SignEvidence) -> None:
    """Reverse a channel, or add the evidence for its sign."""
    if key in ANGLE_OF and builder.channels[key].derivation:
        return  # it is derived from this angle
    if key in builder.confirmed or (key == "phi" and builder.channels[key].derivation):
        if evidence.sign < 0 and evidence.proven:
            builder.comment(key, f"but according to the motion it is {evidence.text}", 0.6)
        return
    if evidence.sign < 0:
        builder.change(key, sign=-builder.channels[key].sign)
        builder.comment(key, evidence.text, 0.95 if evidence.proven else 0.6)
    elif evidence.proven and evidence.times == 1.0:
        builder.support(key, evidence.text, 0.6)
    else:
        builder.comment(key, evidence.text, 0.8)


def _take_out_gravity(builder: ProposalBuilder, moves: Motion, same_bank: int) -> None:
    """Remove gravity from a lateral acceleration that contains it.

    same_bank: -1 if the bank angle was reversed in between.
    """
    source = builder.channels.get("Ny")
    if source is None or not source.signal or "Ny" in builder.confirmed or "Ay" in builder.channels:
        return
    effect = gravity_effect(moves)
    if effect is None:
        return
    slope = source.sign * same_bank * effect.slope
    why = (
        f"it follows {slope:+.2f} g times sin(phi) cos(theta), which explains "
        f"{effect.share:.0%} of the variation left by the other channels"
    )
    if slope < 0.0:
        reason = f"{why}: it is reversed and contains gravity, or was flown in steady sideslips"
        builder.comment("Ny", reason, 0.6)
        return
    before = builder.rationales["Ny"]
    builder.assign("Ay", source, before.confidence, *before.reasons, why)
    derived = ChannelSource(derivation="Ny_without_gravity")
    reason = f"derived, because {source.signal} contains gravity: {why}"
    builder.assign("Ny", derived, round(0.8 * before.confidence, 4), reason)


def remove_bias(builder: ProposalBuilder) -> None:
    """Subtract a constant N_y of the quiet first seconds, unless its mapping is confirmed."""
    if "Ny" not in builder.channels or "Ny" in builder.confirmed:
        return
    try:
        trace = apply_mapping(builder.columns, part_of(builder.mapping, "Ny")).channels["Ny"]
    except TelemetryError:
        return
    if bias := quiet_bias(trace):
        builder.change("Ny", bias=bias.value)
        builder.comment("Ny", f"removed a {bias.text}", 0.4 if bias.like_gravity else 0.85)


def doubt_normalised(builder: ProposalBuilder) -> None:
    for key, text in _normalised(builder.columns, builder.mapping).items():
        builder.comment(key, text, NORMALISED)


def _normalised(columns: Columns, mapping: Mapping) -> dict[str, str]:
    """Surfaces with larger values than a deflection, and those of their group that reach no more
    than 1 either: perhaps normalised commands.
    """
    signals = {signal.name: signal for signal in columns.contents.signals}
    sources = {
        key: source
        for key, source in mapping.channels.items()
        if key.startswith(SURFACES)
        and key in TARGETS
        and source.signal in signals
        and fits(source.unit, "rad")
    }
    extents = {
        key: extent_of(source.scaling(columns.raw(source.signal)))
        for key, source in sources.items()
        if not source.scaling.problem()
    }
    large = {key for key in extents if is_seldom(key, extents[key], sources[key].unit)}
    texts = {
        key: f"values up to {extents[key].peak:.3g} {sources[key].unit} are rare for "
        f"{TARGETS[key].label}: check the unit; it may be a normalised command"
        for key in large
    }
    for key in extents.keys() - large:
        mates = [
            other
            for other in large
            if signals[sources[other].signal].group == signals[sources[key].signal].group
            and factor(sources[other].unit, "rad") == factor(sources[key].unit, "rad") == 1.0
            and max(extents[other].peak, extents[key].peak) <= 1.0
        ]
        if mates:
            texts[key] = f"{sources[mates[0]].signal} may be normalised: check this unit too"
    return texts


MappingWarnings = dict[str, list[str]]
"""Sentences by channel."""


@ANY_NUMBERS
def find_warnings(columns: Columns, mapping: Mapping, applied: Traces | None) -> MappingWarnings:
    """Return sentences by channel, only for channels with warnings.

    applied: the mapped channels; None if the mapping cannot be applied.
    """
    warnings: MappingWarnings = {key: [] for key in in_order(mapping.channels)}
    for key in warnings:
        source = mapping.channels[key]
        if source.signal:
            warnings[key] += [*_used_twice(mapping, key), *_other_unit(columns, key, source)]
            warnings[key] += _other_scaling(columns, source)
    for key, text in (*_normalised(columns, mapping).items(), *_other_flights(columns, mapping)):
        warnings[key].append(text)
    if applied is not None:
        channels = {key: plausible(key, trace) for key, trace in applied.channels.items()}
        for key in KEYS:
            if key in channels and (source := mapping.channels[key]).bias:
                warnings[key] += _off_centre(key, source, channels[key])
        moves = motion(replace(applied, channels=channels))
        if moves is not None:
            _warn_of_signs(warnings, mapping, moves)
        if "Ny" in channels and mapping.channels["Ny"].signal:
            warnings["Ny"] += _warn_of_lateral(channels["Ny"], moves)
    return {key: sentences for key, sentences in warnings.items() if sentences}


def _other_flights(columns: Columns, mapping: Mapping) -> Iterator[tuple[str, str]]:
    """(channel, warning) of signals from another flight than most channels."""
    groups = {signal.name: signal.group for signal in columns.contents.signals}
    flights = separate_flights(columns.contents)
    of_flight = {
        key: groups[source.signal]
        for key, source in mapping.channels.items()
        if groups.get(source.signal) in flights
    }
    most = Counter(of_flight.values()).most_common(1)
    for key, group in of_flight.items():
        if group != most[0][0]:
            names = [columns.contents.groups[number].name for number in (group, most[0][0])]
            yield key, f"it is of the flight {names[0]}, most channels of {names[1]}"


def _used_twice(mapping: Mapping, key: str) -> list[str]:
    name = mapping.channels[key].signal
    others = [
        label_of(other)
        for other, source in mapping.channels.items()
        if other != key
        and source.signal == name
        and not (may_be_one_quantity(key, other) and source == mapping.channels[key])
        and not _other_bits(source, mapping.channels[key])
    ]
    others += [f"the time{f' of {g}' if g else ''}" for g, t in mapping.times.items()
               if t.signal == name]  # fmt: skip
    return [f"{name} is also mapped to {' and '.join(others)}"] if others else []


def _other_bits(source: ChannelSource, other: ChannelSource) -> bool:
    """Whether two sources are different parts of one word."""
    return bool(source.bits and other.bits) and source.bits != other.bits


def _other_unit(columns: Columns, key: str, source: ChannelSource) -> list[str]:
    """Warn if the chosen unit differs from that of the file, or else of the name."""
    try:
        signal, target = columns.signal(source.signal), target_of(key, source.unit)
    except (KeyError, TelemetryError):
        return []
    chosen = spelled(source.unit)
    where, unit = "the file", spelled(signal.unit)
    if not unit:
        of_name = [match.unit for match in name_matches(signal.name) if match.key == key]
        of_name += [] if key in TARGETS else [unit_in(signal.name)]
        where, unit = "its name", spelled(next((text for text in of_name if text), ""))
    is_scaled = unit == COUNTS and source.scaling != AS_RECORDED
    if not unit or is_scaled or not fits(chosen, target.unit) or chosen == f"{unit}/s":
        return []
    given = f"{where} gives {signal.name} in {unit}"
    if not fits(unit, target.unit):
        return [f"{given}, which is not a unit of {target.label}"]
    if np.isclose(factor(unit, target.unit), factor(chosen, target.unit), rtol=1e-6):
        return []
    return [f"{given}, not in {chosen}"]


def _other_scaling(columns: Columns, source: ChannelSource) -> list[str]:
    """Warn if the chosen scale differs from that of the file."""
    try:
        other = other_scaling(columns, source)
    except KeyError:
        return []
    return [other] if other else []


def _off_centre(key: str, source: ChannelSource, trace: Trace) -> list[str]:
    """Warn if removing the bias moves a channel away from zero by more than it varies."""
    extent = extent_of(trace.values)
    if extent.empty:
        return []
    after = extent.middle
    before = after + source.bias
    if abs(after) <= abs(before) or abs(after) <= 0.5 * (extent.highest - extent.lowest):
        return []
    read = TARGETS[key].read
    return [
        f"removing the bias takes it from about {read(before)} to {read(after)}, away from zero"
    ]


def _warn_of_signs(warnings: MappingWarnings, mapping: Mapping, moves: Motion) -> None:
    for key, evidence in find_signs(moves).items():
        if key in ANGLE_OF and mapping.channels[key].derivation:
            continue  # it is derived from this angle
        if evidence.sign < 0 and evidence.proven:
            warnings[key].append(f"according to the motion it is {evidence.text}")
        if evidence.times != 1.0:
            angle = ANGLE_OF[key]
            text = f"{key} is {evidence.times:.3g} times d({angle})/dt: a unit or signal is wrong"
            warnings[key].append(text)
            warnings[angle].append(text)


def _warn_of_lateral(trace: Trace, moves: Motion | None) -> list[str]:
    warnings = []
    effect = gravity_effect(moves) if moves is not None else None
    if effect is not None and effect.slope > 0.0:
        warnings.append(
            f"it follows {effect.slope:+.2f} g times sin(phi) cos(theta), so it contains gravity: "
            f"map it to {TARGETS['Ay'].label} and derive N_y"
        )
    if bias := quiet_bias(trace):
        warnings.append(bias.text)
    return warnings
