"""Warn about units, signs, biases and duplicates in a mapping that a person has made.

Warnings change and forbid nothing: an aircraft may be unusual, and a file may state a wrong unit.
"""

from dataclasses import replace

import numpy as np

from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import ANY_NUMBERS
from app.telemetry.mapping.extent import extent_of
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.mapping.motion.gravity import gravity_effect, quiet_bias
from app.telemetry.mapping.motion.motion import Motion, motion
from app.telemetry.mapping.motion.signs import ANGLE_OF, find_signs
from app.telemetry.mapping.naming.names import name_matches
from app.telemetry.plausibility import plausible
from app.telemetry.targets import TARGETS
from app.telemetry.traces import Trace, Traces
from app.telemetry.units import factor, fits, spelled
from core.channels import KEYS

MappingWarnings = dict[str, list[str]]
"""Sentences by channel."""


@ANY_NUMBERS
def find_warnings(columns: Columns, mapping: Mapping, applied: Traces | None) -> MappingWarnings:
    """Return sentences by channel, only for channels with warnings.

    applied: the mapped channels; None if the mapping cannot be applied.
    """
    warnings: MappingWarnings = {key: [] for key in TARGETS if key in mapping.channels}
    for key in warnings:
        source = mapping.channels[key]
        if source.signal:
            warnings[key] += [*_used_twice(mapping, key), *_other_unit(columns, key, source)]
    if applied is not None:
        channels = {key: plausible(key, trace) for key, trace in applied.channels.items()}
        for key in KEYS:
            if key in channels and (source := mapping.channels[key]).bias:
                warnings[key] += _off_centre(key, source, channels[key])
        moves = motion(replace(applied, channels=channels))
        if moves is not None:
            _check_signs(warnings, mapping, moves)
        if "Ny" in channels and mapping.channels["Ny"].signal:
            warnings["Ny"] += _check_lateral(channels["Ny"], moves)
    return {key: sentences for key, sentences in warnings.items() if sentences}


def _used_twice(mapping: Mapping, key: str) -> list[str]:
    name = mapping.channels[key].signal
    others = [
        TARGETS[other].label
        for other, source in mapping.channels.items()
        if other != key and source.signal == name
    ]
    others += [f"the time{f' of {g}' if g else ''}" for g, t in mapping.times.items()
               if t.signal == name]  # fmt: skip
    return [f"{name} is also mapped to {' and '.join(others)}"] if others else []


def _other_unit(columns: Columns, key: str, source: ChannelSource) -> list[str]:
    """Warn if the chosen unit differs from that of the file, or else of the name."""
    try:
        signal = columns.signal(source.signal)
    except KeyError:
        return []
    target, chosen = TARGETS[key], spelled(source.unit)
    where, unit = "the file", spelled(signal.unit)
    if not unit:
        of_name = (match.unit for match in name_matches(signal.name) if match.key == key)
        where, unit = "its name", spelled(next((text for text in of_name if text), ""))
    if not unit or not fits(chosen, target.unit) or chosen == f"{unit}/s":
        return []
    given = f"{where} gives {signal.name} in {unit}"
    if not fits(unit, target.unit):
        return [f"{given}, which is not a unit of {target.label}"]
    if np.isclose(factor(unit, target.unit), factor(chosen, target.unit), rtol=1e-6):
        return []
    return [f"{given}, not in {chosen}"]


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


def _check_signs(warnings: MappingWarnings, mapping: Mapping, moves: Motion) -> None:
    for key, evidence in find_signs(moves).items():
        if key in ANGLE_OF and mapping.channels[key].derivation:
            continue  # it is derived from this angle
        if evidence.sign < 0 and evidence.proven:
            warnings[key].append(f"according to the motion it is {evidence.text}")
        if evidence.times != 1.0:
            angle = ANGLE_OF[key]
            text = f"{key} is {evidence.times:.3g} times d({angle})/dt: one unit is wrong"
            warnings[key].append(text)
            warnings[angle].append(text)


def _check_lateral(trace: Trace, moves: Motion | None) -> list[str]:
    """Warn about gravity or a bias in the channel mapped to N_y."""
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
