"""The points of a campaign: planned, cleared, flown, and over.

The states are those used on the radio. A point that a computation clears is "on condition" until a
person confirms the checklist.
"""

from dataclasses import dataclass, replace
from datetime import datetime
from math import ceil
from typing import Literal

import numpy as np

from core.bounds import quoted
from core.clearance.clearance import ClearanceRecipe
from core.clearance.with_monitor import MONITOR
from core.evaluation.rates import clopper_pearson
from core.monitor.recipe import MonitorRecipe
from core.planned_test.nonlinear_test import JsbsimTest, SixDofTest
from core.planned_test.planned_test import DatasetRecipe, ManeuverTest, needs_limits
from core.types import Array

FOOT, KNOT = 0.3048, 1852.0 / 3600.0
State = Literal["planned", "on condition", "cleared", "hold", "complete", "aborted"]


class CampaignError(ValueError):
    """An action that the campaign does not allow in its present state."""


@dataclass(frozen=True)
class Event:
    """A change of a point's state.   at: UTC, ISO 8601.   by: who."""

    at: str
    by: str
    state: State
    words: str = ""

    def __post_init__(self) -> None:
        if not self.by.strip():
            raise CampaignError("no name was given: enter the name of the person who decides")
        try:
            datetime.fromisoformat(self.at)
        except ValueError:
            raise CampaignError(f"at is {quoted(self.at)}: give a time in ISO 8601") from None


@dataclass(frozen=True)
class FlownPoint:
    """A point as flown.

    source: recording and time in it.   y: (n_samples, n_channels) from trim, one each dt of the
    test; empty for a point aborted in flight, which is not used for computing.   reached: largest
    part of a limit.   exceeded: channel and time, or empty.   recording: id, where it is stored.
    start, end: in the recording [s].   remark: on the flown input, or empty.
    """

    source: str
    y: tuple[tuple[float, ...], ...]
    reached: float
    exceeded: str = ""
    recording: str = ""
    start: float | None = None
    end: float | None = None
    remark: str = ""

    def __post_init__(self) -> None:
        if self.y:
            _check_samples(self.y)
        if not 0.0 <= self.reached < np.inf:
            raise CampaignError(f"reached is {self.reached:g}: give a part of a limit, 0 or more")


