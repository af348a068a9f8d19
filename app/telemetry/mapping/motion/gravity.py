"""Detect gravity or a constant bias in a lateral acceleration."""

from dataclasses import dataclass
from math import radians

import numpy as np

from app.telemetry.mapping.motion.motion import Motion, PartialEffect
from app.telemetry.traces import Trace

IN_FULL = (0.7, 1.3)
"""Slope on sin(phi) cos(theta) that is gravity, not an uncoordinated manoeuvre [g]."""
CLEAR = 0.7
"""Share of the variation left by the other channels that gravity must explain."""
BANKED = radians(0.8)
"""Least standard deviation of the bank angle that reveals gravity [rad]."""
QUIET_S = 2.0
"""Time before the manoeuvre [s]."""
QUIET = 0.3
"""Largest scatter of a quiet start, as a share of that of the whole recording."""
MOST = 20_000
"""Samples used for the scatter of the whole recording."""
STILL = 0.01
"""Smaller scatter is always quiet [g]."""
LEAST_BIAS = 0.02
"""Smaller biases are trim: real aircraft have a side force [g]."""
BEYOND_NOISE = 3.0
ONE_G = (0.85, 1.15)


@dataclass(frozen=True)
class Bias:
    """A constant part of a channel in its unit, with the evidence in words.

    like_gravity: whether it is about 1 g.
    """

    value: float
    text: str
    like_gravity: bool = False


def gravity_effect(moves: Motion) -> PartialEffect | None:
    """Effect of sin(phi) cos(theta) on the lateral acceleration, if it is about 1 g.

    An accelerometer measures specific force, which does not depend on the bank in a coordinated
    turn. Inertial acceleration follows the bank with +1, and with -1 if reversed. In steady
    sideslips specific force also follows with -1.
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
    """A constant value in the quiet first seconds, beyond their noise and any trim."""
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
