"""What speaks against a mapping that a person has made: its units, signs, offsets and doublings.

Nothing is changed, and nothing is forbidden: an aircraft may be unusual, and a file may be wrong
about itself.
"""

from dataclasses import replace

import numpy as np

from app.telemetry.contents import Columns
from app.telemetry.extent import extent
from app.telemetry.mapping.applying import WILD, apply_mapping
from app.telemetry.mapping.gravity import gravity_share, quiet_offset
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.mapping.motion import motion
from app.telemetry.mapping.names import readings
from app.telemetry.mapping.signs import find_signs
from app.telemetry.plausibility import believed
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import TARGETS
from app.telemetry.traces import Trace, Traces
from app.telemetry.units import factor, fits, spelled
from core.channels import KEYS

ANGLE_OF = {"p": "phi", "r": "psi"}

Doubts = dict[str, list[str]]


@WILD
def find_doubts(columns: Columns, mapping: Mapping) -> Doubts:
    """Return sentences by channel; a channel that nothing speaks against is left out."""
    doubts: Doubts = {key: [] for key in TARGETS if key in mapping.channels}
    for key in doubts:
        source = mapping.channels[key]
        if source.signal:
            doubts[key] += [*_used_twice(mapping, key), *_other_unit(columns, key, source)]
    try:
        traces = apply_mapping(columns, mapping)
    except TelemetryError:
        traces = Traces({})
    channels = {key: believed(key, trace) for key, trace in traces.channels.items()}
    for key in KEYS:
        if key in channels and (source := mapping.channels[key]).offset:
            doubts[key] += _off_centre(key, source, channels[key])
    _against_the_motion(doubts, mapping, replace(traces, channels=channels))
    return {key: said for key, said in doubts.items() if said}


def _used_twice(mapping: Mapping, key: str) -> list[str]:
    name = mapping.channels[key].signal
    others = [
        TARGETS[other].label
        for other, source in mapping.channels.items()
        if other != key and source.signal == name
    ]
    others += [f"the time{f' of {g}' if g else ''}" for g, t in mapping.times.items()
               if t.signal == name]  # fmt: skip
    return [f"{name} is mapped to {' and '.join(others)} too"] if others else []


def _other_unit(columns: Columns, key: str, source: ChannelSource) -> list[str]:
    """The unit that the file states, or else the name, where it is not the one chosen."""
    try:
        signal = columns.signal(source.signal)
    except KeyError:
        return []
    target, chosen = TARGETS[key], spelled(source.unit)
    where, said = "the file", spelled(signal.unit)
    if not said:
        meant = (r.unit for r in readings(signal.name) if r.key == key and r.unit)
        where, said = "its name", spelled(next(meant, ""))
    if not said or not fits(chosen, target.unit) or chosen == f"{said}/s":
        return []
    if not fits(said, target.unit):
        return [f"{where} says that {signal.name} is in {said}, which is no {target.label}"]
    if np.isclose(factor(said, target.unit), factor(chosen, target.unit), rtol=1e-6):
        return []
    return [f"{where} says that {signal.name} is in {said}, not in {chosen}"]


def _off_centre(key: str, source: ChannelSource, trace: Trace) -> list[str]:
    """An offset that takes a lateral channel away from zero, by more than it moves."""
    reach = extent(trace.values)
    if reach.empty:
        return []
    after = reach.middle
    before = after + source.offset
    if abs(after) <= abs(before) or abs(after) <= 0.5 * (reach.highest - reach.lowest):
        return []
    unit = TARGETS[key].unit
    return [
        f"the offset takes it from about {before:.3g} {unit} to {after:.3g} {unit}, away from zero"
    ]


def _against_the_motion(doubts: Doubts, mapping: Mapping, traces: Traces) -> None:
    moves = motion(traces)
    if moves is not None:
        for key, evidence in find_signs(moves).items():
            if key in ANGLE_OF and mapping.channels[key].derivation:
                continue  # it was made of the angle itself
            if evidence.sign < 0 and evidence.proven:
                doubts[key].append(f"the motion says it is {evidence.text}")
            if evidence.times != 1.0:
                angle = ANGLE_OF[key]
                text = f"{key} is {evidence.times:.3g} times d({angle})/dt: one unit is wrong"
                doubts[key].append(text)
                doubts[angle].append(text)
    if "Ny" not in traces.channels or not mapping.channels["Ny"].signal:
        return
    share = gravity_share(moves) if moves is not None else None
    if share is not None and share.slope > 0.0:
        doubts["Ny"].append(
            f"it follows {share.slope:+.2f} g times sin(phi) cos(theta): gravity is in it, which "
            f"{TARGETS['Ay'].label} is for"
        )
    if offset := quiet_offset(traces.channels["Ny"]):
        doubts["Ny"].append(offset.text)
