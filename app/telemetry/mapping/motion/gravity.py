"""What an accelerometer's channel holds besides N_y: gravity in a bank, or a constant bias."""

from dataclasses import dataclass
from math import radians

import numpy as np

from app.telemetry.mapping.motion.motion import Motion, PartialEffect
from app.telemetry.traces import Trace

IN_FULL = (0.7, 1.3)
"""Share of sin(phi) cos(theta) that is gravity, and not a manoeuvre that was not coordinated."""
CLEAR = 0.7
"""What it must explain of what the other channels leave unexplained."""
BANKED = radians(0.8)
"""Standard deviation of the bank angle from which gravity can be told [rad]."""
QUIET_S = 2.0
"""At the start, before the manoeuvre [s]."""
QUIET = 0.3
"""Scatter of a quiet start, as a share of the whole recording's."""
MOST = 20_000
"""Samples that the whole recording's scatter is taken of."""
STILL = 0.01
"""Scatter that is quiet whatever comes later [g]."""
LEAST_BIAS = 0.02
"""Smaller ones are trim: the side force of a real aircraft [g]."""
BEYOND_NOISE = 3.0
ONE_G = (0.85, 1.15)


@dataclass(frozen=True)
class Bias:
    """A constant part of a channel in its unit, and the evidence in words.

    like_gravity: whether it is as large as gravity itself.
    """

    value: float
    text: str
    like_gravity: bool = False


def gravity_effect(moves: Motion) -> PartialEffect | None:
    """How the lateral acceleration follows sin(phi) cos(theta), where it does so in full.

    Specific force, which an accelerometer measures, does not know the bank of a coordinated turn;
    the acceleration over ground follows it with +1, and a reversed one with -1. In steady
    sideslips the specific force follows with -1 too.
    """
    if "Ny" not in moves.values or moves.spread("phi") < BANKED:
        return None
    others = ("beta", "delta_r", "p", "r", "delta_a")
    causes = {key: moves.values[key] for key in others if key in moves.values}
    effect = moves.effects(moves.values["Ny"], causes | {"gravity": moves.gravity}).get("gravity")
    if effect is None or effect.share < CLEAR or not IN_FULL[0] < abs(effect.slope) < IN_FULL[1]:
        return None
    return effect


def quiet_bias(trace: Trace) -> Bias | None:
    """A constant part of the quiet first seconds, well beyond their noise and any trim."""
    t, values = trace.t, trace.values
    known = np.flatnonzero(np.isfinite(t))
    if not len(known):
        return None
    last = int(np.searchsorted(t[known], t[known[0]] + QUIET_S))
    start = values[known[:last]]
    start = start[np.isfinite(start)]
    if len(start) < 8:
        return None
    mean, noise = float(start.mean()), float(start.std())
    scatter = float(np.nanstd(values[:: 1 + len(values) // MOST]))
    half = len(start) // 2
    drift = abs(float(start[:half].mean() - start[half:].mean()))
    quiet = max(noise, drift) <= max(QUIET * scatter, STILL)
    if not quiet or abs(mean) <= max(LEAST_BIAS, BEYOND_NOISE * noise):
        return None
    like_gravity = ONE_G[0] < abs(mean) < ONE_G[1]
    text = (
        f"constant bias: its first {QUIET_S:g} s have a mean of {mean:.3g} g and a standard "
        f"deviation of {noise:.2g} g"
    )
    if like_gravity:
        text += ", as large as gravity: check for a normal acceleration or a tilted axis"
    return Bias(float(f"{mean:.6g}"), text, like_gravity)
