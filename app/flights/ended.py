"""What can be said of flights that are over: their headline and their verdict, from the record."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from pydantic import BaseModel, Field

from app.flights.exceedance import of_alarms
from app.messages import ChannelExceedances, MeasuredExceedance
from app.scoring.outcome import (
    EXCEEDED,
    Outcome,
    RecordedExceedance,
    exceedance_verdict,
    outcome,
    verdict_of,
)
from app.store.alarms import StoredAlarm
from app.store.flights import FlightInfo
from app.store.monitors import MonitorInfo
from app.store.store import NotFound, Store
from core.monitor import State
from core.monitor.assessment import REASONS, STATES, Cause
from core.monitor.status import Facts, Headline, Level, cause_of, headline

RUNNING = "running"
NO_SAMPLE = STATES.index(State.WARMING_UP), "no sample came"
"""State and reason of a flight that ended before its first one."""
BEFORE, JUMP = 20, 5.0
"""Samples before an exceedance that must have been flown; steps that are no step of the flight."""
WORST: tuple[Outcome, ...] = ("missed", "late_alert", "unseen", "invalid", "timely_alert")
"""Outcomes of the exceedances of a recording, of which the first here is the flight's."""
NOT_FLOWN = f"{EXCEEDED}, what came before it was not flown"
OUTSIDE = f"{EXCEEDED} outside every manoeuvre, where nothing was assessed"


class Verdict(BaseModel):
    """What a flight that exceeded a limit came to; that of a replay is the recording's own."""

    exceeded_t: float = Field(description="[s] of the exceedance")
    lead: float | None = Field(
        description="[s] from the first alarm of a risk to it; null where there was none before"
    )
    text: str = Field(description="for people")


class Record(BaseModel):
    """Headline and verdict of a flight that is over; no verdict where no limit was exceeded."""

    headline: Headline
    verdict: Verdict | None
    exceedances: list[ChannelExceedances] = Field(
        description="that it came to, of each channel that had one"
    )
    reason: str = Field(description="why its newest sample was not assessed; empty where it was")
    cause: Cause | None = Field(description="of that reason, as of a frame")
    open_alarms: int = Field(description="warnings that wait for their acknowledgement")
    open_cautions: int = Field(description="cautions that wait for theirs")


def records(store: Store, flights: Iterable[FlightInfo]) -> dict[str, Record]:
    """The records of those flights that are over, by id."""
    over = [info for info in flights if info.status != RUNNING]
    if not over:
        return {}
    alarms = store.alarms.of_flights(info.id for info in over)
    states = store.flights.last_states(info.id for info in over)
    monitors = {monitor.id: monitor for monitor in store.monitors.all()}
    return {
        info.id: _record(
            store,
            info,
            monitors[info.monitor_id],
            alarms.get(info.id, ()),
            *states.get(info.id, NO_SAMPLE),
        )
        for info in over
    }


def _record(
    store: Store,
    info: FlightInfo,
    monitor: MonitorInfo,
    alarms: Sequence[StoredAlarm],
    last: int,
    reason: str,
) -> Record:
    """last, reason: code of the state of its newest sample, and why."""
    exceeded = _exceeded(info, alarms)
    warnings, cautions = (_n_waiting(alarms, level) for level in (Level.WARNING, Level.CAUTION))
    facts = Facts(
        alarm=warnings > 0,
        caution=cautions > 0,
        invalid=STATES[last] is State.INVALID,
        warming_up=STATES[last] is State.WARMING_UP,
        calibrated=monitor.support is not None,
        exceeded_t=min(exceeded, default=None),
    )
    found = _verdict(store, info, monitor, alarms) if exceeded else None
    return Record(
        headline=headline(facts),
        verdict=found,
        exceedances=_of_channels(info, alarms),
        reason=reason,
        cause=cause_of(STATES[last], reason),
        open_alarms=warnings,
        open_cautions=cautions,
    )


def _of_channels(info: FlightInfo, alarms: Sequence[StoredAlarm]) -> list[ChannelExceedances]:
    """As they were noted in flight; of a flight that was cut short, by its alarms."""
    if info.exceedances is not None:
        return [ChannelExceedances(**one) for one in info.exceedances]
    return of_alarms(
        (alarm.t, MeasuredExceedance(**alarm.exceedance))
        for alarm in sorted(alarms, key=lambda alarm: alarm.t)
        if alarm.exceedance is not None
    )


def verdict(
    alarms: Sequence[StoredAlarm],
    jumped: bool = False,
    promised: float = 0.0,
    withdrawn: bool = False,
    live: bool = False,
) -> Verdict | None:
    """Whether a limit was exceeded, and how long before it the first alarm of a risk was.

    promised: the monitor's warning lead time [s]; less is too late.
    jumped: what came before the first exceedance was not flown, so nobody could have been warned
    by what was raised together with it.
    withdrawn: by then the monitor was not applicable, and without an alarm it has not missed it.
    live: nobody was warned before an alarm was raised, however old its sample was by then.
    """
    first, raw = first_exceedance(alarms), _first(alarms)
    if first is None:
        text = exceedance_verdict("quiet", None, exceeded=False, recorded=True)
        return None if raw is None else Verdict(exceeded_t=raw.t, lead=None, text=text)
    warned = sorted(
        _warned(a, first, live)
        for a in alarms
        if a.kind == "risk" and a.t <= first.t and not (jumped and a.seq >= first.seq)
    )
    ahead = tuple((t, t) for t in warned)
    if jumped and not ahead:
        return Verdict(exceeded_t=first.t, lead=None, text=NOT_FLOWN)
    came, lead = outcome(ahead, RecordedExceedance(first.t, "", 0.0), promised)
    came = "invalid" if withdrawn and not ahead else came
    return Verdict(exceeded_t=first.t, lead=lead, text=exceedance_verdict(came, lead))


