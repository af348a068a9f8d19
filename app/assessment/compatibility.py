"""Put a recording's channels on one even grid and check that they agree by kinematics."""

from weakref import WeakKeyDictionary

import numpy as np

from app.telemetry.mapping.motion import (
    FULL_TURNS,
    LEADERS,
    STEP,
    on_even_times,
    windows_of_motion,
)
from app.telemetry.recording import Traces
from core.clearance.equation_error import CORRELATED_S
from core.clearance.sensors import NAMES, SensorCheck, SensorReadings, check_sensors
from core.types import Array

RATES = ("p", "r")
"""Not compared where they were derived from the attitude."""

_COMPARED: WeakKeyDictionary[Traces, tuple[SensorCheck, ...]] = WeakKeyDictionary()
"""Results for recordings still in memory. They do not depend on the monitor."""


def compatibility(traces: Traces) -> tuple[SensorCheck, ...]:
    """Compare the sensors of a recording, once; in a long one, where it moves most.

    traces: repaired.
    """
    if (checks := _COMPARED.get(traces)) is None:
        checks = _COMPARED[traces] = _compared(traces)
    return checks


def _compared(traces: Traces) -> tuple[SensorCheck, ...]:
    channels = {
        key: trace
        for key in NAMES
        if (trace := traces.channels.get(key)) is not None
        and np.isfinite(trace.values).any()
        and not (key in RATES and trace.derived)
    }
    leader = next((channels[key] for key in LEADERS if key in channels), None)
    apart = np.full(round(CORRELATED_S / STEP), np.nan)
    rows: dict[str, list[Array]] = {key: [apart] for key in channels}
    for start, end in windows_of_motion(channels, leader) if leader else ():
        grid = np.arange(start, end, STEP)
        for key, trace in channels.items():
            rows[key] += [on_even_times(grid, trace, FULL_TURNS.get(key)), apart]
    joined = {key: np.concatenate(parts) for key, parts in rows.items()}
    return check_sensors(SensorReadings(STEP, joined))
