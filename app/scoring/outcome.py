"""What came of a manoeuvre: the first exceedance of a limit, and whether an alert was in time."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from app.telemetry.traces import Traces
from core.channels import CHANNELS
from core.types import Array, Flags

if TYPE_CHECKING:
    from app.scoring.limits_history import HeldLimits

Outcome = Literal[
    "timely_alert", "late_alert", "missed", "false_alert", "quiet", "unseen", "invalid", "unknown"
]
Alerts = tuple[tuple[float, float], ...]
GAP_RATIO = 1.5
"""Recorded samples further apart than this many usual steps have lost something between them."""
EXCEEDED = "LIMIT EXCEEDED"
UNWARNED: dict[Outcome, str] = {
    "invalid": "INVALID, no verdict",
    "unseen": "not all seen, no verdict",
}
"""Of an exceedance that is neither a miss nor a catch: the monitor was withdrawn, or blind."""
SAME_TIME = 1e-6
"""[s] Times that differ by less are the same: a clock counts from 1970."""


@dataclass(frozen=True)
class RecordedExceedance:
    """The first recorded sample that exceeds a limit. t: [s].   value: from trim, in its unit.

    limit: that it exceeds, where a limit set was in force; None for the monitor's own.
    """

    t: float
    channel: str
    value: float
    limit: float | None = None


class Hole(NamedTuple):
    """Times between which a channel has no sample [s].   lost: of them beyond a usual step [s]."""

    channel: str
    start: float
    end: float
    lost: float


class Peak(NamedTuple):
    """Largest magnitude of a limited channel: from trim, which is judged, and as recorded.

    largest: None where no value, or no trim, is known.   recorded: 0 where there is no value.
    bias: what the mapping subtracted of what was recorded.
    """

    channel: str
    largest: float | None
    limit: float
    recorded: float
    bias: float = 0.0


class Limited(NamedTuple):
    """What the recorded samples of the limited channels show between two times.

    lost: seconds of which one has no sample.   holes: of each limited channel.
    as_recorded: the first sample whose recorded value exceeds a limit, bias and trim included.
    """

    exceedance: RecordedExceedance | None
    peaks: tuple[Peak, ...]
    lost: float
    holes: tuple[Hole, ...] = ()
    as_recorded: RecordedExceedance | None = None


def against_limits(
    traces: Traces,
    limits: Array,
    trim: Array,
    start: float,
    end: float,
    held: "HeldLimits | None" = None,
) -> Limited:
    """Judge the recording's own samples, not those resampled for the monitor.

    traces: repaired.   limits, trim: (6,).   start, end: [s], both included.
    held: the limits that held when, instead of `limits`; a peak each of them.
    """
    exceedances: list[RecordedExceedance] = []
    raw: list[RecordedExceedance] = []
    peaks: list[Peak] = []
    holes: list[Hole] = []
    every = [limits] if held is None else held.during(start, end)
    for c in np.flatnonzero(np.isfinite(every).any(axis=0)):
        key = CHANNELS[c].key
        magnitudes = dict.fromkeys(float(one[c]) for one in every if np.isfinite(one[c]))
        if held is not None and key not in traces.channels:
            peaks += [Peak(key, None, limit, 0.0) for limit in magnitudes]
            continue
        trace = traces.channels[key]
        part = slice(*np.searchsorted(trace.t, (start - SAME_TIME, end + SAME_TIME)).tolist())
        known = np.isfinite(trace.values[part])
        t, values = trace.t[part][known], trace.values[part][known]
        value, recorded = values - trim[c], values + trace.bias
        limit = np.full(len(t), limits[c]) if held is None else held.at(t)[:, c]
        for judged, found in ((value, exceedances), (recorded, raw)):
            over = np.flatnonzero(np.abs(judged) >= limit)
            if len(over):
                i = over[0]
                told = None if held is None else float(limit[i])
                found.append(RecordedExceedance(float(t[i]), key, float(judged[i]), told))
        for magnitude in magnitudes:
            here = limit == magnitude
            if len(t) and not here.any():
                continue
            from_trim = value[here & np.isfinite(value)]
            largest = float(np.abs(from_trim).max()) if len(from_trim) else None
            as_recorded = float(np.abs(recorded[here]).max(initial=0.0))
            peaks.append(Peak(key, largest, magnitude, as_recorded, trace.bias))
        holes += _holes(key, t, start, end)
    first, first_raw = (
        min(found, key=lambda exceedance: exceedance.t, default=None)
        for found in (exceedances, raw)
    )
    each = [sum(hole.lost for hole in holes if hole.channel == key) for key, *_ in peaks]
    return Limited(first, tuple(peaks), max(each, default=0.0), tuple(holes), first_raw)


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


def lead_words(lead: float) -> str:
    """`1.34`: a lead to the hundredth of a second, rounded down: never more than there was."""
    return f"{floor(100.0 * (lead + SAME_TIME)) / 100.0:.2f}"


def warning_words(outcome: Outcome, lead: float | None, promised: float | None = None) -> str:
    """How an exceedance was warned of: `warned 0.45 s before the limit`.

    lead: [s] from the first alert to it.   promised: lead time that the monitor states [s], named
    where the alert was late; None where it is not known.
    """
    if lead is None or outcome not in ("timely_alert", "late_alert"):
        return UNWARNED.get(outcome, "missed: no alert before the limit")
    warned = f"warned {lead_words(lead)} s before the limit"
    if outcome == "timely_alert":
        return warned
    return f"{warned}: too late" if promised is None else f"{warned} ({promised:.4g} s promised)"


def exceedance_verdict(
    outcome: Outcome,
    lead: float | None,
    *,
    promised: float | None = None,
    exceeded: bool = True,
    recorded: bool = False,
) -> str:
    """The outcome of an exceedance, in the words of every view; "" where there was none.

    lead, promised: see warning_words.   exceeded: from trim, as the monitor judges.
    recorded: as recorded.
    """
    if not exceeded:
        return f"{EXCEEDED} as recorded, not from trim" if recorded else ""
    return f"{EXCEEDED}, {warning_words(outcome, lead, promised)}"


def verdict_of(manoeuvre: Mapping[str, Any], promised: float | None = None) -> str:
    """The exceedance_verdict of a scored manoeuvre in plain data, as stored."""
    return exceedance_verdict(
        manoeuvre["outcome"],
        manoeuvre["lead"],
        promised=promised,
        exceeded=manoeuvre["exceedance"] is not None,
        recorded=manoeuvre.get("recorded_exceedance") is not None,
    )
