"""Headline and verdict of ended flights, from their records."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from app.assessment.coverage import (
    OK,
    WARMING_UP,
    why_alert_unknown,
    why_exceedance_unknown,
    why_limits_unknown,
    why_unflown_unknown,
)
from app.assessment.outcome import holes_in, outcome
from app.assessment.planned_test import known_test
from app.assessment.segments import too_short
from app.flights.display_monitors import stated_delay
from app.flights.verdict import (
    Before,
    Circumstances,
    SampleCause,
    before_exceedance,
    first_exceedance,
    is_jump,
    longest_manoeuvre,
    n_before,
    no_verdict,
    not_flown,
    planned_length,
    verdict,
    verdict_of_recording,
)
from app.messages import Verdict
from app.store.assessments import UNKNOWN, StoredAssessments
from app.store.database import Damaged
from app.store.flights import FlightInfo, NewestState
from app.store.monitors import MonitorInfo
from app.store.store import NotFound, Store
from core.channels import Dictionary
from core.flight_events import Alarm
from core.limits.exceedance import ChannelExceedances, Exceedances, Exceeded, exceeded_at
from core.limits.limits import envelope_of, specification_from_plain
from core.monitor import State
from core.monitor.assessment import CAUSES, DATA_MISSING, RESTS, STATES, Cause
from core.monitor.status import Facts, Headline, Level, cause_of, headline
from core.types import Array, Indices

RUNNING = "running"
NO_SAMPLE: NewestState = STATES.index(State.WARMING_UP), "no sample came", None
"""Of a flight that ended before its first sample."""
MOST_BEFORE = 10_000
"""Samples before an exceedance that are read: more than those of a manoeuvre."""
INVALID, STALE = STATES.index(State.INVALID), STATES.index(State.STALE)
LIMITS_UNKNOWN = {
    CAUSES.index(Cause.LIMITS_UNKNOWN): "limits",
    CAUSES.index(Cause.TRIM_UNKNOWN): "limit from trim",
}
LOST, REST = ([CAUSES.index(cause) for cause in causes] for causes in (DATA_MISSING, RESTS))


class Summary(BaseModel):
    """What a list shows of an ended flight; stored when it ends.

    exceeded_t: first exceedance [s].   state, reason, cause: of its newest sample, the state by its
    code.   verdict: none if it surely exceeded none.   is_assessed: whether a sample was.
    is_assessed, cause: None in summaries of earlier versions.
    """

    exceeded_t: float | None
    state: int
    reason: str
    is_calibrated: bool
    verdict: Verdict | None
    exceedances: list[ChannelExceedances]
    is_assessed: bool | None = None
    cause: Cause | None = None


class Record(NamedTuple):
    """What the record of an ended flight shows; no verdict if it surely exceeded no limit.

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


def records(
    store: Store, flights: Iterable[FlightInfo], *, anew: bool = False
) -> dict[str, Record]:
    """Records of the ended flights among these, from their summaries where these are stored.

    anew: from their samples, which may have been damaged since.
    """
    over = [info for info in flights if info.status != RUNNING]
    n_open = store.alarms.open_levels(info.id for info in over)
    return {
        info.id: _record(_summary(store, info, anew), n_open.get(info.id, Counter()))
        for info in over
    }


def summarize(store: Store, flight_ids: Iterable[str]) -> None:
    """Store what lists show of ended flights. StoreError."""
    summaries = {}
    for flight_id in flight_ids:
        with suppress(NotFound):  # deleted meanwhile
            summary = summary_of(store, store.flights.info(flight_id))
            summaries[flight_id] = summary.model_dump(mode="json")
    store.flights.summarize(summaries)


def _summary(store: Store, info: FlightInfo, anew: bool) -> Summary:
    if not anew and info.summary is not None:
        summary = Summary.model_validate(info.summary)
        if summary.is_assessed is not None or STATES[summary.state] is not State.WARMING_UP:
            return summary
    return summary_of(store, info)


def summary_of(store: Store, info: FlightInfo) -> Summary:
    """From what is stored of the flight: its alarms and samples."""
    alarms, monitor = store.alarms.of(info.id), store.monitors.info(info.monitor_id)
    exceeded = _exceeded(info, alarms)
    flown = store.monitor_sets.of_flights([info.id]).get(info.id)
    used = [monitor]
    if flown is not None:
        used = [store.monitors.info(case.monitor) for case in flown.info.cases]
    state, reason, cause = store.flights.last_state(info.id) or NO_SAMPLE
    return Summary(
        exceeded_t=min(exceeded, default=None),
        state=state,
        reason=reason,
        is_calibrated=all(each.support is not None for each in used),
        verdict=_verdict(store, info, monitor, alarms)
        if exceeded
        else _doubt(store, info, used, alarms),
        exceedances=_exceedances(store, info, monitor, alarms),
        is_assessed=STATES[state] is State.OK or store.flights.is_assessed(info.id),
        cause=cause,
    )