@dataclass(frozen=True)
class Clearing:
    """The clearance computed for a point before it is flown.

    steps: the flown points it is computed from.   reached: predicted part of a limit, 5 %, 50 % and
    95 %.   withdrawn: failed checks that void the guarantee.   n_exceeding: simulated aircraft that
    exceed a limit and calibrate it; p_value is None where they are too rare.   n_tried,
    exceeding_share: number of simulated aircraft, and the share of them that exceed.
    amplitude_deg: largest recommended amplitude, under its own guarantee.   p_error: standard error
    of p_value over other random draws; None also for clearances of version 0.1.   monitor_epsilon:
    epsilon of the point's monitor, which is then a part of the clearance; None without one.
    """

    cleared: bool
    p_value: float | None
    clear_below: float | None
    reached: tuple[float, float, float]
    amplitude_deg: float | None
    withdrawn: tuple[str, ...]
    n_exceeding: int
    n_tried: int
    recipe: ClearanceRecipe
    steps: tuple[str, ...]
    exceeding_share: float | None = None
    p_error: float | None = None
    monitor_epsilon: float | None = None

    def __post_init__(self) -> None:
        for name in ("p_value", "clear_below", "exceeding_share", "p_error", "monitor_epsilon"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value <= 1.0:
                raise CampaignError(f"{name} is {value:g}: give a number from 0 to 1")

    @property
    def monitor(self) -> MonitorRecipe | None:
        """Recipe of the monitor that is a part of the clearance; None without one."""
        epsilon = self.monitor_epsilon
        return None if epsilon is None else replace(MONITOR, epsilon=epsilon)

    @property
    def is_close(self) -> bool:
        """Whether the p-value is within two of its errors of the threshold."""
        if self.p_value is None or self.clear_below is None or self.p_error is None:
            return False
        return abs(self.p_value - self.clear_below) <= 2.0 * self.p_error

    @property
    def exceeding_share_at_most(self) -> float | None:
        """Upper bound on the share of aircraft that exceed a limit, with 95 % confidence."""
        if self.exceeding_share is None:
            return None
        n_met = round(self.exceeding_share * self.n_tried)
        return float(clopper_pearson(n_met, self.n_tried, confidence=0.9)[1])


@dataclass(frozen=True)
class Condition:
    """A flight condition, with the planned test of its last point.

    Derivatives hold for one flight condition: steps at one never clear a point at another.
    """

    name: str
    test: ManeuverTest

    def __post_init__(self) -> None:
        needs_limits(self.test, "a campaign")

    @property
    def is_identifiable(self) -> bool:
        """Whether flown steps identify the aircraft: a linear one."""
        return isinstance(self.test, DatasetRecipe)

    @property
    def aircraft(self) -> str:
        return self.test.aircraft.description.split(";")[0]

    @property
    def trim(self) -> str:
        """Trim before the manoeuvre, as far as known: altitude, airspeed, Mach, load factor."""
        test, more = self.test, ()
        if isinstance(test, SixDofTest):
            at = test.condition
            altitude, airspeed = at.altitude_m, at.point.airspeed
            more = (f"Mach {at.mach:.3g}", f"load factor {at.load_factor:.3g} g")
            more += (f"flight path angle {at.path_deg:.3g} deg",) if at.path_deg else ()
        elif isinstance(test, DatasetRecipe):
            known = test.aircraft.condition
            altitude, airspeed = known.altitude, known.airspeed
        else:
            altitude = airspeed = None
        height = (
            () if altitude is None else (f"altitude {altitude / FOOT:,.0f} ft ({altitude:.0f} m)",)
        )
        speed = () if airspeed is None else (f"{airspeed / KNOT:.0f} kt true airspeed",)
        return ", ".join((*height, *speed, *more))

    @property
    def full_deg(self) -> float | None:
        """Command of full stick or pedal [deg]; None where commands are of the surface."""
        return self.test.aircraft.full_deg if isinstance(self.test, JsbsimTest) else None


@dataclass(frozen=True)
class Point:
    """A point of a campaign.

    peak_deg: of the manoeuvre's command.   condition: name of its flight condition.
    passes_below: pass criterion, the part of a limit to stay below.   criteria: further pass
    criteria, in words.   monitor: id of the monitor trained for it, where it is stored.
    """

    name: str
    peak_deg: float
    events: tuple[Event, ...] = ()
    clearing: Clearing | None = None
    flown: FlownPoint | None = None
    condition: str = ""
    passes_below: float = 1.0
    criteria: str = ""
    monitor: str = ""

    @property
    def state(self) -> State:
        return self.events[-1].state if self.events else "planned"

    @property
    def is_over(self) -> bool:
        return self.state in ("complete", "aborted")

    @property
    def failed(self) -> bool:
        """Whether it was flown, in full or in part, and did not pass."""
        return self.flown is not None and self.flown.reached >= self.passes_below


def _check_samples(samples: tuple[tuple[float, ...], ...]) -> None:
    try:
        y = np.array(samples, np.float64)
    except ValueError:
        y = np.empty((0, 0))
    if y.ndim != 2 or len(y) < 2 or not np.isfinite(y).all():
        raise CampaignError(
            f"the flown samples have the shape {y.shape}: give finite samples (n_samples, "
            "n_channels)"
        )


def percent_at_most(share: float) -> str:
    """An upper bound in percent, rounded up so that it stays one."""
    return f"{ceil(1e4 * share - 1e-9) / 100:.2f} %"


SAME, SHIFTED = 0.02, 4
"""Samples of one flight agree within this share of each channel's peak; cut out twice, they are
shifted by at most one in so many of its samples."""


def is_same_flight(a: FlownPoint, b: FlownPoint) -> bool:
    """Whether two points have the samples of one flight, from whatever trim and first sample."""
    one, other = samples_of(a), samples_of(b)
    if one.ndim != 2 or one.shape[1:] != other.shape[1:]:
        return False
    most = SAME * np.abs(other).max(axis=0)
    for shift in range(-len(one) // SHIFTED, len(one) // SHIFTED + 1):
        first, second = one[max(shift, 0) :], other[max(-shift, 0) :]
        n = min(len(first), len(second))
        gap = first[:n] - second[:n]
        if (np.abs(gap - np.median(gap, axis=0)) <= most).all():
            return True
    return False


def samples_of(point: FlownPoint) -> Array:
    """(n_samples, n_channels) of a flown point."""
    return np.array(point.y, np.float64)
