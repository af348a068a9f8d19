"""The motion in the raw numbers of a file, before their units are known."""

from collections.abc import Collection
from collections.abc import Mapping as AnyMapping
from math import pi

import numpy as np

from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.mapping.motion.motion import Motion, motion
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import TARGETS
from core.types import Array

MOST = 1_000_000
"""Samples that are searched for a jump of an angle."""
WRAP = 0.02
"""Deviation of a jump from a full turn, as a share of the turn."""
QUATERNION = ("q0", "q1", "q2", "q3")
TURNS = {"rad": 2.0 * pi, "deg": 360.0}


def motion_as_recorded(
    columns: Columns, times: AnyMapping[str, TimeSource], names: AnyMapping[str, str]
) -> tuple[Motion | None, dict[str, str]]:
    """The motion of signals, and the unit of each angle that jumps by a full turn.

    names: key of TARGETS -> signal of the file. Attitude from a quaternion is in radians.
    """
    units: dict[str, str] = {}
    for key in ("phi", "psi"):
        if key in names and (unit := turn_of(columns.values(names[key]))):
            units[key] = unit
    of_quaternion = angles_of_quaternion(names)
    derived = {key: ChannelSource(derivation=f"{key}_from_quaternion") for key in of_quaternion}
    mapping = Mapping(
        {key: ChannelSource(name, TARGETS[key].unit) for key, name in names.items()} | derived,
        dict(times),
    )
    try:
        traces = apply_mapping(columns, mapping)
    except TelemetryError:
        return None, units
    turns = units | dict.fromkeys(of_quaternion, "rad")
    return motion(traces, {key: TURNS[unit] for key, unit in turns.items()}), units


def angles_of_quaternion(names: Collection[str]) -> tuple[str, ...]:
    """Angles that are not recorded but follow from a quaternion."""
    is_complete = set(QUATERNION) <= set(names)
    return tuple(key for key in ("phi", "psi") if is_complete and key not in names)


def turn_of(values: Array) -> str:
    """The unit of an angle that jumps by a full turn; "" if it does not jump."""
    with np.errstate(invalid="ignore", over="ignore"):
        jumps = np.abs(np.diff(values[:MOST]))
    for unit, turn in TURNS.items():
        near = np.abs(jumps / turn - 1.0) < WRAP
        # most large jumps must be full turns, otherwise they are spikes
        if near.any() and near.sum() >= 0.5 * np.count_nonzero(jumps > 0.5 * turn):
            return unit
    return ""