def _record(summary: Summary, n_open: Counter[Level]) -> Record:
    state = STATES[summary.state]
    facts = Facts(
        alarm=n_open[Level.WARNING] > 0,
        caution=n_open[Level.CAUTION] > 0
        or (summary.verdict is not None and summary.verdict.exceeded_t is None),
        invalid=state is State.INVALID,
        no_data=(summary.state, summary.reason) == NO_SAMPLE[:2],
        unassessed=summary.is_assessed is False,
        calibrated=summary.is_calibrated,
        exceeded_t=summary.exceeded_t,
        ended=True,
    )
    return Record(
        headline=headline(facts),
        verdict=summary.verdict,
        exceedances=summary.exceedances,
        reason=summary.reason,
        cause=summary.cause or cause_of(state, summary.reason),
        open_alarms=n_open[Level.WARNING],
        open_cautions=n_open[Level.CAUTION],
    )


def _exceedances(
    store: Store, info: FlightInfo, monitor: MonitorInfo, alarms: Sequence[Alarm]
) -> list[ChannelExceedances]:
    """As noted in flight; for a flight that was cut short, from its samples and alarms.

    From its alarms alone if other limits than the monitor's were in force.
    """
    if info.exceedances is not None:
        return [ChannelExceedances(**plain) for plain in info.exceedances]
    dictionary = Dictionary.from_stored(monitor.dictionary)
    keys = dictionary.keys
    limits = envelope_of(specification_from_plain(monitor.specification, dictionary))
    rest = np.zeros(len(keys)) if limits is None else limits.rest
    is_received = info.source.get("kind") in ("live", "journal")
    near = (2.0 if is_received else 1.5) * monitor.dt
    log = Exceedances(dict(zip(keys, rest.tolist(), strict=True)), near)
    changed = store.limit_sets.of_flights([info.id]) or store.monitor_sets.of_flights([info.id])
    t, y = store.flights.samples(info.id)
    if len(t) and limits is not None and not changed:
        beyond = np.flatnonzero(limits.exceeds(y))
        for k in beyond[np.argsort(t[beyond])]:
            if exceeded := exceeded_at(float(t[k]), keys, limits, y[k], y[k]):
                log.add(exceeded, y[k], limits)
    for alarm in sorted(alarms, key=lambda alarm: alarm.t):
        if alarm.exceedance is not None:
            log.pass_by(Exceeded(alarm.t, alarm.exceedance))
    return log.of_channels


def _verdict(
    store: Store, info: FlightInfo, monitor: MonitorInfo, alarms: Sequence[Alarm]
) -> Verdict | None:
    """The verdict of the scored recording; for other flights from their alarms."""
    promised = monitor.lead - stated_delay(store, info, monitor.dt)
    if (scored := _scored(store, info)) is not None:
        return verdict_of_recording(scored, alarms, _exceeded(info, alarms), monitor.dt, promised)
    first = first_exceedance(alarms)
    if first is not None:
        before = stored_before(store, info.id, first, promised, monitor.dt)
        live = info.source.get("kind") == "live"
        longest = longest_manoeuvre(planned_length(monitor.dataset_recipe))
        controls = Dictionary.from_stored(monitor.dictionary).controls
        return verdict(alarms, Circumstances(promised, *before, live, longest, controls))
    if info.exceeded_t is not None and not any(alarm.kind == "limit" for alarm in alarms):
        return not_flown(info.exceeded_t)
    return verdict(alarms)


def _doubt(
    store: Store, info: FlightInfo, used: Sequence[MonitorInfo], alarms: Sequence[Alarm]
) -> Verdict | None:
    """The verdict on a flight without a measured exceedance; None if it surely had none."""
    kind, dt = info.source.get("kind"), used[0].dt
    if kind not in ("live", "journal"):
        return None
    t, y = store.flights.samples(info.id)
    if not len(t) or (kind == "journal" and is_jump(t, dt) and not _is_whole(store, info, t)):
        return None
    known = np.isfinite(y)
    limited, dictionary = _limited(info, used), Dictionary.from_stored(used[0].dictionary)
    for alarm in alarms:
        counts = limited.union(dictionary.controls)
        is_counted = not (alarm.channels and counts.isdisjoint(alarm.channels))
        if alarm.kind == "frozen" and is_counted:  # which ones, old alarms do not record
            return no_verdict("unseen", alarm.reason or "")

    def missing(start: float, end: float, since: float) -> str:
        inside = (t >= start) & (t <= end)
        holes = [
            hole
            for key, is_known in zip(dictionary.keys, known.T, strict=True)
            if key in limited
            for hole in holes_in(key, t[is_known & inside], start, end)
        ]
        return why_exceedance_unknown(holes, end - since, dt)

    with suppress(Damaged):  # then samples are missing
        if verdict := _of_manoeuvres(store, info, used[0], alarms, missing):
            return verdict
    why = missing(float(t[0]), float(t[-1]), float(t[0]))
    return no_verdict("unseen", why) if why else None


