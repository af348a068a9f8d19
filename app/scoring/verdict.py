"""A scored recording as lines to print: each manoeuvre, and every doubt about it."""

from collections.abc import Iterator

from app.scoring.outcome import Crossing
from app.scoring.scored import OBSERVATIONS, ScoredRecording, ScoredStretch
from core.channels import CHANNELS, KEYS
from core.monitor import Monitor

OUTCOMES = {
    "timely_alert": "alert in time",
    "late_alert": "alert too late",
    "missed": "missed: a limit was reached without an alert",
    "false_alert": "alert, no limit reached",
    "quiet": "no alert, no limit reached",
    "unseen": "not all seen: nothing can be said",
    "invalid": "INVALID, no verdict",
    "unknown": "unknown: the monitor does not say which limits it was trained for",
}
MOST_TOLD = 20
"""Exceedances outside of the stretches."""
NOTHING = "no sample could be assessed: see the state column of assessments.csv"


def verdict(monitor: Monitor, scored: ScoredRecording) -> list[str]:
    """Everything that is said of each stretch, in the order of their times."""
    told = [line for stretch in scored.stretches for line in _lines(monitor, scored, stretch)]
    outside = [
        f"outside every manoeuvre: {_reached(crossing)}" for crossing in scored.outside[:MOST_TOLD]
    ]
    if (more := len(scored.outside) - MOST_TOLD) > 0:
        outside.append(f"outside every manoeuvre: and {more} more")
    return told + outside


def _lines(monitor: Monitor, scored: ScoredRecording, stretch: ScoredStretch) -> Iterator[str]:
    times = f"{stretch.start:.2f} to {stretch.end:.2f} s"
    yield f"{stretch.name}, {times}: {OUTCOMES[stretch.outcome]}"
    if stretch.peak_risk is not None:
        yield from _risk(monitor, scored.epsilon, stretch, stretch.peak_risk)
    elif stretch.withdrawn_t is None:
        yield f"  {NOTHING}"
    else:
        yield "  first alert   withdrawn"
    if stretch.withdrawn_t is not None:
        yield f"  withdrawn     from {stretch.withdrawn_t:.2f} s on: nothing is said any more"
    yield f"  first crossing {_crossing(stretch)}"
    if stretch.outcome == "unknown":
        yield "  lead          unknown"
    elif stretch.outcome == "invalid":
        yield "  lead          withdrawn"
    elif stretch.peak_risk is not None and stretch.crossing is not None:
        yield f"  lead          {_lead(monitor, stretch)}"
    moved = ", ".join(
        f"{channel.key} {value:.4g} {channel.unit}"
        for channel, value in zip(CHANNELS, stretch.trim, strict=True)
        if value is not None
    )
    if any(stretch.trim):
        yield f"  trim          {moved}"
    for remark in stretch.remarks:
        yield f"  {remark}"
    for check in stretch.validity.checks:
        if check.ok is not True:
            yield f"  {'in doubt' if check.ok is None else 'OUTSIDE':13} {check.name}: {check.text}"
        elif check.name == OBSERVATIONS:
            yield f"  validity      {check.text}"
    yield f"  {stretch.guarantee}"


def _risk(monitor: Monitor, epsilon: float, stretch: ScoredStretch, peak: float) -> Iterator[str]:
    least = peak <= monitor.smallest_epsilon
    when = ", never above its least" if least else f" at {stretch.peak_t:.2f} s"
    yield f"  peak risk     {peak:.3f}{when}"
    alerts = stretch.alerts
    if not alerts:
        yield f"  first alert   none (risk above epsilon {epsilon:g})"
        return
    yield f"  first alert   at {alerts[0][0]:.2f} s (risk above epsilon {epsilon:g})"
    if len(alerts) > 1:
        begin, end = alerts[-1]
        yield f"  alerts        {len(alerts)}, the last one {begin:.2f} to {end:.2f} s"


def _crossing(stretch: ScoredStretch) -> str:
    crossing = stretch.crossing
    if stretch.outcome == "unknown":
        return "unknown"
    if crossing is None:
        return "none in what was recorded"
    return _reached(crossing)


def _reached(crossing: Crossing) -> str:
    unit = CHANNELS[KEYS.index(crossing.channel)].unit
    return f"at {crossing.t:.2f} s ({crossing.channel} {crossing.value:.3g} {unit})"


def _lead(monitor: Monitor, stretch: ScoredStretch) -> str:
    if stretch.outcome == "unseen":
        return "not known"
    if stretch.lead is None:
        return "none: the monitor was silent before the crossing (a miss)"
    timely = "at least" if stretch.outcome == "timely_alert" else "short of"
    return f"{stretch.lead:.2f} s from the first alert, {timely} the promised {monitor.lead:g} s"
