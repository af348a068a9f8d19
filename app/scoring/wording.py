"""What a person should know of a scored segment, in sentences that do not flatter."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from app.scoring.limits_in_force import words_of
from app.scoring.outcome import SAME_TIME, Limited, Peak
from app.scoring.planned_test import PlannedTest
from app.scoring.scored import Validity
from app.scoring.segments import Segment
from core.channels import BY_KEY
from core.monitor import Assessments, Monitor
from core.monitor.assessment import STATES, State
from core.monitor.calibration import Guarantee
from core.types import Array

PROMISED: dict[Guarantee, str] = {
    "average": "on average over calibration sets",
    "95%": "with 95 % confidence in this monitor's own calibration set",
}


def guarantee(monitor: Monitor, validity: Validity, epsilon: float) -> str:
    """What is promised of a segment: the guarantee where the monitor is applicable."""
    if validity.valid is not True:
        first, *more = validity.reasons
        others = f" (and {len(more)} more)" if more else ""
        what = "Nothing is promised" if validity.valid is None else "The guarantee is withdrawn"
        return f"{what}: {first}{others}."
    level = monitor.support.level if monitor.support else 0.0
    open_ = [check.text for check in validity.checks if check.ok is None]
    proviso = f" Whether it applies here is not wholly known: {'; '.join(open_)}." if open_ else ""
    return (
        "Of flights like the simulated ones that exceed a limit, at most a share "
        f"{epsilon:.4g} has no alert {monitor.lead:g} s or more before, "
        f"{PROMISED[monitor.recipe.guarantee]}; at most a share {level:.4g} of such flights is "
        f"called invalid for its observations.{proviso}"
    )


def withdrawn(assessments: Assessments, first: int, limited: Limited, alert_above: float) -> str:
    """What became of the alert of a segment to which the monitor is not applicable, if it had one.

    first: the first sample that is withdrawn; an alert before it stands.
    """
    without, p_value = "without the withdrawal", assessments.p_value
    if np.isnan(p_value).all():
        return f"{without} there would be no risk either: no sample could be assessed"
    over = np.flatnonzero(p_value > alert_above)
    if not len(over):
        peak = int(np.nanargmax(p_value))
        return (
            f"{without} the risk would have stayed at or below {alert_above:.4g}, at most "
            f"{p_value[peak]:.3f} at {assessments.t[peak]:.2f} s"
        )
    t, exceedance = float(assessments.t[over[0]]), limited.exceedance
    stands = over[0] < first
    when = f"{without} the risk would have exceeded {alert_above:.4g} at {t:.2f} s"
    if stands:
        when = f"the alert at {t:.2f} s stands"
    if exceedance is not None:
        ahead = exceedance.t - t
        side = "before" if ahead >= -SAME_TIME else "after"
        when = f"{when}, {abs(ahead):.2f} s {side} the limit"
    return (
        f"{when}: withdrawn is what follows from {assessments.t[first]:.2f} s on"
        if stands
        else when
    )


def remarks(
    planned: PlannedTest, segment: Segment, limited: Limited, assessments: Assessments
) -> tuple[str, ...]:
    """What limits the verdict on a segment."""
    lines = []
    if not planned.limits_known:
        lines.append(
            "which limits the monitor was trained for is not known: exceedance, miss and warning "
            "lead time are unknown"
        )
    elif limited.exceedance is None:
        lines += _not_exceeded(limited.peaks)
    lines += [
        _beyond_as_recorded(peak)
        for peak in limited.peaks
        if peak.largest is not None and peak.largest < peak.limit <= peak.recorded
    ]
    if limited.lost > 0.0:
        lines.append(f"{limited.lost:.2f} s of the limited channels are missing")
    if not (assessments.state == STATES.index(State.OK)).all():
        counts = [
            f"{np.sum(assessments.state == code)} {state}" for code, state in enumerate(STATES)
        ]
        lines.append(f"samples: {', '.join(counts)}")
    if segment.asked is not None and segment.rest is not None:
        used = (segment.rest.stop - segment.rest.start) * planned.dt
        lines.append(
            f"trim from {segment.asked:g} s before the first input was asked for: {used:.2f} s are "
            "there and were used"
        )
    n_trim = round(planned.trim_segment_s / planned.dt)
    if segment.onset is not None and segment.onset - segment.first < n_trim:
        rested = (segment.onset - segment.first) * planned.dt
        lines.append(
            f"it begins {rested:.2f} s before the first input, "
            f"{planned.trim_segment_s:g} s are planned"
        )
    return tuple(lines)


def limits_remarks(
    in_force: Sequence[Mapping[str, Any]],
    own: Limited | None,
    limits: Array | None,
) -> list[str]:
    """Where other limits were in force than the monitor's: both, and what each says.

    in_force: plain, see HeldLimits.intervals.   own: by the monitor's limits (6,), where others
    were in force; None elsewhere.
    """
    if own is None:
        return []
    told = [
        f"from {one['start']:.2f} to {one['end']:.2f} s {_in_force(one)} in force, the monitor "
        f"warns of {words_of(limits)}"
        for one in in_force
        if one["reason"]
    ]
    exceeded = own.exceedance
    if limits is None:
        mine = ""
    elif exceeded is None:
        mine = f"; the monitor's own {words_of(limits)} was not exceeded"
    else:
        value = BY_KEY[exceeded.channel].read(exceeded.value)
        mine = (
            f"; the monitor's own {words_of(limits)} was exceeded at {exceeded.t:.2f} s "
            f"({exceeded.channel} {value})"
        )
    return [
        *told,
        "exceedances are judged by the limits in force, alerts and misses by the monitor's own, "
        f"where these were in force{mine}",
    ]


def _in_force(one: Mapping[str, Any]) -> str:
    name = f"limit set {one['name']} version {one['version']}"
    if one["limits"] is None:
        return f"nobody can tell which limits of {name} were"
    limits = " or ".join(
        f"|{BY_KEY[key].symbol}| {BY_KEY[key].read(limit)}" for key, limit in one["limits"].items()
    )
    return f"{limits} ({name}, {one['case']}) was"


def _not_exceeded(peaks: Sequence[Peak]) -> list[str]:
    """How near a manoeuvre came to its limits; nothing is denied where no value is known."""
    known = ", ".join(
        f"|{peak.channel}| {BY_KEY[peak.channel].read(peak.largest)} of "
        f"{BY_KEY[peak.channel].read(peak.limit)} from trim"
        for peak in peaks
        if peak.largest is not None
    )
    unknown = ", ".join(peak.channel for peak in peaks if peak.largest is None)
    lines = (
        [f"no limit was exceeded in what was recorded of it: {known}"] if known or not peaks else []
    )
    if unknown:
        lines.append(
            f"no value of {unknown} from trim is known: whether a limit was exceeded is unknown"
        )
    return lines


def _beyond_as_recorded(peak: Peak) -> str:
    read = BY_KEY[peak.channel].read
    included, decide = "trim included", "its trim is an error"
    if peak.bias:
        included = f"trim and the bias of {read(peak.bias)} that the mapping removes included"
        decide = "its bias and trim are errors"
    return (
        f"|{peak.channel}| as recorded, {included}, is {read(peak.recorded)}, beyond the limit of "
        f"{read(peak.limit)}: decide whether {decide} of the sensor or flown"
    )
