"""What came of a manoeuvre: the first crossing of a limit, and whether an alert was in time."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from app.telemetry.traces import Traces
from core.channels import CHANNELS

Array = npt.NDArray[np.float64]

Outcome = Literal["timely_alert", "late_alert", "missed", "false_alert", "quiet", "invalid"]
GAP_RATIO = 1.5
"""Recorded samples further apart than this many usual steps have lost something between them."""
SAME_TIME = 1e-6
"""[s] Times that differ by less are the same: a clock counts from 1970."""


@dataclass(frozen=True)
class Crossing:
    """The first recorded sample that reaches a limit. t: [s].   value: from trim, in its unit."""

    t: float
    channel: str
    value: float


class Limited(NamedTuple):
    """What the recorded samples of the limited channels show between two times.

    peaks: channel key, largest magnitude, limit.   lost: seconds of which one has no sample.
    """

    crossing: Crossing | None
    peaks: tuple[tuple[str, float, float], ...]
    lost: float


def against_limits(traces: Traces, limits: Array, trim: Array, start: float, end: float) -> Limited:
    """Judge the recording's own samples, not those resampled for the monitor.

    traces: repaired.   limits, trim: (6,).   start, end: [s], both included.
    """
    crossings: list[Crossing] = []
    peaks: list[tuple[str, float, float]] = []
    lost = 0.0
    for c in np.flatnonzero(np.isfinite(limits)):
        key, trace = CHANNELS[c].key, traces.channels[CHANNELS[c].key]
        part = slice(*np.searchsorted(trace.t, (start - SAME_TIME, end + SAME_TIME)).tolist())
        known = np.isfinite(trace.values[part])
        t, value = trace.t[part][known], trace.values[part][known] - trim[c]
        over = np.flatnonzero(np.abs(value) >= limits[c])
        if len(over):
            crossings.append(Crossing(float(t[over[0]]), key, float(value[over[0]])))
        peaks.append((key, float(np.abs(value).max(initial=0.0)), float(limits[c])))
        lost = max(lost, _lost(t, start, end))
    first = min(crossings, key=lambda crossing: crossing.t, default=None)
    return Limited(first, tuple(peaks), lost)


def _lost(t: Array, start: float, end: float) -> float:
    """Seconds between start and end of which a channel has no sample. t: (n,) of those it has."""
    if len(t) < 2:
        return end - start
    step = float(np.median(np.diff(t)))
    steps = np.diff(t, prepend=start, append=end)
    return float((steps[steps > GAP_RATIO * step] - step).sum())


def runs(t: Array, alert: npt.NDArray[np.bool_]) -> tuple[tuple[float, float], ...]:
    """Times of the first and the last sample of each run of alerts [s]."""
    edges = np.flatnonzero(np.diff(alert.view(np.int8), prepend=0, append=0)).reshape(-1, 2)
    return tuple((float(t[begin]), float(t[end - 1])) for begin, end in edges)


def outcome(
    alerts: tuple[tuple[float, float], ...], crossing: Crossing | None, promised: float
) -> tuple[Outcome, float | None]:
    """What a stretch came to, and the lead from the first alert to the crossing [s].

    promised: lead in effect [s]. A crossing without an alert before it is a miss.
    """
    if crossing is None:
        return ("false_alert" if alerts else "quiet"), None
    if not alerts or alerts[0][0] > crossing.t + SAME_TIME:
        return "missed", None
    lead = crossing.t - alerts[0][0]
    return ("timely_alert" if lead >= promised - SAME_TIME else "late_alert"), lead
