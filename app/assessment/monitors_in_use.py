"""The monitor set of a flight: which of its monitors is in use at each flight condition.

Each monitor is used unchanged, at its own epsilon and limits. One that comes into use starts with
an empty history, so no p-value mixes the samples of two conditions. One that needs a manoeuvre from
its beginning is not applicable to the rest of it. Between the conditions of the set, and where the
condition is unknown, none is applicable.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from app.assessment.rulings import ConditionRule, Ruling
from core.conditions import ConditionKey
from core.monitor import Monitor
from core.monitor.assessment import Cause
from core.monitor.monitor_set import MonitorSet
from core.monitor.status import NOT_APPLICABLE


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


@dataclass(frozen=True, eq=False)
class MonitorRuling(Ruling):
    """Which monitor of a set is in use for a sample. used: number of its case; None for none."""

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
        """With the limits that all monitors of the set share; unknown where they differ."""
        first, *others = self._in_use.members
        shared = all(other.specification == first.specification for other in others)
        limits = (first.envelope, first.specification) if shared else (None, None)
        reasons = (f"{NOT_APPLICABLE}: {reason}",)
        return MonitorRuling(*limits, "", reasons, Cause.NOT_APPLICABLE, self._in_use, None)
