"""A scored recording in words: guarantee, remarks, and each manoeuvre as it is printed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from math import isnan
from typing import Any

import numpy as np

from app.assessment.outcome import (
    OBSERVATIONS,
    OUTCOMES,
    Alerts,
    Limited,
    Peak,
    RecordedExceedance,
    begins_in_words,
    lead_words,
    verdict_of,
)
from app.assessment.planned_test import PlannedTest, limits_of
from app.assessment.scored import ScoredManoeuvre, ScoredRecording, Validity
from app.assessment.segments import Segment
from app.telemetry.mapping.mapping import time_of_day
from app.telemetry.targets import TARGETS
from core.channels import BY_KEY, Channel, Dictionary
from core.clearance.equation_error import Estimate
from core.clearance.sensors import TOLERANCES, SensorCheck
from core.evaluation.certificate import calibrated_on
from core.limits.exceedance import NOT_PLAUSIBLE, SAME_TIME
from core.limits.limits import ends_in_words, exceeded_end, limits_in_words
from core.monitor import Assessments, Monitor
from core.monitor.assessment import STATES, State
from core.monitor.calibration import Guarantee
from core.monitor.validity.flown_input import amplitude_in_words

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


def withdrawn(
    assessments: Assessments, first: int, limited: Limited, alert_above: float, counted: Alerts
) -> str:
    """What the withdrawn assessments of a segment would have shown.

    first: the first withdrawn sample; an alert before it remains.   counted: alerts that count.
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
        counts = "remains" if counted else "counts as no warning"
        when = f"the alert at {t:.2f} s {counts}"
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
        and peak.is_beyond(peak.recorded)
        and (not peak.is_beyond(peak.largest) or _is_named(limited.recorded, peak.channel))
    ]
    worst = {each.channel: each for each in limited.worst}
    for each in limited.worst_recorded:
        from_trim, raw = (_place(e, planned.dictionary, False) for e in (worst[each.channel], each))
        if from_trim != raw:
            lines.append(f"worst value from trim {from_trim}; as recorded {raw}")
    if limited.lost > 0.0:
        lines.append(f"{limited.lost:.2f} s missing in the limited channels")
    if not (segment.is_rest or (assessments.state == STATES.index(State.OK)).all()):
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
    unknown = ", ".join(
        f"no value of {peak.channel} is known"
        if isnan(peak.recorded)
        else f"trim of {peak.channel} unknown, as recorded "
        + _peak_in_words(dictionary.by_key[peak.channel], peak, peak.recorded, is_trimmed=False)
        for peak in peaks
        if peak.largest is None
    )
    raw = any(each.is_beyond(each.recorded) for each in peaks if each.largest is not None)
    exceeded = "exceeded a limit from trim" if raw else "exceeded a limit"
    lines = [f"no recorded sample {exceeded}: {known}"] if known or not peaks else []
    return [*lines, f"{unknown}: a limit may have been exceeded"] if unknown else lines


def _peak_in_words(channel: Channel, peak: Peak, value: float, *, is_trimmed: bool = True) -> str:
    """`|Ny| 0.45 g of 0.5 g from trim`; `Nz 4.2 g, safe -1 g to 4.9 g`."""
    trim = " from trim" if channel.reference == "trim" and is_trimmed else ""
    if -peak.low == peak.high:
        limit, size = channel.read(peak.high), abs(value) if abs(value) > NOISE * peak.high else 0.0
        near = (channel.read(size, digits) for digits in range(3, 7))
        text = next((text for text in near if text != limit), limit)
        return f"|{channel.key}| {text} of {limit}{trim}"
    safe = ends_in_words(channel, peak.low, peak.high)
    return f"{channel.key} {channel.read(value)}{trim}, safe {safe}"


def _is_named(raw: RecordedExceedance | None, channel: str) -> bool:
    return raw is not None and raw.channel == channel and raw.doubt != NOT_PLAUSIBLE


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


