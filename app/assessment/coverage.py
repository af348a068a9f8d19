"""Coverage: was enough recorded and assessed for a verdict on a manoeuvre?

An exceedance or an alert may hide in a gap. So a gap of more than a few samples, or many small
ones, leave the outcome unknown; a single lost sample does not.
"""

from collections.abc import Sequence
from math import isnan, nan
from typing import NamedTuple

import numpy as np

from app.assessment.grid import missing_after
from app.assessment.input_checks import Doubt
from app.assessment.outcome import (
    OUTCOMES,
    Alerts,
    Hole,
    Limited,
    RecordedExceedance,
    holes_in,
    lost_in,
    runs,
)
from app.assessment.planned_test import needed_channels
from core.kernels.causal_grid import GAP_RATIO, RATE_RATIO
from core.limits.exceedance import NOT_PLAUSIBLE, SAME_TIME
from core.monitor import Assessment, Assessments, Monitor
from core.monitor.assessment import DATA_MISSING, STATES, State
from core.monitor.status import Level
from core.types import Array, Flags, Indices

MOST_LOST = 2
"""Monitor samples that may be missing in a row, not counting the warm-up after them."""
MOST_SHARE = 0.05
"""Share of the samples, or of the time, that may be missing in total."""
MAY_HAVE_EXCEEDED = "a limit may have been exceeded there"
WARMING_UP, OK = STATES.index(State.WARMING_UP), STATES.index(State.OK)


class Lost(NamedTuple):
    """The times of a manoeuvre at which a sample is due.

    t: (n,) [s].   lost: (n,) whether there is no assessment, not counting the first warm-up.
    missing: (n,) whether there is no valid sample.
    """

    t: Array
    lost: Flags
    missing: Flags


def lost_samples(t: Array, state: Indices, dt: float) -> Lost:
    """Which samples of a manoeuvre were not assessed, or not received.

    t: (n,) [s].   state: (n,) indices into STATES.   dt: of the monitor [s].
    """
    begun = state != WARMING_UP
    first = int(begun.argmax()) if begun.any() else len(begun)
    lost = (state != OK) & (np.arange(len(begun)) >= first)
    row = np.repeat(np.arange(len(begun)), 1 + missing_after(t, dt))
    since = np.arange(len(row)) - np.searchsorted(row, row)
    return Lost(
        t[row] + since * dt,
        lost[row] | (since > 0),
        (lost & begun)[row] | (since > 0),
    )


def why_exceedance_unknown(holes: Sequence[Hole], length: float, dt: float) -> str:
    """Why "no exceedance" is uncertain, because data are missing; "" if certain.

    holes: of the limited channels.   length: of the manoeuvre or flight [s].   dt: of the monitor
    [s].
    """
    if (longest := _most_missing(holes, length, dt)) is None:
        return ""
    return f"{_in_words(longest, holes)}; {MAY_HAVE_EXCEEDED}"


def _most_missing(holes: Sequence[Hole], length: float, dt: float) -> Hole | None:
    """The longest hole if too much is missing, else None. See why_exceedance_unknown."""
    longest = max(holes, key=lambda hole: hole.lost, default=None)
    if longest is None or not (_is_wide(longest, dt) or lost_in(holes) > MOST_SHARE * length):
        return None
    return longest


def _in_words(longest: Hole, holes: Sequence[Hole]) -> str:
    return (
        f"no sample of {longest.channel} from {longest.start:.2f} to {longest.end:.2f} s, "
        f"{lost_in(holes):.2f} s missing in total"
    )


