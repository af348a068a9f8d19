"""Print a scored recording: each manoeuvre and the checks it did not pass."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict

from app.assessment.outcome import OUTCOMES, RecordedExceedance, lead_words, verdict_of
from app.assessment.scored import OBSERVATIONS, ScoredManoeuvre, ScoredRecording
from app.assessment.wording import alerts_above
from app.telemetry.mapping.mapping import time_of_day
from app.telemetry.targets import TARGETS
from core.channels import Dictionary
from core.clearance.equation_error import Estimate
from core.clearance.sensors import TOLERANCES, SensorCheck
from core.monitor import Monitor
from core.monitor.validity.flown_input import amplitude_in_words

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
    if manoeuvre.peak_risk is not None:
        yield from _risk(monitor, scored, manoeuvre, manoeuvre.peak_risk, of_day)
    elif manoeuvre.withdrawn_t is None:
        yield f"  {NOTHING}"
    else:
        yield "  first alert        withdrawn"
    if manoeuvre.withdrawn_t is not None:
        since = _time(manoeuvre.withdrawn_t, of_day)
        yield f"  withdrawn          from {since} on: no assessments"
    yield f"  exceedance         {_exceedance(manoeuvre, monitor.dictionary, of_day)}"
    if manoeuvre.outcome == "unknown":
        yield "  warning lead time  unknown"
    elif manoeuvre.outcome == "invalid":
        yield "  warning lead time  withdrawn"
    elif manoeuvre.peak_risk is not None and manoeuvre.exceedance is not None:
        yield f"  warning lead time  {_lead(monitor, manoeuvre)}"
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
            state = "unknown" if check.ok is None else "OUTSIDE"
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


def _exceedance(manoeuvre: ScoredManoeuvre, dictionary: Dictionary, of_day: bool) -> str:
    exceedance = manoeuvre.exceedance
    if manoeuvre.outcome == "unknown":
        return "unknown"
    if exceedance is None:
        raw = manoeuvre.recorded_exceedance
        return f"as recorded {_place(raw, dictionary, of_day)}" if raw else "none recorded"
    return _place(exceedance, dictionary, of_day)


def _place(exceedance: RecordedExceedance, dictionary: Dictionary, of_day: bool) -> str:
    value = dictionary.by_key[exceedance.channel].read(exceedance.value)
    doubt = f", {exceedance.doubt}" if exceedance.doubt else ""
    return f"at {_time(exceedance.t, of_day)} ({exceedance.channel} {value}{doubt})"


def _lead(monitor: Monitor, manoeuvre: ScoredManoeuvre) -> str:
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
        f"{monitor.lead:g} s"
        f"{ahead if manoeuvre.look_ahead else ''}"
    )
