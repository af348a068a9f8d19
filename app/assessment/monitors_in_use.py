"""The monitor set of a flight: which of its monitors is in use at each flight condition.

Each monitor is used unchanged, at its own epsilon and limits. One that comes into use starts with
an empty history, so no p-value mixes the samples of two conditions. One that needs a manoeuvre from
its beginning is not applicable to the rest of it. Conditions may overlap: the monitor in use stays
in use while its own condition holds. Between the conditions of the set, and where the condition is
unknown, none is applicable; what is beyond the limits of each of them still exceeds.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from app.assessment.planned_test import known_test
from app.assessment.rulings import ConditionRule, Ruling
from app.assessment.trim import departure, input_sizes
from core.conditions import ConditionKey
from core.limits.limits import Envelope
from core.monitor import Monitor
from core.monitor.assessment import Cause
from core.monitor.monitor_set import MonitorSet
from core.monitor.status import NOT_APPLICABLE
from core.types import Array


@dataclass(frozen=True, eq=False)
class MonitorsInUse:
    """A stored monitor set in a flight.

    ids, names: of the monitor of each case.   fixed: declared values of the flight condition.
    """

    id: str
    name: str
    monitors: MonitorSet[Monitor]
    ids: tuple[str, ...]
    names: tuple[str, ...]
    fixed: Mapping[ConditionKey, float]

    def to_plain(self) -> dict[str, Any]:
        """Its record in the journal of a flight."""
        cases = [
            {"name": case.name, "ranges": dict(case.ranges), "monitor": monitor_id}
            for case, monitor_id in zip(self.monitors.cases, self.ids, strict=True)
        ]
        return {"id": self.id, "name": self.name, "cases": cases, "fixed": dict(self.fixed)}

    @property
    def members(self) -> list[Monitor]:
        return [case.monitor for case in self.monitors.cases]

    def monitor(self, case: int) -> Monitor:
        return self.monitors.cases[case].monitor

    def departure(self) -> Array:
        """(n_controls,) motion with which an input begins, the least of any monitor."""
        sizes = [input_sizes(known_test(member)) for member in self.members]
        return departure(np.min(sizes, axis=0))


def needs_beginning(monitor: Monitor, case: str, t: float) -> str:
    """Why a monitor that comes into use at t [s] within a manoeuvre says nothing of the rest of it.

    Empty unless it forecasts the rest of a manoeuvre or checks its input from the beginning on.
    """
    basis = monitor.validity_basis
    if monitor.forecast is None and (basis is None or basis.input_shape is None):
        return ""
    return (
        f"{NOT_APPLICABLE}: {case} holds since {t:.2f} s, within the manoeuvre, and its "
        "monitor needs the beginning"
    )


@dataclass(frozen=True, eq=False)
class MonitorRuling(Ruling):
    """Which monitor of a set is in use for a sample. used: number of its case; None for none."""

    member: ClassVar[str] = "monitor"
    in_use: MonitorsInUse
    used: int | None

    @property
    def reason(self) -> str:
        """Why no monitor is in use; empty where one is."""
        return self.reasons[0]

    @property
    def monitor_id(self) -> str:
        """Of the monitor in use; empty where none is."""
        return "" if self.used is None else self.in_use.ids[self.used]

    @property
    def monitor_name(self) -> str:
        return "" if self.used is None else self.in_use.names[self.used]


class MonitorsRule(ConditionRule[MonitorRuling]):
    """Which monitor of a set is in use at each flight condition."""

    def __init__(self, in_use: MonitorsInUse) -> None:
        super().__init__(in_use.monitors, in_use.fixed)
        self._in_use = in_use

    def _of_case(self, case: int) -> MonitorRuling:
        name, monitor = self._in_use.monitors.cases[case].name, self._in_use.monitor(case)
        about = monitor.envelope, monitor.specification, name, ("",), Cause.NOT_APPLICABLE
        return MonitorRuling(*about, self._in_use, case)

    def _without(self, reason: str) -> MonitorRuling:
        """With the limits that all monitors share; where they differ, judged by the widest."""
        first, *others = members = self._in_use.members
        if all(other.specification == first.specification for other in others):
            limits = first.envelope, first.specification
        else:
            limits = Envelope.widest([each.envelope for each in members]), None
        reasons = (f"{NOT_APPLICABLE}: {reason}",)
        return MonitorRuling(*limits, "", reasons, Cause.NOT_APPLICABLE, self._in_use, None)
