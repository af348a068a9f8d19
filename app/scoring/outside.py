"""Exceedances outside every manoeuvre: not assessed, and still not to be overlooked."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from app.scoring.limits_history import HeldLimits
from app.scoring.outcome import SAME_TIME, RecordedExceedance
from app.telemetry.traces import Traces
from core.channels import BY_KEY, CHANNELS
from core.types import Array

APART = 1.0
"""[s] Samples past a limit that lie closer are of one exceedance."""
BLOCK = 65_536
"""Samples that are looked at together."""
MANY = 3
"""Exceedances of one channel that are rather a fault of its mapping than of the flight."""
MOST_OUTSIDE = 1000
"""That are kept; the note tells of all."""


def outside(
    traces: Traces,
    limits: Array,
    intervals: Sequence[tuple[float, float]],
    trims: Sequence[Array],
    held: HeldLimits | None = None,
) -> tuple[RecordedExceedance, ...]:
    """The first recorded sample of each exceedance that begins in none of the manoeuvres.

    traces: repaired.   limits: (6,).   intervals: start and end of each manoeuvre, in order [s].
    trims: (6,) of each; between two, the one before counts, ahead of the first, its own.
    held: the limits that held when, instead of `limits`.
    One that began in a manoeuvre and goes on after it is that manoeuvre's.
    """
    starts, ends = np.array(intervals, np.float64).T
    subtracted = np.nan_to_num(np.array(trims))
    exceedances = []
    every = limits[None] if held is None else held.limits
    for c in np.flatnonzero(np.isfinite(every).any(axis=0)):
        key = CHANNELS[c].key
        if key not in traces.channels:
            continue
        trace = traces.channels[key]
        parts = []
        for first in range(0, len(trace.t), BLOCK):
            t, values = trace.t[first : first + BLOCK], trace.values[first : first + BLOCK]
            number = np.maximum(np.searchsorted(starts - SAME_TIME, t, "right") - 1, 0)
            value = values - subtracted[number, c]
            limit = np.full(len(t), limits[c]) if held is None else held.at(t)[:, c]
            over = np.isfinite(values) & (np.abs(value) >= limit)
            parts.append((t[over], number[over], value[over], limit[over]))
        t, number, value, limit = (np.concatenate(column) for column in zip(*parts, strict=True))
        inside = (t >= starts[number] - SAME_TIME) & (t <= ends[number] + SAME_TIME)
        begins = np.diff(t, prepend=-np.inf) > APART
        exceedances += [
            RecordedExceedance(
                float(t[i]), key, float(value[i]), None if held is None else float(limit[i])
            )
            for i in np.flatnonzero(begins & ~inside)
        ]
    return tuple(sorted(exceedances, key=lambda exceedance: exceedance.t))


def outside_note(exceedances: Sequence[RecordedExceedance]) -> tuple[str, ...]:
    """What a person should know of them; nothing where there are none."""
    if not exceedances:
        return ()
    first = exceedances[0]
    value = BY_KEY[first.channel].read(first.value)
    times = "once" if len(exceedances) == 1 else f"{len(exceedances)} times, first"
    counts = Counter(exceedance.channel for exceedance in exceedances)
    return (
        *(_suspicion(channel, n) for channel, n in counts.items() if n >= MANY),
        f"A limit was exceeded outside every manoeuvre, where nothing was assessed: {times} "
        f"{first.channel} {value} at {first.t:.2f} s.",
    )


def _suspicion(channel: str, n: int) -> str:
    return (
        f"{channel} reached its limit {n} times outside every manoeuvre: check the signal, unit, "
        f"sign and offset that {channel} is mapped with before any verdict is believed."
    )
