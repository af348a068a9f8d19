"""Headline and verdict of ended flights, from their records."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from app.flights.display_monitors import stated_delay
from app.flights.verdict import (
    BEFORE,
    Circumstances,
    first_exceedance,
    is_jump,
    is_withdrawn,
    longest_manoeuvre,
    not_flown,
    verdict,
    verdict_of_recording,
)
from app.messages import Verdict
from app.store.flights import FlightInfo
from app.store.monitors import MonitorInfo
from app.store.store import NotFound, Store
from core.flight_events import Alarm
from core.limits.exceedance import ChannelExceedances, of_alarms
from core.monitor import State
from core.monitor.assessment import STATES, Cause
from core.monitor.status import Facts, Headline, Level, cause_of, headline

RUNNING = "running"
NO_SAMPLE = STATES.index(State.WARMING_UP), "no sample came"
"""State and reason of a flight that ended before its first sample."""


class Record(NamedTuple):
    """What the record of an ended flight shows; no verdict if it exceeded no limit.

    reason, cause: why its newest sample was not assessed.   open_alarms, open_cautions:
    unacknowledged warnings and cautions.
    """

    headline: Headline
    verdict: Verdict | None
    exceedances: list[ChannelExceedances]
    reason: str
    cause: Cause | None
    open_alarms: int
    open_cautions: int


def records(store: Store, flights: Iterable[FlightInfo]) -> dict[str, Record]:
    over = [info for info in flights if info.status != RUNNING]
    if not over:
        return {}
    alarms = store.alarms.of_flights(info.id for info in over)
    states = store.flights.last_states(info.id for info in over)
    monitors = {monitor.id: monitor for monitor in store.monitors.all()}
    sets = store.monitor_sets.of_flights(info.id for info in over)
    used = {info.id: [info.monitor_id] for info in over}
    used |= {key: [case.monitor for case in flown.info.cases] for key, flown in sets.items()}
    return {
        info.id: _record(
            store,
            info,
            monitors[info.monitor_id],
            alarms.get(info.id, ()),
            *states.get(info.id, NO_SAMPLE),
            all(monitors[monitor_id].support is not None for monitor_id in used[info.id]),
        )
        for info in over
    }


def _record(
    store: Store,
    info: FlightInfo,
    monitor: MonitorInfo,
    alarms: Sequence[Alarm],
    last: int,
    reason: str,
    is_checked: bool,
) -> Record:
    """last, reason: state code of the newest sample, and its reason.

    is_checked: whether the validity of all its monitors that raise alarms is calibrated.
    """
    exceeded = _exceeded(info, alarms)
    n_open = Counter(alarm.level for alarm in alarms if alarm.acknowledged is None)
    facts = Facts(
        alarm=n_open[Level.WARNING] > 0,
        caution=n_open[Level.CAUTION] > 0,
        invalid=STATES[last] is State.INVALID,
        warming_up=STATES[last] is State.WARMING_UP,
        calibrated=is_checked,
        exceeded_t=min(exceeded, default=None),
    )
    return Record(
        headline=headline(facts),
        verdict=_verdict(store, info, monitor, alarms) if exceeded else None,
        exceedances=_exceedances(info, alarms),
        reason=reason,
        cause=cause_of(STATES[last], reason),
        open_alarms=n_open[Level.WARNING],
        open_cautions=n_open[Level.CAUTION],
    )


def _exceedances(info: FlightInfo, alarms: Sequence[Alarm]) -> list[ChannelExceedances]:
    """As noted in flight; for a flight that was cut short, from its alarms."""
    if info.exceedances is not None:
        return [ChannelExceedances(**plain) for plain in info.exceedances]
    return of_alarms(
        (alarm.t, alarm.exceedance)
        for alarm in sorted(alarms, key=lambda alarm: alarm.t)
        if alarm.exceedance is not None
    )


def _verdict(
    store: Store, info: FlightInfo, monitor: MonitorInfo, alarms: Sequence[Alarm]
) -> Verdict | None:
    """The verdict of the scored recording; for other flights from their alarms."""
    promised = monitor.lead - stated_delay(store, info.source, monitor.dt)
    if (scored := _scored(store, info)) is not None:
        return verdict_of_recording(scored, alarms, _exceeded(info, alarms), monitor.dt, promised)
    first = first_exceedance(alarms)
    if first is not None:
        before = before_exceedance(store, info.id, first.seq, monitor.dt)
        live = info.source.get("kind") == "live"
        longest = longest_manoeuvre(monitor.dataset_recipe)
        return verdict(alarms, Circumstances(promised, *before, live, longest))
    if info.exceeded_t is not None and not any(alarm.kind == "limit" for alarm in alarms):
        return not_flown(info.exceeded_t)
    return verdict(alarms)


def _scored(store: Store, info: FlightInfo) -> list[dict[str, Any]] | None:
    """The scored manoeuvres of a replayed recording; None for other flights or if deleted."""
    recording, scoring = info.source.get("recording"), info.source.get("scoring")
    if not (isinstance(recording, str) and isinstance(scoring, str)):
        return None
    try:
        stored = store.scorings.info(recording, scoring)
    except NotFound:
        return None
    return None if stored.damage else stored.manoeuvres


def _exceeded(info: FlightInfo, alarms: Sequence[Alarm]) -> list[float]:
    exceeded = [alarm.t for alarm in alarms if alarm.kind == "limit"]
    return exceeded if info.exceeded_t is None else [*exceeded, info.exceeded_t]


def before_exceedance(store: Store, flight_id: str, seq: int, dt: float) -> tuple[bool, bool]:
    """Whether a seek led to this sample, and whether the monitor was not applicable to it."""
    stored = store.flights.assessments(flight_id, max(seq - BEFORE, 0), seq)
    withdrawn = (
        is_withdrawn(STATES[code], reason, cause_of(STATES[code], reason))
        for code, reason in zip(stored.state[-1:], stored.reasons[-1:], strict=True)
    )
    return is_jump(stored.t, dt), any(withdrawn)