def _warned(risk: StoredAlarm, exceedance: StoredAlarm, live: bool) -> float:
    """Flight time at which an alarm warned of an exceedance [s]."""
    if not live:
        return risk.t
    raised = datetime.fromisoformat(exceedance.raised) - datetime.fromisoformat(risk.raised)
    return max(risk.t, exceedance.t - max(0.0, raised.total_seconds()))


def first_exceedance(alarms: Sequence[StoredAlarm]) -> StoredAlarm | None:
    """The alarm of the earliest exceedance from trim."""
    return _first(filter(_exceeds_from_trim, alarms))


def _first(alarms: Iterable[StoredAlarm]) -> StoredAlarm | None:
    measured = (alarm for alarm in alarms if alarm.kind == "limit")
    return min(measured, key=lambda alarm: alarm.t, default=None)


def _verdict(
    store: Store, info: FlightInfo, monitor: MonitorInfo, alarms: Sequence[StoredAlarm]
) -> Verdict | None:
    """That of its recording as it was scored, else by what was flown."""
    if (scored := _scored(store, info)) is not None:
        return _of_recording(scored, info, monitor.dt, alarms)
    first = first_exceedance(alarms)
    if first is not None:
        jumped, withdrawn = _before(store, info, first.seq, monitor.dt)
        live = info.source.get("kind") == "live"
        return verdict(alarms, jumped, monitor.lead, withdrawn, live)
    if info.exceeded_t is not None and _first(alarms) is None:
        return Verdict(exceeded_t=info.exceeded_t, lead=None, text=NOT_FLOWN)
    return verdict(alarms)


def _scored(store: Store, info: FlightInfo) -> list[dict[str, Any]] | None:
    """The manoeuvres of the recording that it replayed; None where it did not, or they are gone."""
    recording, scoring = info.source.get("recording"), info.source.get("scoring")
    if not (isinstance(recording, str) and isinstance(scoring, str)):
        return None
    try:
        stored = store.scorings.info(recording, scoring)
    except NotFound:
        return None
    return None if stored.damage else stored.manoeuvres


def _of_recording(
    manoeuvres: Sequence[Mapping[str, Any]],
    info: FlightInfo,
    dt: float,
    alarms: Sequence[StoredAlarm],
) -> Verdict:
    """The worst verdict of the exceedances that a replay has come to."""
    known = _exceeded(info, alarms)
    reached = max(known)
    by_trim = [m for m in manoeuvres if m["exceedance"] and m["exceedance"]["t"] <= reached + dt]
    if by_trim:
        worst = min(by_trim, key=lambda m: (_rank(m["outcome"]), m["exceedance"]["t"]))
        t = worst["exceedance"]["t"]
        return Verdict(exceeded_t=t, lead=worst["lead"], text=verdict_of(worst))
    if (first := first_exceedance(alarms)) is not None:
        return Verdict(exceeded_t=first.t, lead=None, text=OUTSIDE)
    text = exceedance_verdict("quiet", None, exceeded=False, recorded=True)
    return Verdict(exceeded_t=min(known), lead=None, text=text)


def _exceeded(info: FlightInfo, alarms: Sequence[StoredAlarm]) -> list[float]:
    """Times of the exceedances that a flight has come to [s]."""
    exceeded = [alarm.t for alarm in alarms if alarm.kind == "limit"]
    return exceeded if info.exceeded_t is None else [*exceeded, info.exceeded_t]


def _rank(word: Outcome) -> int:
    return WORST.index(word) if word in WORST else len(WORST)


def _before(store: Store, info: FlightInfo, seq: int, dt: float) -> tuple[bool, bool]:
    """Whether a seek came just before this sample, and whether its monitor was withdrawn by it."""
    stored = store.flights.assessments(info.id, max(seq - BEFORE, 0), seq)
    steps = np.diff(stored.t)
    jumped = bool(((steps <= 0.0) | (steps > JUMP * dt)).any())
    withdrawn = [
        STATES[code] is State.INVALID
        and why not in REASONS
        and cause_of(STATES[code], why) is not Cause.BETWEEN
        for code, why in zip(stored.state[-1:], stored.reasons[-1:], strict=True)
    ]
    return jumped, any(withdrawn)


def _n_waiting(alarms: Sequence[StoredAlarm], level: Level) -> int:
    return sum(alarm.acknowledged is None and alarm.level == level for alarm in alarms)


def _exceeds_from_trim(alarm: StoredAlarm) -> bool:
    return alarm.exceedance is not None and alarm.exceedance["judged"] != "recorded"
