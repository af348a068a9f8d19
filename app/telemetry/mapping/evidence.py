"""A draft held against the motion that it makes: units, signs, gravity and offsets."""

from dataclasses import replace

import numpy as np

from app.telemetry.mapping.applying import apply_mapping, part_of
from app.telemetry.mapping.draft import Draft
from app.telemetry.mapping.gravity import gravity_share, quiet_offset
from app.telemetry.mapping.mapping import ChannelSource
from app.telemetry.mapping.motion import Motion, motion
from app.telemetry.mapping.signs import MIX_UP, Evidence, find_signs
from app.telemetry.plausibility import believed
from app.telemetry.recording import TelemetryError
from app.telemetry.traces import Traces
from core.simulation.attitude import SurfaceSigns

OTHER_UNIT = {"rad": "deg", "deg": "rad", "rad/s": "deg/s", "deg/s": "rad/s"}
ANGLE_OF = {"p": "phi", "r": "psi"}
SURFACES = ("delta_a", "delta_r")
LEFT, RIGHT = "delta_a_left", "delta_a_right"
ALIKE = 0.6
"""Correlation above which two ailerons are counted the same way."""


def weigh(draft: Draft, expected: SurfaceSigns) -> None:
    """Correct and comment on a draft by how the aircraft moves under it.

    expected: which way the aircraft goes at positive deflections. A confirmed channel is commented
    on only.
    """
    traces = _applied(draft)
    if traces is None:
        return
    if _sides(draft, traces):
        traces = _applied(draft) or traces
    moves = motion(traces)
    if moves is None:
        _offset(draft)
        return
    known = "r" in draft.confirmed
    found = find_signs(moves, expected, yaw_is_known=known)
    if _units(draft, found):
        moves = motion(_applied(draft) or traces) or moves
        found = find_signs(moves, expected, yaw_is_known=known)
    for key, evidence in found.items():
        _sign(draft, key, evidence)
    for key in SURFACES:
        if key in draft.channels and key not in found:
            draft.comment(key, "its sign cannot be told from the motion", 0.98)
    _gravity(draft, moves)
    _offset(draft)


def _applied(draft: Draft) -> Traces | None:
    try:
        traces = apply_mapping(draft.columns, draft.mapping)
    except TelemetryError:
        return None
    return replace(traces, channels={k: believed(k, x) for k, x in traces.channels.items()})


def _sides(draft: Draft, traces: Traces) -> bool:
    """Two ailerons that deflect alike when one goes up and the other down: one is reversed."""
    if not {LEFT, RIGHT} <= traces.channels.keys() or {LEFT, RIGHT} & draft.confirmed:
        return False
    left, right = traces.channels[LEFT], traces.channels[RIGHT]
    if left.t is not right.t:
        return False
    known = np.isfinite(left.values) & np.isfinite(right.values)
    pair = np.array([left.values[known], right.values[known]])
    if known.sum() < 2 or not pair.std(axis=1).all():
        return False
    alike = float(np.corrcoef(pair).ravel()[1])
    if not alike > ALIKE:
        return False
    draft.change(LEFT, sign=-draft.channels[LEFT].sign)
    draft.comment(LEFT, f"reversed: it moves like the right one (correlation {alike:.2f})")
    return True


def _units(draft: Draft, found: dict[str, Evidence]) -> bool:
    """Settle an unsaid unit by the ratio of a rate to its angle's derivative."""
    changed = False
    for key, angle in ANGLE_OF.items():
        evidence = found.get(key)
        if evidence is None or evidence.times == 1.0:
            continue
        ratio = f"{key} is {evidence.times:.3g} times d({angle})/dt"
        unsaid = [name for name in (key, angle) if name in draft.unsaid]
        if not unsaid:
            doubt = f"{ratio}: one of the units said is wrong"
            for name in (key, angle):
                draft.comment(name, doubt, 0.5)
            continue
        guilty = min(unsaid, key=lambda name: draft.guesses[name].confidence)
        too_large = (evidence.times > MIX_UP[0]) == (guilty == key)
        unit = draft.channels[guilty].unit
        other = OTHER_UNIT.get(unit, "")
        if other and too_large == other.startswith("deg"):
            draft.change(guilty, unit=other)
            draft.comment(guilty, f"read as {other} instead: {ratio}")
            changed = True
    return changed


def _sign(draft: Draft, key: str, evidence: Evidence) -> None:
    """Turn a channel round, or say what bears it out."""
    if key in ANGLE_OF and draft.channels[key].derivation:
        return  # it was made of the angle itself
    if key in draft.confirmed:
        if evidence.sign < 0 and evidence.proven:
            draft.comment(key, f"but the motion says it is {evidence.text}", 0.6)
        return
    if evidence.sign < 0:
        draft.change(key, sign=-draft.channels[key].sign)
        draft.comment(key, evidence.text, 0.95 if evidence.proven else 0.6)
    elif evidence.proven:
        draft.bear_out(key, evidence.text, 0.6)
    else:
        draft.comment(key, evidence.text, 0.8)


def _gravity(draft: Draft, moves: Motion) -> None:
    """Take gravity out of a lateral acceleration that holds it."""
    source = draft.channels.get("Ny")
    if source is None or not source.signal or "Ny" in draft.confirmed or "Ay" in draft.channels:
        return
    share = gravity_share(moves)
    if share is None:
        return
    why = (
        f"it follows {source.sign * share.slope:+.2f} g times sin(phi) cos(theta), "
        f"{share.share:.0%} of what the other channels leave"
    )
    if source.sign * share.slope < 0.0:
        draft.comment("Ny", f"{why}: reversed and with gravity, or flown in steady sideslips", 0.6)
        return
    guess = draft.guesses["Ny"]
    draft.take("Ay", source, guess.confidence, *guess.reasons, why)
    made = ChannelSource(derivation="Ny_without_gravity")
    reason = f"derived, as {source.signal} holds gravity: {why}"
    draft.take("Ny", made, round(0.8 * guess.confidence, 4), reason)


def _offset(draft: Draft) -> None:
    """Take off what an accelerometer shows in the quiet first seconds."""
    if "Ny" not in draft.channels or "Ny" in draft.confirmed:
        return
    try:
        trace = apply_mapping(draft.columns, part_of(draft.mapping, "Ny")).channels["Ny"]
    except TelemetryError:
        return
    if offset := quiet_offset(trace):
        draft.change("Ny", offset=offset.value)
        draft.comment("Ny", offset.text, 0.4 if offset.upright else 0.85)
