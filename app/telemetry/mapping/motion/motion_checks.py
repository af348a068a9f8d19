"""Check a proposed mapping against the motion that it implies: signs, gravity and bias."""

from dataclasses import replace

import numpy as np

from app.telemetry.mapping.applying import apply_mapping, part_of
from app.telemetry.mapping.mapping import ChannelSource
from app.telemetry.mapping.motion.gravity import gravity_effect, quiet_bias
from app.telemetry.mapping.motion.motion import Motion, motion
from app.telemetry.mapping.motion.signs import ANGLE_OF, SignEvidence, find_signs
from app.telemetry.mapping.proposal_builder import ProposalBuilder
from app.telemetry.plausibility import plausible
from app.telemetry.recording import TelemetryError
from app.telemetry.traces import Traces
from core.simulation.attitude import SurfaceSigns

SURFACES = ("delta_a", "delta_r")
LEFT, RIGHT = "delta_a_left", "delta_a_right"
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
    _remove_bias(builder)


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
    elif evidence.proven:
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


def _remove_bias(builder: ProposalBuilder) -> None:
    """Remove the bias that an accelerometer shows in the quiet first seconds."""
    if "Ny" not in builder.channels or "Ny" in builder.confirmed:
        return
    try:
        trace = apply_mapping(builder.columns, part_of(builder.mapping, "Ny")).channels["Ny"]
    except TelemetryError:
        return
    if bias := quiet_bias(trace):
        builder.change("Ny", bias=bias.value)
        builder.comment("Ny", f"removed a {bias.text}", 0.4 if bias.like_gravity else 0.85)
