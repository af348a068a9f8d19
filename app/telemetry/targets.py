"""The quantities that a signal of a file can be mapped to, and the values that they can reach.

The bounds allow for every aircraft and convention, also for a heading that is never wrapped. Values
beyond them are failed sensors or no measurements, and are not scored.
"""

from dataclasses import replace
from math import radians

import numpy as np

from app.telemetry.contents import release
from app.telemetry.recording import Trace
from core.channels import CHANNELS, Channel, channel
from core.types import Array, Indices

ATTITUDE_TARGETS = (
    channel("phi", "φ", "rad", "bank angle"),
    channel("theta", "θ", "rad", "pitch angle"),
    channel("psi", "ψ", "rad", "heading"),
)
CONDITION_TARGETS = (
    channel("V", "V", "m/s", "true airspeed"),
    channel("h", "h", "m", "altitude"),
)
INGREDIENTS = (
    channel("v", "v", "m/s", "lateral velocity"),
    channel("Ay", "a_y", "g", "lateral acceleration, gravity included"),
    channel("delta_a_left", "δ_a,l", "rad", "left aileron"),
    channel("delta_a_right", "δ_a,r", "rad", "right aileron"),
    channel("delta_r_left", "δ_r,l", "rad", "left rudder"),
    channel("delta_r_right", "δ_r,r", "rad", "right rudder"),
    channel("q0", "q_0", "1", "attitude quaternion, scalar part"),
    channel("q1", "q_1", "1", "attitude quaternion, forward part"),
    channel("q2", "q_2", "1", "attitude quaternion, right part"),
    channel("q3", "q_3", "1", "attitude quaternion, down part"),
)
"""Only used to derive other channels."""
TARGETS: dict[str, Channel] = {
    target.key: target
    for target in (*CHANNELS, *ATTITUDE_TARGETS, *CONDITION_TARGETS, *INGREDIENTS)
}
"""By key; values are stored in `unit`."""


BY_UNIT: dict[str, float] = {
    "rad": radians(100.0),  # of the sideslip or a surface
    "rad/s": 20.0,  # three turns a second
    "g": 30.0,  # more than aircraft and sensors withstand
    "m/s": 2000.0,
    "m": 100_000.0,
}
ACCUMULATED = 1e4
"""Of an angle that may accumulate full turns [rad]."""
BOUNDS: dict[str, float] = {
    target.key: ACCUMULATED if target in ATTITUDE_TARGETS else BY_UNIT.get(target.unit, np.inf)
    for target in TARGETS.values()
}
"""Largest plausible magnitude of a target, in its unit; quaternions have none."""


def largest_plausible(channel: Channel) -> float:
    """Largest plausible magnitude of a channel, in its unit; infinite if unknown."""
    known = TARGETS.get(channel.key)
    if known is not None and known.unit == channel.unit:
        return BOUNDS[channel.key]
    return np.inf if channel.largest is None else channel.largest


def implausible(key: str, values: Array) -> Indices:
    """Rows with a value that no aircraft can reach."""
    bound = BOUNDS[key]
    reach = max(-np.fmin.reduce(values, initial=0.0), np.fmax.reduce(values, initial=0.0))
    return np.flatnonzero(np.abs(values) > bound) if reach > bound else np.empty(0, np.intp)


def plausible(key: str, trace: Trace) -> Trace:
    """A channel with implausible values replaced by NaN; unchanged if there are none."""
    rows = implausible(key, trace.values)
    release(trace.values)
    return replace(trace, values=without(trace.values, rows)) if len(rows) else trace


def without(values: Array, rows: Indices) -> Array:
    """Values with some rows replaced by NaN; the same array if there are none."""
    if not len(rows):
        return values
    remaining = np.array(values, np.float64)
    remaining[rows] = np.nan
    return remaining