NOISE = 1e-9
"""Share of a limit below which a value is rounding error."""
MOST_LISTED = 20
"""Exceedances outside every manoeuvre that are printed."""
NOTHING = "no sample assessed: see the state column of assessments.csv"


def verdict(monitor: Monitor, scored: ScoredRecording, *, of_day: bool = False) -> list[str]:
    """The lines for all manoeuvres and exceedances outside, in order of time.

    of_day: whether times are seconds of the day.
    """
    lines = [
        line
        for manoeuvre in scored.manoeuvres
        for line in _lines(monitor, scored, manoeuvre, of_day)
    ]
    outside = [
        f"outside every manoeuvre: {_place(exceedance, monitor.dictionary, of_day)}"
        for exceedance in scored.outside_exceedances[:MOST_LISTED]
    ]
    if (more := len(scored.outside_exceedances) - MOST_LISTED) > 0:
        outside.append(f"outside every manoeuvre: and {more} more")
    return lines + outside


def sensors(checks: Sequence[SensorCheck]) -> list[str]:
    """The sensor checks: one line for each comparison and each remark."""
    if not checks:
        return []
    lines = [f"Data compatibility, 95 % intervals; {TOLERANCES}:"]
    for check in checks:
        channel = TARGETS[check.channel]
        estimates = (
            ("scale", check.scale, 1.0, ""),
            ("bias", check.bias, channel.display_factor, f" {channel.display_unit}"),
            ("delay", check.delay, 1.0, " s"),
        )
        known = [
            f"{name} {_interval(estimate, factor, unit)}"
            for name, estimate, factor, unit in estimates
            if estimate
        ]
        lines.append(f"  {check.title}: {', '.join(known) or f'not checked: {check.unchecked}'}")
        lines += [f"    {remark}" for remark in check.remarks]
    return lines


def _interval(estimate: Estimate, factor: float, unit: str) -> str:
    value, low, high = (f"{factor * number:.3f}" for number in estimate)
    return f"{value} ({low} to {high}){unit}"


def _outcome(manoeuvre: ScoredManoeuvre) -> str:
    verdict = verdict_of(asdict(manoeuvre))
    if manoeuvre.exceedance is not None:
        return verdict
    words = OUTCOMES[manoeuvre.outcome].text
    of = amplitude_of(manoeuvre.outcome, manoeuvre.amplitude)
    return f"{verdict}; {words} from trim{of}" if verdict else f"{words}{of}"


def amplitude_of(outcome: str, share: float | None) -> str:
    """The share of the planned amplitude, for a manoeuvre without exceedance; else ""."""
    if share is None or outcome not in ("quiet", "false_alert"):
        return ""
    return amplitude_in_words([share])


def _time(t: float, of_day: bool) -> str:
    return f"{t:.2f} s, {time_of_day(t)}" if of_day else f"{t:.2f} s"


def _lines(
    monitor: Monitor, scored: ScoredRecording, manoeuvre: ScoredManoeuvre, of_day: bool
) -> Iterator[str]:
    times = f"{manoeuvre.start:.2f} to {manoeuvre.end:.2f} s"
    if of_day:
        times = f"{times}, {time_of_day(manoeuvre.start)} to {time_of_day(manoeuvre.end)}"
    yield f"{manoeuvre.name}, {times}: {_outcome(manoeuvre)}"
    if begins := begins_in_words(asdict(manoeuvre)):
        yield f"  {begins}"
    if manoeuvre.peak_risk is not None:
        yield from _risk(monitor, scored, manoeuvre, manoeuvre.peak_risk, of_day)
    elif manoeuvre.withdrawn_t is None:
        yield f"  {NOTHING}"
    else:
        yield "  first alert        INVALID"
    if manoeuvre.withdrawn_t is not None:
        since = _time(manoeuvre.withdrawn_t, of_day)
        yield f"  INVALID            from {since} on: no risk"
    yield f"  exceedance         {_exceedance(manoeuvre, monitor, of_day)}"
    if manoeuvre.outcome == "unknown":
        yield "  warning lead time  unknown"
    elif manoeuvre.outcome == "invalid":
        yield "  warning lead time  INVALID"
    elif manoeuvre.peak_risk is not None and manoeuvre.exceedance is not None:
        yield f"  warning lead time  {_lead(manoeuvre)}"
    moved = ", ".join(
        f"{channel.key} {channel.read(value)}"
        for channel, value in zip(monitor.dictionary.channels, manoeuvre.trim, strict=True)
        if value is not None and channel.reference == "trim"
    )
    if moved and any(manoeuvre.trim):
        yield f"  trim               {moved}"
    for remark in manoeuvre.remarks:
        yield f"  {remark}"
    for check in manoeuvre.validity.checks:
        if check.ok is not True:
            state = "unknown" if check.ok is None else "INVALID"
            yield f"  {state:18} {check.name}: {check.text}"
        elif check.name == OBSERVATIONS:
            yield f"  validity           {check.text}"
    yield f"  {manoeuvre.guarantee}"