def why_unflown_unknown(monitor: Monitor, t: Array, y: Array, step: float = 0.0) -> str:
    """Why "no manoeuvre was flown" is uncertain, because data are missing; "" if certain.

    t: (n,) on the monitor's grid [s].   y: (n, n_channels), NaN where missing.   step: usual one of
    the samples received [s].
    """
    dt, start, end, holes = monitor.dt, float(t[0]), float(t[-1]), list[Hole]()
    needed, known = needed_channels(monitor), np.isfinite(y)
    for c in monitor.dictionary.of_role("control"):
        if needed[c] or known[:, c].any():
            key = monitor.dictionary.keys[c]
            holes += holes_in(key, t[known[:, c]], start, end, dt)
    if (longest := _most_missing(holes, end - start, dt)) is None:
        return ""
    if step > RATE_RATIO * dt:
        rate = f"{1.0 / dt:.4g} Hz"
        return f"recorded at {1.0 / step:.4g} Hz, the monitor needs {rate}: send at {rate}"
    return f"{_in_words(longest, holes)}; a manoeuvre may have been flown there"


def why_outcome_unknown(
    limited: Limited, assessments: Assessments, alerts: Alerts | None, dt: float
) -> str:
    """Why "no exceedance" or "no alert" is uncertain, because data are missing; "" if certain.

    limited: of a manoeuvre without a recorded exceedance.   alerts: None where no sample was
    assessed.   dt: of the monitor [s].
    """
    if limited.implausible is not None:
        channel, at = limited.implausible
        return f"{channel} at {at:.2f} s is {NOT_PLAUSIBLE}; {MAY_HAVE_EXCEEDED}"
    length = float(assessments.t[-1] - assessments.t[0])
    if why := why_exceedance_unknown(limited.holes, length, dt):
        return f"data missing: {why}"
    why = "" if alerts != () else why_alert_unknown(assessments.t, assessments.state, dt)
    return f"data missing: {why}" if why else ""


def why_alert_unknown(t: Array, state: Indices, dt: float) -> str:
    """Why "no alert" in a manoeuvre is uncertain, because data are missing; "" if certain.

    See lost_samples.
    """
    t, lost, absent = lost_samples(t, state, dt)
    missing = _longest_run(absent)
    if _is_enough(missing[1] - missing[0], int(lost.sum()), len(lost)):
        return ""
    begin, end = _longest_run(lost)
    return (
        f"no sample assessed from {t[begin]:.2f} to {t[end - 1]:.2f} s, {lost.sum()} of "
        f"{len(lost)} in total; there may have been an alert"
    )


def why_limits_unknown(t: Array, unknown: Flags, what: str = "limits") -> str:
    """Why "no exceedance" is uncertain, because the limits in force are unknown; "" if certain.

    t: (n,) samples of a manoeuvre [s].   unknown: (n,) whether the limits at it are.   what: else
    is unknown.
    """
    if not unknown.any():
        return ""
    begin, end = _longest_run(unknown)
    return (
        f"{what} unknown from {t[begin]:.2f} to {t[end - 1]:.2f} s, {unknown.sum()} of "
        f"{len(unknown)} samples in total; {MAY_HAVE_EXCEEDED}"
    )


class CoverageSoFar:
    """The rule of `why_alert_unknown` in the manoeuvre in progress, one sample at a time.

    dt: of the monitor [s].   n_planned: samples of the planned manoeuvre, 0 if unknown: so long as
    it has fewer, their share is of these.
    """

    def __init__(self, dt: float, n_planned: int) -> None:
        self._dt, self._n_planned = dt, n_planned
        self._newest = nan
        self.doubts: tuple[Doubt, ...] = ()
        self._start(0, nan)

    def _start(self, manoeuvre: int, known: float) -> None:
        self._manoeuvre, self._has_begun = manoeuvre, False
        self._n = self._n_lost = self._in_row = self._most = 0
        self._known = known
        self._doubt = self.doubts = ()

    def note(self, assessment: Assessment, manoeuvre: int) -> None:
        """Add the next sample. manoeuvre: its number; 0 for none."""
        t = assessment.t
        before, self._newest = t if isnan(self._newest) else self._newest, t
        if manoeuvre != self._manoeuvre:
            self._start(manoeuvre, before)
        if not manoeuvre:
            return
        absent = round((t - before) / self._dt) - 1 if t - before > GAP_RATIO * self._dt else 0
        is_missing = assessment.cause in DATA_MISSING
        is_filling = assessment.state is State.WARMING_UP
        self._has_begun |= not is_filling
        self._n += 1 + absent
        self._n_lost += absent + (is_missing or (is_filling and self._has_begun))
        self._in_row += absent + is_missing
        if self._in_row >= max(self._most, 1):
            self._most = self._in_row
            gap = f"no sample from {self._known:.2f} to {t:.2f} s; {MAY_HAVE_EXCEEDED}"
            why = f"{OUTCOMES['unseen'].word}: {gap}"
            self._doubt = (Doubt(None, Level.CAUTION, self._known, why),)
        if not is_missing:
            self._in_row, self._known = 0, t
        enough = _is_enough(self._most, self._n_lost, max(self._n, self._n_planned))
        self.doubts = () if enough else self._doubt