def _is_whole(store: Store, info: FlightInfo, t: Array) -> bool:
    """Whether a replay showed every sample of its flight once: its gaps are those of the flight.

    t: (n,) of the replay [s].
    """
    with suppress(NotFound):
        flown, _ = store.flights.samples(info.source["flight_id"])
        return np.array_equal(flown, t)
    return False


def _of_manoeuvres(
    store: Store,
    info: FlightInfo,
    monitor: MonitorInfo,
    alarms: Sequence[Alarm],
    missing: Callable[[float, float, float], str],
) -> Verdict | None:
    """The verdict on a live flight without all samples or limits, or that ends too early.

    missing: why an exceedance between two times [s] would not have been seen; empty if it would.
    The third one [s] is from where the share of the missing samples counts.
    """
    stored = store.flights.assessments(info.id)
    number = stored.manoeuvre if (stored.manoeuvre != UNKNOWN).all() else _by_causes(stored)
    withdrawn = (stored.state == INVALID) & ~np.isin(stored.cause, LOST)
    state = np.where(withdrawn | (stored.state == STALE), OK, stored.state)
    edges = [0, *(1 + np.flatnonzero(np.diff(number))).tolist(), len(number)]
    known = store.monitors.get(info.monitor_id)
    if not number.any():
        why = missing(float(stored.t[0]), float(stored.t[-1]), float(stored.t[0]))
        why = why or why_unflown_unknown(known, stored.t, stored.y)
        return no_verdict("unseen", why) if why else None
    planned, before = known_test(known), 0
    n_trim = round(planned.trim_segment_s / planned.dt)
    for first, stop in pairwise(edges):
        if not number[first]:
            continue
        begin, before = max(before, first - n_trim), stop
        why = missing(*(float(stored.t[k]) for k in (begin, stop - 1, first)))
        if not (why or stored.alert[first:stop].any()):
            why = why_alert_unknown(stored.t[first:stop], state[first:stop], monitor.dt)
        if why:
            return no_verdict("unseen", why)
        part = stored.t[first:stop], stored.cause[first:stop]
        for cause, what in LIMITS_UNKNOWN.items():
            if why := why_limits_unknown(part[0], part[1] == cause, what):
                return no_verdict("invalid", why)
        if stop < len(number):
            continue
        flown = float(stored.t[stop - 1] - stored.t[first])
        if not (number == 0).any():
            flown -= planned.trim_segment_s
        if why := too_short(flown, planned):
            alerts = tuple((a.t, a.t) for a in alarms if a.kind == "risk" and a.seq >= first)
            calls = [m.t for m in store.flight_markers.of(info.id) if m.level is not Level.NONE]
            return no_verdict(outcome(alerts, None, 0.0, is_cut=True, calls=calls)[0], why)
    return None


def _by_causes(stored: StoredAssessments) -> Indices:
    """(n,) numbers of the manoeuvres of a flight that an earlier version stored.

    A manoeuvre begins with the first sample between two rests that is assessed, or would be once
    the history is full; one without any counts if samples are lost at the end of the flight.
    """
    number = np.zeros(len(stored), np.int64)
    rests = np.isin(stored.cause, REST)
    begun = (stored.state == OK) | ((stored.state == WARMING_UP) & ~rests)
    for rest, stop in pairwise([-1, *np.flatnonzero(rests).tolist(), len(stored)]):
        part = slice(rest + 1, stop)
        is_end = stop == len(stored) and np.isin(stored.cause[part], LOST).any()
        if begun[part].any() or is_end:
            number[rest + 1 + int(begun[part].argmax()) : stop] = stop
    return number


def _limited(info: FlightInfo, used: Sequence[MonitorInfo]) -> set[str]:
    """Channels with a limit of a monitor or one put in force."""
    limits = [monitor.specification for monitor in used]
    limits += [held["limits"] for held in info.limits_held or ()]
    return {
        key
        for each in limits
        if isinstance(each, dict)
        for key, limit in each.items()
        if limit is not None
    }


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


def stored_before(store: Store, flight_id: str, first: Alarm, lead: float, dt: float) -> Before:
    """See before_exceedance. first: alarm of the exceedance."""
    since = max(first.seq - max(n_before(lead, dt), MOST_BEFORE), 0)
    stored = store.flights.assessments(flight_id, since, first.seq)
    about, samples = zip(stored.t.tolist(), stored.state, stored.cause, strict=True), []
    for t, state, cause in about:
        sample = SampleCause(t, STATES[state], CAUSES[cause])
        samples.append(sample.after(samples[-1] if samples else None))
    return before_exceedance(first.t, samples, lead, dt)
