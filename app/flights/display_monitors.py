"""Monitors that a flight displays beside its alarm authority.

Several monitors show more than one, for example several lead times. But a list of monitors has no
guarantee as a whole: each may miss and each may alert falsely. So only one raises alarms.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from app.assessment.grid import DELAY_INTERVALS
from app.flights.sources.simulated import SourceError
from app.messages import FlownMonitor, validity_word
from app.recipes.labels import kind_label
from app.store.flights import FlightInfo
from app.store.monitors import MonitorInfo
from app.store.store import Store
from core.evaluation.certificate import warnings_of
from core.limits.limits import specification_to_plain
from core.monitor import Monitor
from core.recipe import to_plain

ALIKE = {"aircraft": "another aircraft", "maneuver": "another manoeuvre"}
"""Parts of the dataset recipe in which all monitors of a flight agree."""


class LimitsUnknown(ValueError):
    """A monitor without known limits: exceedances could not be judged."""


class DisplayMonitor(NamedTuple):
    """A monitor for display, at its own accepted miss rate."""

    id: str
    name: str
    monitor: Monitor
    epsilon: float

    @property
    def warnings(self) -> list[str]:
        """Reasons not to rely on it."""
        is_calibrated = self.monitor.support is not None
        return warnings_of(self.monitor.evaluation, self.epsilon, is_calibrated=is_calibrated)


def check_has_limits(monitor_id: str, monitor: Monitor) -> None:
    if monitor.specification is None:
        raise LimitsUnknown(
            f"monitor {monitor_id} does not contain the limits it was trained for, so exceedances "
            "cannot be judged: choose another monitor, or train it again"
        )


def check_alike(authority: Monitor, display: Sequence[DisplayMonitor]) -> None:
    """SourceError for monitors that cannot assess the same flight; LimitsUnknown."""
    for shown in display:
        check_has_limits(shown.id, shown.monitor)
        if other := _unlike(authority, shown.monitor):
            raise SourceError(
                f"monitor {shown.name} ({shown.id}) has {other} than the alarm authority: choose "
                "monitors of the same aircraft, manoeuvre and sample interval"
            )


def _unlike(authority: Monitor, other: Monitor) -> str:
    if other.dictionary != authority.dictionary:
        return "other channels"
    if other.dt != authority.dt:
        return f"another sample interval, {other.dt:g} s and not {authority.dt:g} s,"
    recipes = authority.dataset_recipe, other.dataset_recipe
    unlike = (word for part, word in ALIKE.items() if len({repr(r.get(part)) for r in recipes}) > 1)
    return next(unlike, "")


def flown_monitor(
    monitor_id: str,
    name: str,
    monitor: Monitor | MonitorInfo,
    epsilon: float,
    warnings: list[str],
    *,
    delay: float = 0.0,
    is_authority: bool = False,
) -> FlownMonitor:
    """A monitor of a flight as sent to clients. delay: longest wait of a live sample [s]."""
    plain = (
        monitor.specification
        if isinstance(monitor, MonitorInfo)
        else specification_to_plain(monitor.specification)
    )
    return FlownMonitor(
        id=monitor_id,
        name=name,
        authority=is_authority,
        lead=monitor.lead - delay,
        epsilon=epsilon,
        alert_above=monitor.alert_above(epsilon),
        n_unsafe=monitor.n_unsafe,
        limits=plain if isinstance(plain, dict) else None,
        validity=validity_word(monitor.support is not None),
        warnings=warnings,
    )


def no_rest(monitor: Monitor) -> str:
    """Why a monitor never forecasts the rest of the test card; empty if it does."""
    if monitor.forecast is not None:
        return monitor.forecast.no_forecast_reason
    predictor = kind_label(to_plain(monitor.recipe.predictor)["kind"])
    return f"the predictor “{predictor}” makes none"


def flown_monitors(store: Store, flights: Sequence[FlightInfo]) -> dict[str, list[FlownMonitor]]:
    """The monitors of stored flights by flight id, the alarm authority first."""
    shown = store.flights.display(info.id for info in flights)
    used = {info.id: [(info.monitor_id, info.epsilon), *shown.get(info.id, ())] for info in flights}
    monitors = store.monitors.used(pair for pairs in used.values() for pair in pairs)
    sources = _live_sources(store, flights)
    delays = {
        info.id: delay_of(sources[info.id], monitors[info.monitor_id, info.epsilon].dt)
        for info in flights
    }
    return {
        flight_id: [
            flown_monitor(
                pair[0],
                monitors[pair].name,
                monitors[pair],
                pair[1],
                monitors[pair].warnings,
                delay=delays[flight_id],
                is_authority=position == 0,
            )
            for position, pair in enumerate(pairs)
        ]
        for flight_id, pairs in used.items()
    }


def stated_delay(store: Store, info: FlightInfo, dt: float) -> float:
    """Longest wait of the samples of a live flight, or of its replay [s]; 0 for other flights."""
    return delay_of(_live_sources(store, [info])[info.id], dt)


def delay_of(source: Mapping[str, Any], dt: float) -> float:
    if source.get("kind") not in ("live", "journal"):
        return 0.0
    delay = source.get("delay")
    return DELAY_INTERVALS * dt if delay is None else delay


def _live_sources(store: Store, flights: Sequence[FlightInfo]) -> dict[str, Mapping[str, Any]]:
    """Source of each flight by id; of the replay of a journal that of its flight, if stored."""
    replays = (info for info in flights if info.source.get("kind") == "journal")
    replayed = {info.id: info.source["flight_id"] for info in replays}
    stored = store.flights.sources(replayed.values())
    return {info.id: stored.get(replayed.get(info.id, ""), info.source) for info in flights}
