"""What was not seen: whether enough was recorded and assessed to say what came of a manoeuvre.

A limit may be exceeded, and an alert come, where nothing was recorded. So a hole of more than a few
samples, or many small ones, take the verdict away; a lone lost sample does not.
"""

import numpy as np

from app.scoring.outcome import SAME_TIME, Alerts, Hole, Limited, RecordedExceedance
from core.monitor import Assessments
from core.monitor.assessment import STATES, State
from core.types import Flags

MOST_LOST = 2
"""Samples of the monitor that may be missing in a row; the history after them is no such loss."""
MOST_SHARE = 0.05
"""Of the samples, or of the time, that may be missing altogether."""
WARMING_UP, OK = STATES.index(State.WARMING_UP), STATES.index(State.OK)


def unassessed(assessments: Assessments) -> Flags:
    """(n,) samples that could not be assessed, without those that the first history takes."""
    begun = assessments.state != WARMING_UP
    first = int(begun.argmax()) if begun.any() else len(begun)
    return (assessments.state != OK) & (np.arange(len(begun)) >= first)


def not_seen(limited: Limited, assessments: Assessments, alerts: Alerts, dt: float) -> str:
    """Why it is not known that no limit was exceeded, or that there was no alert; "" if it is.

    limited: of a manoeuvre in which no exceedance was seen.   dt: of the monitor [s].
    """
    length = float(assessments.t[-1] - assessments.t[0])
    longest = max(limited.holes, key=lambda hole: hole.lost, default=None)
    if longest and (_is_wide(longest, dt) or limited.lost > MOST_SHARE * length):
        return (
            f"not all was seen: no sample of {longest.channel} from {longest.start:.2f} to "
            f"{longest.end:.2f} s, {limited.lost:.2f} s are missing in all; whether a limit was "
            "exceeded there is not known"
        )
    lost = unassessed(assessments)
    missing = _longest_run(lost & (assessments.state != WARMING_UP))
    is_much = missing[1] - missing[0] > MOST_LOST or lost.sum() > MOST_SHARE * len(lost)
    if alerts or not is_much:
        return ""
    begin, end = _longest_run(lost)
    return (
        f"not all was seen: no sample could be assessed from {assessments.t[begin]:.2f} to "
        f"{assessments.t[end - 1]:.2f} s, {lost.sum()} of {len(lost)} in all; whether there would "
        "have been an alert is not known"
    )


def could_not_warn(
    limited: Limited,
    exceedance: RecordedExceedance,
    assessments: Assessments,
    alerts: Alerts,
    promised: float,
) -> str:
    """Why nothing can be assessments of the alert before a exceedance; "" if something can.

    Either a hole ends at the exceedance, and the time of the limit decides whether an alert was
    timely; or no sample was assessed in the last chance: as long as the lead, and a lead before.
    promised: lead [s].
    """
    alert = alerts[0][0] if alerts and alerts[0][0] <= exceedance.t + SAME_TIME else None
    dt = float(assessments.t[1] - assessments.t[0])
    for hole in limited.holes:
        ends_at_it = hole.channel == exceedance.channel and hole.end == exceedance.t
        is_sure = alert is not None and (
            alert + promised <= hole.start + SAME_TIME or alert + promised > hole.end + SAME_TIME
        )
        if ends_at_it and _is_wide(hole, dt) and not is_sure:
            what = "could not warn" if alert is None else "whether the alert was timely is unknown"
            return (
                f"{what}: no sample from {hole.start:.2f} to {hole.end:.2f} s; the limit was "
                "exceeded between these"
            )
    last = exceedance.t - promised + SAME_TIME
    if alert is not None and alert <= last:
        return ""
    chance = (assessments.t >= last - promised - 2 * SAME_TIME) & (assessments.t <= last)
    if not chance.any() or not unassessed(assessments)[chance].all():
        return ""
    begin, end = assessments.t[chance][[0, -1]]
    return (
        f"could not warn: no sample could be assessed from {begin:.2f} to {end:.2f} s, the last "
        f"in which an alert would have been timely; the limit was exceeded at {exceedance.t:.2f} s"
    )


def _longest_run(flags: Flags) -> tuple[int, int]:
    """First sample of the longest run, and the one after its last."""
    edges = np.flatnonzero(np.diff(flags.view(np.int8), prepend=0, append=0)).reshape(-1, 2)
    longest = edges[(edges[:, 1] - edges[:, 0]).argmax()] if len(edges) else (0, 0)
    return int(longest[0]), int(longest[1])


def _is_wide(hole: Hole, dt: float) -> bool:
    return hole.lost > MOST_LOST * dt + SAME_TIME
