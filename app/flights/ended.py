"""What can be said of flights that are over: their headline and their verdict, from the record."""

from collections.abc import Iterable, Sequence

import numpy as np
from pydantic import BaseModel, Field

from app.store.alarms import StoredAlarm
from app.store.flights import FlightInfo
from app.store.monitors import MonitorInfo
from app.store.store import Store
from core.monitor import State
from core.monitor.assessment import STATES
from core.monitor.status import Facts, Headline, Level, headline

RUNNING = "running"
BEFORE, JUMP = 20, 5.0
"""Samples before an exceedance that must have been flown; steps that are no step of the flight."""
SAME_TIME = 1e-6
"""Times this close are the same [s]."""


class Verdict(BaseModel):
    """What a flight that exceeded its limit came to, judged from trim, as its monitor judges."""

    exceeded_t: float = Field(description="[s] of the first exceedance")
    lead: float | None = Field(
        description="[s] from the first alarm of a risk to it; null where there was none before"
    )
    text: str = Field(description="for people")


class Record(BaseModel):
    """Headline and verdict of a flight that is over; no verdict where no limit was exceeded."""

    headline: Headline
    verdict: Verdict | None


def records(store: Store, flights: Iterable[FlightInfo]) -> dict[str, Record]:
    """The records of those flights that are over, by id."""
    over = [info for info in flights if info.status != RUNNING]
    if not over:
        return {}
    alarms = store.alarms.of_flights(info.id for info in over)
    states = store.flights.last_states(info.id for info in over)
    monitors = {monitor.id: monitor for monitor in store.monitors.all()}
    return {
        info.id: Record(
            headline=headline(
                Facts(
                    alarm=_waits(alarms.get(info.id, ()), Level.WARNING),
                    caution=_waits(alarms.get(info.id, ()), Level.CAUTION),
                    invalid=STATES[states.get(info.id, 0)] is State.INVALID,
                    calibrated=monitors[info.monitor_id].support is not None,
                    has_exceeded=any(one.kind == "limit" for one in alarms.get(info.id, ())),
                )
            ),
            verdict=_verdict(store, info, monitors[info.monitor_id], alarms.get(info.id, ())),
        )
        for info in over
    }


def verdict(
    alarms: Sequence[StoredAlarm], jumped: bool = False, promised: float = 0.0
) -> Verdict | None:
    """Whether a limit was exceeded, and how long before it the first alarm of a risk was.

    promised: the monitor's warning lead time [s]; less is too late.
    jumped: what came before the first exceedance was not flown, so nobody could have been warned.
    """
    first = first_exceedance(alarms)
    if first is None:
        return None
    ahead = [alarm.t for alarm in alarms if alarm.kind == "risk" and alarm.t <= first.t]
    lead = first.t - min(ahead) if ahead else None
    none = "what came before it was not flown" if jumped else "no warning"
    late = ": too late" if lead is not None and lead < promised - SAME_TIME else ""
    warned = none if lead is None else f"warned {lead:.2f} s before{late}"
    return Verdict(exceeded_t=first.t, lead=lead, text=f"LIMIT EXCEEDED, {warned}")


def first_exceedance(alarms: Sequence[StoredAlarm]) -> StoredAlarm | None:
    """The alarm of the earliest exceedance from trim."""
    return min(filter(_exceeds_from_trim, alarms), key=lambda alarm: alarm.t, default=None)


def _verdict(
    store: Store, info: FlightInfo, monitor: MonitorInfo, alarms: Sequence[StoredAlarm]
) -> Verdict | None:
    first = first_exceedance(alarms)
    if first is None:
        return None
    return verdict(alarms, _jumped(store, info, first.seq, monitor.dt), monitor.lead)


def _jumped(store: Store, info: FlightInfo, seq: int, dt: float) -> bool:
    """Whether the samples just before this one were not flown: a seek came between."""
    steps = np.diff(store.flights.assessments(info.id, max(seq - BEFORE, 0), seq).t)
    return bool(((steps <= 0.0) | (steps > JUMP * dt)).any())


def _waits(alarms: Sequence[StoredAlarm], level: Level) -> bool:
    return any(alarm.acknowledged is None and alarm.level == level for alarm in alarms)


def _exceeds_from_trim(alarm: StoredAlarm) -> bool:
    return alarm.exceedance is not None and alarm.exceedance["judged"] != "recorded"
