"""The limits in force in a flight: put in force, sent and stored."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from app.assessment.limits_in_force import (
    LimitsInForce,
    LimitsRuling,
    RequestedLimits,
    check_plausible,
)
from app.flights.display_monitors import ALIKE
from app.flights.sources.simulated import SourceError
from app.messages import LimitsStatus
from app.store.monitors import MonitorInfo
from app.store.store import Store
from core.channels import LATERAL
from core.conditions import ConditionKey
from core.flight_events import FlightLimits
from core.limits.limits import Limits, specification_to_plain
from core.monitor import Monitor

MOST_NAMED = 3
"""Most suitable monitors to name."""


def change_of_limits(
    store: Store,
    monitor: Monitor,
    limit_set: str,
    version: int | None,
    fixed: Mapping[ConditionKey, float] | None,
) -> RequestedLimits:
    """A version of a limit set, the newest if None; for a thread.

    NotFound; SourceError for a monitor of other channels; TelemetryError for a limit that no value
    can exceed, as in a set of an earlier version.
    """
    if monitor.dictionary != LATERAL:
        raise SourceError(
            f"a limit set was given with a monitor of {', '.join(monitor.dictionary.keys)}: limit "
            f"sets know only {', '.join(LATERAL.keys)}, leave it out"
        )
    stored = store.limit_sets.version(limit_set, version)
    limits, monitors = stored.limits, store.monitors.all()
    check_plausible(limits)
    serving = tuple(_serving(monitor, case.limits, monitors) for case in limits.cases)
    return RequestedLimits(stored.limit_set, stored.name, stored.version, limits, serving, fixed)


def _serving(monitor: Monitor, limits: Limits, stored: list[MonitorInfo]) -> str:
    """Names of stored monitors of the same test with these limits, the nearest lead first."""
    plain = specification_to_plain(limits)
    alike = [
        info
        for info in stored
        if info.dt == monitor.dt
        and info.specification == plain
        and all(info.dataset_recipe.get(p) == monitor.dataset_recipe.get(p) for p in ALIKE)
    ]
    nearest = sorted(alike, key=lambda info: abs(info.lead - monitor.lead))[:MOST_NAMED]
    named = [f"{info.name} ({info.id})" for info in nearest]
    if not named:
        return "no stored monitor would serve"
    return f"monitor{'s' * (len(named) > 1)} {' or '.join(named)} would serve"


def status_of(ruling: LimitsRuling, since: float | None) -> LimitsStatus:
    """The limits in force as sent. since: time of their first sample [s]; None for all."""
    limits: Any = specification_to_plain(ruling.specification)
    about = {"case": ruling.case, "limits": limits, "reason": ruling.reason, "since": since}
    return LimitsStatus(**about, **vars(to_store(ruling.in_force)))


def to_store(in_force: LimitsInForce) -> FlightLimits:
    about = {field.name: getattr(in_force, field.name) for field in fields(FlightLimits)}
    return FlightLimits(**about)