def why_warning_unknown(
    limited: Limited,
    exceedance: RecordedExceedance,
    assessments: Assessments,
    alerts: Alerts,
    promised: float,
    dt: float,
) -> str:
    """Why it is unknown whether a timely alert was possible before an exceedance; "" if known.

    Either no sample was assessed before the exceedance. Or a hole ends at it, so its exact time is
    unknown and decides whether the alert was timely. Or no sample was assessed in the last interval
    for a timely alert: one lead long, ending one lead before the exceedance.
    promised: lead [s].   dt: of the monitor [s].
    """
    alert = alerts[0][0] if alerts and alerts[0][0] <= exceedance.t + SAME_TIME else None
    before = assessments.t < exceedance.t - SAME_TIME
    if alert is None and not (before & (assessments.state == OK)).any():
        return f"limit exceeded at {exceedance.t:.2f} s, before it could be assessed"
    for hole in limited.holes:
        ends_at_it = hole.channel == exceedance.channel and hole.end == exceedance.t
        is_sure = alert is not None and (
            alert + promised <= hole.start + SAME_TIME or alert + promised > hole.end + SAME_TIME
        )
        if ends_at_it and _is_wide(hole, dt) and not is_sure:
            doubt = "could not warn" if alert is None else "unknown whether the alert was timely"
            return (
                f"{doubt}: no sample from {hole.start:.2f} to {hole.end:.2f} s; the limit was "
                "exceeded in between"
            )
    if alert is not None and alert <= exceedance.t - promised + SAME_TIME:
        return ""
    t = lost_chance(assessments.t, assessments.state, exceedance.t, promised, dt)
    if not len(t):
        return ""
    return (
        f"could not warn: no sample assessed from {t[0]:.2f} to {t[-1]:.2f} s, the last interval "
        f"for a timely alert; the limit was exceeded at {exceedance.t:.2f} s"
    )


def lost_chance(t: Array, state: Indices, exceeded_t: float, promised: float, dt: float) -> Array:
    """Times of the last interval for a timely alert [s] if no sample of it was assessed, else none.

    t, state, dt: see lost_samples.   promised: lead [s].
    """
    last = exceeded_t - promised + SAME_TIME
    t, lost, _ = lost_samples(t, state, dt)
    chance = (t >= last - promised - 2 * SAME_TIME) & (t <= last)
    return t[chance & lost[chance].all()]


def _longest_run(flags: Flags) -> tuple[int, int]:
    """Bounds [begin, end) of the longest run of true flags."""
    first, last = max(runs(flags), key=lambda run: run[1] - run[0], default=(0, -1))
    return first, last + 1


def _is_enough(in_row: int, n_lost: int, n: int) -> bool:
    """in_row: samples missing in a row, at most.   n_lost: samples not assessed, of n."""
    return in_row <= MOST_LOST and n_lost <= MOST_SHARE * n


def _is_wide(hole: Hole, dt: float) -> bool:
    return hole.lost > MOST_LOST * dt + SAME_TIME
