"""Exceedances outside every manoeuvre: not assessed, but reported."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from app.assessment.limits_history import InForceTimeline
from app.assessment.outcome import SAME_TIME, RecordedExceedance
from app.telemetry.recording import Traces
from core.channels import BY_KEY, CHANNELS
from core.limits.exceedance import onsets
from core.types import Array

APART = 1.0
"""[s] Samples beyond a limit that lie closer together are one exceedance."""
BLOCK = 65_536
"""Samples processed at a time."""
MANY = 3
"""This many exceedances of one channel suggest a fault in its mapping."""
MOST_OUTSIDE = 1000
"""Exceedances that are stored; the note counts all."""


def exceedances_outside(
    traces: Traces,
    limits: Array,
    intervals: Sequence[tuple[float, float]],
    trims: Sequence[Array],
    timeline: InForceTimeline | None = None,
) -> tuple[RecordedExceedance, ...]:
    """The first recorded sample of each exceedance that begins outside all manoeuvres.

    traces: repaired.   limits: (6,).   intervals: start and end of each manoeuvre, in order [s].
    trims: (6,) of each manoeuvre. It applies until the next one; the first applies before, too.
    timeline: limits in force over time, instead of `limits`.
    An exceedance that begins in a manoeuvre and outlasts it belongs to that manoeuvre.
    """
    starts, ends = np.array(intervals, np.float64).T
    subtracted = np.nan_to_num(np.array(trims))
    exceedances = []
    in_force = limits[None] if timeline is None else timeline.limits
    for c in np.flatnonzero(np.isfinite(in_force).any(axis=0)):
        key = CHANNELS[c].key
        if key not in traces.channels:
            continue
        trace = traces.channels[key]
        parts = []
        for first in range(0, len(trace.t), BLOCK):
            t, values = trace.t[first : first + BLOCK], trace.values[first : first + BLOCK]
            number = np.maximum(np.searchsorted(starts - SAME_TIME, t, "right") - 1, 0)
            value = values - subtracted[number, c]
            limit = np.full(len(t), limits[c]) if timeline is None else timeline.at(t)[:, c]
            over = onsets(t, value, limit)
            parts.append((t[over], number[over], value[over], limit[over]))
        t, number, value, limit = (np.concatenate(column) for column in zip(*parts, strict=True))
        inside = (t >= starts[number] - SAME_TIME) & (t <= ends[number] + SAME_TIME)
        exceedances += [
            RecordedExceedance(
                float(t[i]), key, float(value[i]), None if timeline is None else float(limit[i])
            )
            for i in onsets(t, value, limit, APART)
            if not inside[i]
        ]
    return tuple(sorted(exceedances, key=lambda exceedance: exceedance.t))


def notes_on_outside(exceedances: Sequence[RecordedExceedance]) -> tuple[str, ...]:
    """Notes on exceedances outside the manoeuvres, for people; empty without any."""
    if not exceedances:
        return ()
    first = exceedances[0]
    value = BY_KEY[first.channel].read(first.value)
    times = "once" if len(exceedances) == 1 else f"{len(exceedances)} times, first"
    counts = Counter(exceedance.channel for exceedance in exceedances)
    return (
        *(_suspicion(channel, n) for channel, n in counts.items() if n >= MANY),
        f"Limit exceeded outside every manoeuvre, where nothing is assessed: {times} "
        f"{first.channel} {value} at {first.t:.2f} s.",
    )


def _suspicion(channel: str, n: int) -> str:
    return (
        f"{channel} exceeded its limit {n} times outside every manoeuvre: before you trust any "
        f"verdict, check the signal, unit, sign and offset in the mapping of {channel}."
    )