def _risk(
    monitor: Monitor,
    scored: ScoredRecording,
    manoeuvre: ScoredManoeuvre,
    peak: float,
    of_day: bool,
) -> Iterator[str]:
    t = manoeuvre.peak_t
    when = ", never above the smallest value" if t is None else f" at {t:.2f} s"
    yield f"  peak risk          {peak:.3f}{when}"
    above = alerts_above(scored.epsilon, scored.alert_above, monitor.recipe.guarantee)
    if manoeuvre.alert_above is not None:
        yield f"  monitor in use     {manoeuvre.monitor}"
        above = f"{manoeuvre.alert_above:.4g}"
    yield f"  alerts above       {above}"
    alerts = manoeuvre.alerts
    yield f"  first alert        {f'at {_time(alerts[0][0], of_day)}' if alerts else 'none'}"
    if len(alerts) > 1:
        begin, end = alerts[-1]
        yield f"  alerts             {len(alerts)}, the last one {begin:.2f} to {end:.2f} s"


def _exceedance(manoeuvre: ScoredManoeuvre, monitor: Monitor, of_day: bool) -> str:
    exceedance, raw = manoeuvre.exceedance, manoeuvre.recorded_exceedance
    dictionary = monitor.dictionary
    if manoeuvre.outcome == "unknown":
        return "unknown"
    from_trim = [_place(exceedance, dictionary, of_day)] if exceedance else []
    recorded = [f"as recorded {_place(raw, dictionary, of_day)}"] if raw else []
    if from_trim or recorded:
        return "; ".join(from_trim + recorded)
    each = zip(dictionary.keys, manoeuvre.trim, limits_of(monitor).limited, strict=True)
    if unknown := [key for key, value, is_limited in each if is_limited and value is None]:
        return f"unknown, trim of {', '.join(unknown)} unknown"
    return "unknown" if manoeuvre.outcome == "unseen" else "none recorded"


def _place(exceedance: RecordedExceedance, dictionary: Dictionary, of_day: bool) -> str:
    value = dictionary.by_key[exceedance.channel].read(exceedance.value)
    doubt = f", {exceedance.doubt}" if exceedance.doubt else ""
    return f"at {_time(exceedance.t, of_day)} ({exceedance.channel} {value}{doubt})"


def _lead(manoeuvre: ScoredManoeuvre) -> str:
    if manoeuvre.outcome == "unseen":
        return "unknown"
    if manoeuvre.lead is None:
        return "none: no alert before the exceedance (a miss)"
    timely = "at least" if manoeuvre.outcome == "timely_alert" else "less than"
    ahead = (
        f"; up to {manoeuvre.look_ahead:.2g} s less in flight, where samples wait for later ones"
    )
    return (
        f"{lead_words(manoeuvre.lead)} s from the first alert, {timely} the promised "
        f"{manoeuvre.promised:.4g} s"
        f"{ahead if manoeuvre.look_ahead else ''}"
    )
