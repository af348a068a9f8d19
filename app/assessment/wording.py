"""Sentences about a scored segment: its guarantee, its remarks, its limits in force."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from app.assessment.limits_in_force import limits_in_words
from app.assessment.outcome import Limited, Peak
from app.assessment.planned_test import PlannedTest
from app.assessment.scored import Validity
from app.assessment.segments import Segment
from core.channels import BY_KEY
from core.limits.exceedance import SAME_TIME
from core.monitor import Assessments, Monitor
from core.monitor.assessment import STATES, State
from core.monitor.calibration import Guarantee
from core.types import Array

PROMISED: dict[Guarantee, str] = {
    "average": "on average over calibration sets",
    "95%": "with 95 % confidence in this monitor",
}


def alerts_above(epsilon: float, alert_above: float, promise: Guarantee) -> str:
    """`0.0495, the threshold for ε = 0.1 with 95 % confidence`: the risk that alerts."""
    confidence = "" if promise == "average" else f" with {promise[:-1]} % confidence"
    return f"{alert_above:.4g}, the threshold for ε = {epsilon:.4g}{confidence}"


def guarantee(monitor: Monitor, validity: Validity, epsilon: float) -> str:
    """The guarantee for a segment, or why it does not apply."""
    if validity.valid is not True:
        first, *more = validity.reasons
        others = f" (and {len(more)} more)" if more else ""
        status = "No guarantee" if validity.valid is None else "Guarantee withdrawn"
        return f"{status}: {first}{others}."
    level = monitor.support.level if monitor.support else 0.0
    open_ = [check.text for check in validity.checks if check.ok is None]
    proviso = f" Not fully known whether this applies here: {'; '.join(open_)}." if open_ else ""
    return (
        f"At most {epsilon:.4g} of the flights that exceed a limit get no alert {monitor.lead:g} s "
        f"or more before it, {PROMISED[monitor.recipe.guarantee]}, for flights like the simulated "
        f"ones; at most {level:.4g} of such flights are wrongly called invalid.{proviso}"
    )


def withdrawn(assessments: Assessments, first: int, limited: Limited, alert_above: float) -> str:
    """What the withdrawn assessments of a segment would have shown.

    first: the first withdrawn sample; an alert before it remains.
    """
    without, p_value = "without the withdrawal", assessments.p_value
    if np.isnan(p_value).all():
        return f"{without} there would be no risk either: no sample was assessed"
    over = np.flatnonzero(p_value > alert_above)
    if not len(over):
        peak = int(np.nanargmax(p_value))
        return (
            f"{without} the risk would have stayed at or below {alert_above:.4g}, at most "
            f"{p_value[peak]:.3f} at {assessments.t[peak]:.2f} s"
        )
    t, exceedance = float(assessments.t[over[0]]), limited.exceedance
    remains = over[0] < first
    when = f"{without} the risk would have exceeded {alert_above:.4g} at {t:.2f} s"
    if remains:
        when = f"the alert at {t:.2f} s remains"
    if exceedance is not None:
        ahead = exceedance.t - t
        side = "before" if ahead >= -SAME_TIME else "after"
        when = f"{when}, {abs(ahead):.2f} s {side} the exceedance"
    return f"{when}: withdrawn from {assessments.t[first]:.2f} s on" if remains else when


def remarks(
    planned: PlannedTest, segment: Segment, limited: Limited, assessments: Assessments
) -> tuple[str, ...]:
    """Remarks that limit the verdict on a segment."""
    lines = []
    if not planned.limits_known:
        lines.append(
            "the monitor does not record its limits: exceedance, miss and warning lead time are "
            "unknown"
        )
    elif limited.exceedance is None:
        lines += _not_exceeded(limited.peaks)
    lines += [
        _beyond_as_recorded(peak)
        for peak in limited.peaks
        if peak.largest is not None and peak.largest < peak.limit <= peak.recorded
    ]
    if limited.lost > 0.0:
        lines.append(f"{limited.lost:.2f} s missing in the limited channels")
    if not (assessments.state == STATES.index(State.OK)).all():
        counts = [
            f"{np.sum(assessments.state == code)} {state}" for code, state in enumerate(STATES)
        ]
        lines.append(f"samples: {', '.join(counts)}")
    if segment.requested is not None and segment.rest is not None:
        used = (segment.rest.stop - segment.rest.start) * planned.dt
        lines.append(
            f"trim from {segment.requested:g} s before the first input was requested; only "
            f"{used:.2f} s are recorded and used"
        )
    n_trim = round(planned.trim_segment_s / planned.dt)
    if segment.onset is not None and segment.onset - segment.first < n_trim:
        rested = (segment.onset - segment.first) * planned.dt
        lines.append(
            f"begins {rested:.2f} s before the first input, planned {planned.trim_segment_s:g} s"
        )
    return tuple(lines)


def limits_remarks(
    in_force: Sequence[Mapping[str, Any]],
    own: Limited | None,
    limits: Array | None,
) -> list[str]:
    """Remarks where other limits than the monitor's were in force.

    in_force: plain, see InForceTimeline.intervals.   own: judged by the monitor's limits (6,) where
    others were in force; else None.
    """
    if own is None:
        return []
    lines = [
        f"from {each['start']:.2f} to {each['end']:.2f} s {_in_force(each)}, the monitor warns of "
        f"{limits_in_words(limits)}"
        for each in in_force
        if each["reason"]
    ]
    exceeded = own.exceedance
    if limits is None:
        by_own = ""
    elif exceeded is None:
        by_own = f"; the monitor's own {limits_in_words(limits)} was not exceeded"
    else:
        value = BY_KEY[exceeded.channel].read(exceeded.value)
        by_own = (
            f"; the monitor's own {limits_in_words(limits)} was exceeded at {exceeded.t:.2f} s "
            f"({exceeded.channel} {value})"
        )
    return [
        *lines,
        "exceedances are judged by the limits in force; alerts and misses only where these are the "
        f"monitor's own{by_own}",
    ]


def _in_force(interval: Mapping[str, Any]) -> str:
    name = f"limit set {interval['name']} version {interval['version']}"
    if interval["limits"] is None:
        return f"the limits of {name} in force are unknown"
    limits = " or ".join(
        f"|{BY_KEY[key].symbol}| {BY_KEY[key].read(limit)}"
        for key, limit in interval["limits"].items()
    )
    return f"{limits} ({name}, {interval['case']}) in force"


def _not_exceeded(peaks: Sequence[Peak]) -> list[str]:
    """How close a manoeuvre came to its limits; unknown where no value is known."""
    known = ", ".join(
        f"|{peak.channel}| {BY_KEY[peak.channel].read(peak.largest)} of "
        f"{BY_KEY[peak.channel].read(peak.limit)} from trim"
        for peak in peaks
        if peak.largest is not None
    )
    unknown = ", ".join(peak.channel for peak in peaks if peak.largest is None)
    lines = [f"no recorded sample exceeded a limit: {known}"] if known or not peaks else []
    if unknown:
        lines.append(f"no value of {unknown} from trim is known: a limit may have been exceeded")
    return lines


def _beyond_as_recorded(peak: Peak) -> str:
    read = BY_KEY[peak.channel].read
    included, parts = "with trim", "the trim is"
    if peak.bias:
        included = f"with trim and the bias of {read(peak.bias)} that the mapping removes"
        parts = "bias and trim are"
    return (
        f"|{peak.channel}| as recorded, {included}, is {read(peak.recorded)}, beyond the limit of "
        f"{read(peak.limit)}: decide whether {parts} sensor error or really flown"
    )
