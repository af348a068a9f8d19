"""What came of a manoeuvre: the first exceedance of a limit, and whether an alert was in time."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from app.telemetry.traces import Traces
from core.channels import CHANNELS
from core.types import Array, Flags

Outcome = Literal[
    "timely_alert", "late_alert", "missed", "false_alert", "quiet", "unseen", "invalid", "unknown"
]
Alerts = tuple[tuple[float, float], ...]
GAP_RATIO = 1.5
"""Recorded samples further apart than this many usual steps have lost something between them."""
SAME_TIME = 1e-6
"""[s] Times that differ by less are the same: a clock counts from 1970."""


@dataclass(frozen=True)
class RecordedExceedance:
    """The first recorded sample that exceeds a limit. t: [s].   value: from trim, in its unit."""

    t: float
    channel: str
    value: float


class Hole(NamedTuple):
    """Times between which a channel has no sample [s].   lost: of them beyond a usual step [s]."""

    channel: str
    start: float
    end: float
    lost: float


class Peak(NamedTuple):
    """Largest magnitude of a limited channel: from trim, which is judged, and as recorded."""

    channel: str
    largest: float
    limit: float
    recorded: float


class Limited(NamedTuple):
    """What the recorded samples of the limited channels show between two times.

    lost: seconds of which one has no sample.   holes: of each limited channel.
    """

    exceedance: RecordedExceedance | None
    peaks: tuple[Peak, ...]
    lost: float
    holes: tuple[Hole, ...] = ()


def against_limits(traces: Traces, limits: Array, trim: Array, start: float, end: float) -> Limited:
    """Judge the recording's own samples, not those resampled for the monitor.

    traces: repaired.   limits, trim: (6,).   start, end: [s], both included.
    """
    exceedances: list[RecordedExceedance] = []
    peaks: list[Peak] = []
    holes: list[Hole] = []
    for c in np.flatnonzero(np.isfinite(limits)):
        key, trace = CHANNELS[c].key, traces.channels[CHANNELS[c].key]
        part = slice(*np.searchsorted(trace.t, (start - SAME_TIME, end + SAME_TIME)).tolist())
        known = np.isfinite(trace.values[part])
        t, recorded = trace.t[part][known], trace.values[part][known]
        value = recorded - trim[c]
        over = np.flatnonzero(np.abs(value) >= limits[c])
        if len(over):
            exceedances.append(RecordedExceedance(float(t[over[0]]), key, float(value[over[0]])))
        largest, as_recorded = (
            float(np.abs(values).max(initial=0.0)) for values in (value, recorded)
        )
        peaks.append(Peak(key, largest, float(limits[c]), as_recorded))
        holes += _holes(key, t, start, end)
    first = min(exceedances, key=lambda exceedance: exceedance.t, default=None)
    each = [sum(hole.lost for hole in holes if hole.channel == key) for key, *_ in peaks]
    return Limited(first, tuple(peaks), max(each, default=0.0), tuple(holes))


def _holes(key: str, t: Array, start: float, end: float) -> list[Hole]:
    """Holes of a channel between start and end. t: (n,) of the samples it has."""
    if len(t) < 2:
        return [Hole(key, start, end, end - start)]
    step = float(np.median(np.diff(t)))
    edges = np.concatenate([[start], t, [end]])
    steps = np.diff(edges)
    return [
        Hole(key, float(edges[i]), float(edges[i + 1]), float(steps[i] - step))
        for i in np.flatnonzero(steps > GAP_RATIO * step)
    ]


def runs(t: Array, alert: Flags) -> Alerts:
    """Times of the first and the last sample of each run of alerts [s]."""
    edges = np.flatnonzero(np.diff(alert.view(np.int8), prepend=0, append=0)).reshape(-1, 2)
    return tuple((float(t[begin]), float(t[end - 1])) for begin, end in edges)


def outcome(
    alerts: Alerts, exceedance: RecordedExceedance | None, promised: float
) -> tuple[Outcome, float | None]:
    """What a manoeuvre came to, and the lead from the first alert to the exceedance [s].

    promised: lead in effect [s]. A exceedance without an alert before it is a miss.
    """
    if exceedance is None:
        return ("false_alert" if alerts else "quiet"), None
    if not alerts or alerts[0][0] > exceedance.t + SAME_TIME:
        return "missed", None
    lead = exceedance.t - alerts[0][0]
    return ("timely_alert" if lead >= promised - SAME_TIME else "late_alert"), lead
