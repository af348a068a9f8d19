"""The monitor set of a flight: loaded from the store, and sent."""

from collections.abc import Mapping, Sequence

from app.assessment.monitors_in_use import MonitorsInUse
from app.flights.display_monitors import DisplayMonitor, check_has_limits
from app.messages import MonitorSetStatus, SetCondition
from app.recordings.scored import set_in_use
from app.store.condition_sets import MonitorSetInfo
from app.store.flights import FlightInfo
from app.store.store import Store
from core.conditions import ConditionKey
from core.limits.limits import Envelope


def monitors_in_use(
    store: Store, info: MonitorSetInfo, fixed: Mapping[ConditionKey, float]
) -> MonitorsInUse:
    """A stored set with its monitors; slow, for a thread. NotFound; LimitsUnknown."""
    in_use = set_in_use(store, info, fixed)
    for monitor_id, monitor in zip(in_use.ids, in_use.members, strict=True):
        check_has_limits(monitor_id, monitor)
    return in_use


def member(in_use: MonitorsInUse, case: int) -> DisplayMonitor:
    """The monitor of a case, at its own epsilon."""
    monitor = in_use.monitor(case)
    return DisplayMonitor(in_use.ids[case], in_use.names[case], monitor, monitor.check_epsilon())


def members(in_use: MonitorsInUse) -> list[DisplayMonitor]:
    return [member(in_use, case) for case in range(len(in_use.ids))]


def set_status(
    in_use: MonitorsInUse, case: str, reason: str, widest: Envelope | None = None
) -> MonitorSetStatus:
    """A set as sent. case: that holds now, empty for none; reason: why none does.

    widest: see MonitorSetStatus.
    """
    keys = in_use.members[0].dictionary.keys
    conditions = [
        SetCondition(
            name=each.name,
            ranges=dict(each.ranges),
            monitor=shown.id,
            monitor_name=shown.name,
            alert_above=shown.monitor.alert_above(shown.epsilon),
            warnings=shown.warnings,
        )
        for each, shown in zip(in_use.monitors.cases, members(in_use), strict=True)
    ]
    return MonitorSetStatus(
        id=in_use.id,
        name=in_use.name,
        fixed=dict(in_use.fixed),
        conditions=conditions,
        case=case,
        reason=reason,
        widest={} if widest is None else widest.intervals(keys),
    )


def stored_sets(store: Store, flights: Sequence[FlightInfo]) -> dict[str, MonitorSetStatus]:
    """The monitor sets of stored flights by flight id; flights without one are absent."""
    flown = store.monitor_sets.of_flights(info.id for info in flights)
    cases = [case for each in flown.values() for case in each.info.cases]
    monitors = store.monitors.used((case.monitor, None) for case in cases) if cases else {}
    return {
        flight_id: MonitorSetStatus(
            id=each.info.id,
            name=each.info.name,
            fixed=each.fixed,
            conditions=[
                SetCondition(
                    **vars(case),
                    alert_above=info.alert_above(info.epsilon),
                    warnings=info.warnings,
                )
                for case in each.info.cases
                for info in (monitors[case.monitor, None],)
            ],
        )
        for flight_id, each in flown.items()
    }
