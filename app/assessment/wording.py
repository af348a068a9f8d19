"""Sentences about a scored segment: its guarantee, its remarks, its limits in force."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from app.assessment.outcome import Limited, Peak
from app.assessment.planned_test import PlannedTest
from app.assessment.scored import Validity
from app.assessment.segments import Segment
from core.channels import BY_KEY, Channel, Dictionary
from core.evaluation.certificate import calibrated_on
from core.limits.exceedance import SAME_TIME
from core.limits.limits import exceeded_end, limits_in_words
from core.monitor import Assessments, Monitor
from core.monitor.assessment import STATES, State
from core.monitor.calibration import Guarantee

PROMISED: dict[Guarantee, str] = {
    "average": "on average over calibration sets",
    "95%": "with 95 % confidence in this monitor",
}


def alerts_above(epsilon: float, alert_above: float, promise: Guarantee) -> str:
    """`0.0495, the threshold for ε = 0.1 with 95 % confidence`: the risk that alerts."""
    confidence = "" if promise == "average" else f" with {promise[:-1]} % confidence"
    return f"{alert_above:.4g}, the threshold for ε = {epsilon:.4g}{confidence}"


def guarantee(monitor: Monitor, validity: Validity, epsilon: float, use: str = "") -> str:
    """The guarantee for a segment, or why it does not apply. use: of the flight in training."""
    if use:
        return f"No guarantee: {use}, so its result is no evidence."
    if validity.valid is not True:
        first, *more = validity.reasons
        others = f" (and {len(more)} more)" if more else ""
        status = "No guarantee" if validity.valid is None else "Guarantee withdrawn"
        return f"{status}: {first}{others}."
    level = monitor.support.level if monitor.support else 0.0
    open_ = [check.text for check in validity.checks if check.ok is None]
    drawn = (
        "those that calibrated it" if calibrated_on(monitor.evaluation) else "the simulated ones"
    )
    proviso = f" Not fully known whether this applies here: {'; '.join(open_)}." if open_ else ""
    return (
        f"At most {epsilon:.4g} of the flights that exceed a limit get no alert {monitor.lead:g} s "
        f"or more before it, {PROMISED[monitor.recipe.guarantee]}, for flights like "
        f"{drawn}; at most {level:.4g} of such flights are wrongly called invalid.{proviso}"
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
        lines += _not_exceeded(planned.dictionary, limited.peaks)
    lines += [
        _beyond_as_recorded(planned.dictionary, peak)
        for peak in limited.peaks
        if peak.largest is not None
        and not peak.is_beyond(peak.largest)
        and peak.is_beyond(peak.recorded)
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
    planned: PlannedTest,
) -> list[str]:
    """Remarks where other limits than the monitor's were in force.

    in_force: plain, see InForceTimeline.intervals.   own: judged by the monitor's limits where
    others were in force; else None.   planned: of the monitor.
    """
    if own is None:
        return []
    limits = limits_in_words(planned.dictionary, planned.limits)
    lines = [
        f"from {each['start']:.2f} to {each['end']:.2f} s {_in_force(each)}, the monitor warns of "
        f"{limits if planned.limits_known else 'unknown limits'}"
        for each in in_force
        if each["reason"]
    ]
    exceeded = own.exceedance
    if not planned.limits_known:
        by_own = ""
    elif exceeded is None:
        by_own = f"; the monitor's own {limits} was not exceeded"
    else:
        value = planned.dictionary.by_key[exceeded.channel].read(exceeded.value)
        by_own = (
            f"; the monitor's own {limits} was exceeded at {exceeded.t:.2f} s "
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


def _not_exceeded(dictionary: Dictionary, peaks: Sequence[Peak]) -> list[str]:
    """How close a manoeuvre came to its limits; unknown where no value is known."""
    known = ", ".join(
        _peak_in_words(dictionary.by_key[peak.channel], peak, peak.largest)
        for peak in peaks
        if peak.largest is not None
    )
    unknown = ", ".join(peak.channel for peak in peaks if peak.largest is None)
    lines = [f"no recorded sample exceeded a limit: {known}"] if known or not peaks else []
    if unknown:
        lines.append(f"no value of {unknown} from trim is known: a limit may have been exceeded")
    return lines


def _peak_in_words(channel: Channel, peak: Peak, value: float) -> str:
    """`|Ny| 0.45 g of 0.5 g from trim`; `Nz 4.2 g, limits -1 g and 4.9 g`."""
    trim = " from trim" if channel.reference == "trim" else ""
    if -peak.low == peak.high:
        limit = channel.read(peak.high)
        return f"|{channel.key}| {channel.read(abs(value))} of {limit}{trim}"
    ends = [channel.read(end) if isfinite(end) else "none" for end in (peak.low, peak.high)]
    return f"{channel.key} {channel.read(value)}{trim}, limits {' and '.join(ends)}"


def _beyond_as_recorded(dictionary: Dictionary, peak: Peak) -> str:
    channel = dictionary.by_key[peak.channel]
    included, parts = "with trim", "the trim is"
    if peak.bias:
        bias = channel.read(peak.bias)
        included = f"with trim and the bias of {bias} that the mapping removes"
        parts = "bias and trim are"
    limit = exceeded_end(peak.low, peak.high, peak.recorded)
    symmetric = -peak.low == peak.high
    name = f"|{peak.channel}|" if symmetric else peak.channel
    recorded = abs(peak.recorded) if symmetric else peak.recorded
    return (
        f"{name} as recorded, {included}, is {channel.read(recorded)}, beyond the limit of "
        f"{channel.read(limit)}: decide whether {parts} sensor error or really flown"
    )
