"""Detect values that no aircraft can reach: failed sensors and numbers that are not measurements.

The bounds allow for every aircraft and convention, also for a heading that is never wrapped. Values
beyond them are not scored.
"""

from dataclasses import replace
from math import radians

import numpy as np

from app.telemetry.contents import release
from app.telemetry.traces import Trace
from core.types import Array, Indices

DEFLECTION = radians(100.0)
"""Of the sideslip or a surface [rad]."""
ATTITUDE = 1e4
"""Of an angle that may accumulate full turns [rad]."""
RATE = 20.0
"""Three turns a second [rad/s]."""
LOAD = 30.0
"""More than aircraft and sensors withstand [g]."""
BOUNDS: dict[str, float] = {
    "beta": DEFLECTION,
    "p": RATE,
    "r": RATE,
    "Ny": LOAD,
    "delta_a": DEFLECTION,
    "delta_r": DEFLECTION,
    "phi": ATTITUDE,
    "theta": ATTITUDE,
    "psi": ATTITUDE,
    "V": 2000.0,
    "h": 100_000.0,
    "v": 2000.0,
    "Ay": LOAD,
    "delta_a_left": DEFLECTION,
    "delta_a_right": DEFLECTION,
    "delta_r_left": DEFLECTION,
    "delta_r_right": DEFLECTION,
}
"""Largest plausible magnitude of a target, in its unit; quaternions have none."""


def implausible(key: str, values: Array) -> Indices:
    """Rows with a value that no aircraft can reach."""
    bound = BOUNDS.get(key, np.inf)
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
