"""What judges a flight, limits and monitor: put in force, sent and stored."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from app.assessment.monitors_in_use import MonitorRuling, MonitorsInUse
from app.assessment.rulings import (
    InForceFrom,
    LimitsInForce,
    LimitsRuling,
    RequestedLimits,
    Ruling,
    check_plausible,
)
from app.flights.display_monitors import ALIKE, DisplayMonitor
from app.flights.flight_monitors import member, set_status
from app.flights.sources.simulated import SourceError
from app.messages import ChannelLimit, LimitsFrom, LimitsStatus, MonitorSetStatus, limited_channels
from app.store.monitors import MonitorInfo
from app.store.store import Store
from core.channels import LATERAL
from core.conditions import ConditionKey
from core.flight_events import FlightLimits
from core.limits.limits import Envelope, Limits, Specification, specification_to_plain
from core.monitor import Monitor

MOST_NAMED = 3
"""Most suitable monitors to name."""
MOST_HELD = 200
"""Newest changes of the limits that a joining watcher receives."""
NO_SAMPLE = "no sample yet"


class InForce:
    """The limits and the monitor that judge a flight, and their changes.

    planned: the alarm authority at first.   monitors: a set, of which the one in use is the
    authority; None for the planned one throughout.
    ruling: current; None for the monitor's own limits.   since: time of the first sample under it
    [s]; None for all.   is_undated: until that sample comes.   authority: the alarm authority;
    where a set has none, the last one.   changes: in the order of the source's samples.
    of_record: as flown, each with the seq of its first sample.
    """

    def __init__(self, planned: DisplayMonitor, monitors: MonitorsInUse | None) -> None:
        self._own, self._monitors = planned.monitor, monitors
        self.authority = planned
        self.alert_above = planned.monitor.alert_above(planned.epsilon)
        self.ruling: Ruling | None = None
        self.since: float | None = None
        self.is_undated = False
        self.changes: deque[LimitsFrom] = deque(maxlen=MOST_HELD)
        self.of_record: deque[LimitsFrom] = deque(maxlen=MOST_HELD)

    @property
    def has_authority(self) -> bool:
        """False between the conditions of a monitor set, and before the first sample on it."""
        if self._monitors is None:
            return True
        return isinstance(self.ruling, MonitorRuling) and self.ruling.used is not None

    @property
    def status(self) -> LimitsStatus | None:
        """As sent; None unless a limit set is in force."""
        return status_of(self.ruling, self.since) if isinstance(self.ruling, LimitsRuling) else None

    @property
    def monitor_set(self) -> MonitorSetStatus | None:
        """The monitor set and the monitor in use, as sent; None without a set."""
        if self._monitors is None:
            return None
        ruling = self.ruling
        if not isinstance(ruling, MonitorRuling):
            return set_status(self._monitors, "", NO_SAMPLE)
        return set_status(self._monitors, ruling.case, ruling.reason, ruling.widest)

    @property
    def limits(self) -> Envelope | None:
        """None if unknown."""
        return self._own.envelope if self.ruling is None else self.ruling.limits

    @property
    def channels(self) -> list[ChannelLimit]:
        return limited_channels(self._own.dictionary, self._specification(self.ruling))

    def note(self, ruling: Ruling | None, since: float | None, *, is_undated: bool) -> None:
        """A change of the source: a ruling from since [s] on; None for all samples."""
        self._begin(self.changes)
        self.is_undated = is_undated
        self.changes.append(self._from(since, ruling))

    def use(self, ruling: Ruling | None, since: float | None, seq: int) -> LimitsFrom:
        """Judge by a ruling from the sample seq on; returns the change, as sent."""
        self._begin(self.of_record, 0)
        change = self._from(since, ruling)
        self.of_record.append(change.model_copy(update={"seq": seq}))
        self.ruling, self.since = ruling, since
        if isinstance(ruling, MonitorRuling) and ruling.used is not None:
            self.authority = shown = member(ruling.in_use, ruling.used)
            self.alert_above = shown.monitor.alert_above(shown.epsilon)
        return change

    def date(self, t: float) -> None:
        """The first sample under the newest limits, put in force by hand, is at t [s]."""
        self.is_undated, self.since = False, t
        for kept in (self.changes, self.of_record):
            kept[-1] = kept[-1].model_copy(update={"t": t})

    def restart(self, of_source: Sequence[InForceFrom]) -> None:
        """The source goes on elsewhere: its changes up to there; without any, the current one."""
        newest = [change.model_copy(update={"t": None}) for change in list(self.changes)[-1:]]
        self.changes = deque([self._from(*each) for each in of_source] or newest, MOST_HELD)

    def _begin(self, changes: deque[LimitsFrom], seq: int | None = None) -> None:
        """The first of all changes is from the monitor's own limits, if it has any."""
        own = self._plain(None)
        if not changes and own is not None:
            changes.append(LimitsFrom(t=None, limits=own, seq=seq))

    def _from(self, t: float | None, ruling: Ruling | None) -> LimitsFrom:
        monitor = ruling.monitor_id if isinstance(ruling, MonitorRuling) else ""
        return LimitsFrom(t=t, limits=self._plain(ruling), monitor=monitor)

    def _plain(self, ruling: Ruling | None) -> Any:
        """The limits of a ruling by channel; None if unknown."""
        plain = specification_to_plain(self._specification(ruling))
        return plain if isinstance(plain, dict) else None

    def _specification(self, ruling: Ruling | None) -> Specification:
        return self._own.specification if ruling is None else ruling.specification


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
    about["widest"] = {} if ruling.widest is None else ruling.widest.intervals(LATERAL.keys)
    return LimitsStatus(**about, **vars(to_store(ruling.in_force)))


def to_store(in_force: LimitsInForce) -> FlightLimits:
    about = {field.name: getattr(in_force, field.name) for field in fields(FlightLimits)}
    return FlightLimits(**about)
