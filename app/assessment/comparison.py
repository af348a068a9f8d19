"""Monitors on one flight, compared sample by sample."""

from copy import copy
from dataclasses import dataclass
from typing import Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from app.assessment.outcome import SAME_TIME, Alerts, alert_times
from core.monitor import State
from core.monitor.assessment import STATES
from core.types import Array, Flags

OK = STATES.index(State.OK)
WarningOutcome = Literal["timely_alert", "late_alert", "missed", "unseen"]


class Assessed:
    """Samples of a monitor, (n,) each: times, rising [s]; risk, NaN unless assessed; alerts."""

    def __init__(self, t: Array, p_value: Array, alert: Flags, state: npt.NDArray) -> None:
        is_known = state == OK
        self.t = t
        self.risk = np.where(is_known, p_value, np.nan)
        self.alert = alert & is_known

    def part(self, part: slice) -> Self:
        cut = copy(self)
        cut.t, cut.risk, cut.alert = self.t[part], self.risk[part], self.alert[part]
        return cut

    @property
    def n_assessed(self) -> int:
        return int(np.isfinite(self.risk).sum())

    @property
    def alerts(self) -> Alerts:
        return alert_times(self.t, self.alert)

    def warned(self, exceeded_t: float, lead: float, longest: float) -> "Warned":
        """How it warned of an exceedance.

        lead: promised [s].   longest: alerts that began longer before it do not count [s].
        """
        starts = (start for start, _ in self.alerts if start >= exceeded_t - longest)
        first = next((start for start in starts if start <= exceeded_t + SAME_TIME), None)
        if first is not None:
            reached = max(0.0, exceeded_t - first)
            return Warned("timely_alert" if reached >= lead - SAME_TIME else "late_alert", reached)
        in_time = (self.t >= exceeded_t - longest) & (self.t <= exceeded_t - lead + SAME_TIME)
        is_assessed = np.isfinite(self.risk[in_time]).any()
        return Warned("missed" if is_assessed else "unseen", None)


class Warned(NamedTuple):
    """lead: from the first alert to the exceedance [s]; None without one before it."""

    outcome: WarningOutcome
    lead: float | None


@dataclass(frozen=True)
class RiskDifference:
    """Two monitors where both assessed. largest: (t [s], risk of the first, of the second).

    only_first, only_second: intervals in which one of them alerts alone [s].
    """

    n_both: int
    largest: tuple[float, float, float] | None
    only_first: Alerts
    only_second: Alerts


def difference(first: Assessed, second: Assessed) -> RiskDifference:
    """Compare two monitors at the samples of the first: the nearest of the second's in time."""
    t = first.t
    if not len(t) or not len(second.t):
        return RiskDifference(0, None, (), ())
    after = np.clip(np.searchsorted(second.t, t), 1, max(len(second.t) - 1, 1))
    nearest = np.minimum(after, len(second.t) - 1)
    is_before = np.abs(second.t[after - 1] - t) <= np.abs(second.t[nearest] - t)
    nearest = np.where(is_before, after - 1, nearest)
    interval = np.median(np.diff(t)) if len(t) > 1 else 0.0
    is_near = np.abs(second.t[nearest] - t) <= 0.5 * interval + SAME_TIME
    apart = np.where(is_near, np.abs(first.risk - second.risk[nearest]), np.nan)
    both = np.isfinite(apart)
    largest = None
    if both.any():
        k = int(np.nanargmax(apart))
        largest = float(t[k]), float(first.risk[k]), float(second.risk[nearest[k]])
    alone = [(first.alert & ~second.alert[nearest]), (second.alert[nearest] & ~first.alert)]
    return RiskDifference(
        int(both.sum()), largest, *(alert_times(t, each & both) for each in alone)
    )


def longest_pass(t: Array) -> slice:
    """The longest run of rising times, the last of equals: a replay may jump and loop."""
    ends = np.append(np.flatnonzero(np.diff(t) <= 0) + 1, len(t))
    lengths = np.diff(ends, prepend=0)
    k = len(ends) - 1 - int(np.argmax(lengths[::-1]))
    return slice(int(ends[k] - lengths[k]), int(ends[k]))
