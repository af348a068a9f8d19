"""Alarms: warnings and cautions, latched until someone acknowledges them.

Warnings: a risk above the alert level, and a measured exceedance, whether or not the monitor is
applicable. Cautions: the monitor is not applicable, a late source, and samples in doubt. Each kind
is raised once, at its onset. A risk ends at an assessed sample that does not alert; a sample
without an assessment ends nothing. An exceedance ends at a sample within the limits, a caution at a
sample without its cause. A restart (seek, step, loop) ends warnings; cautions continue if the next
sample still has their cause. The next onset raises a new alarm, unless
- the latest alarm of its kind is unacknowledged and ended less than REJOIN_S ago: a flicker is one
  alarm, or
- it is flown again after a restart: an onset of a source is one alarm, acknowledged once.
While a monitor stays withdrawn, channels that go missing are a separate onset. So is an
exceedance as recorded after one beyond any plausible value, and one from trim after either.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from math import inf
from operator import attrgetter
from typing import Any

from app.assessment.input_checks import DOUBT_KINDS, Doubt
from app.flights.clock import Clock
from app.flights.verdict import exceeds_from_trim
from core.flight_events import Alarm
from core.limits.exceedance import NOT_PLAUSIBLE, SAME_TIME, Exceeded, MeasuredExceedance
from core.monitor import Assessment, State
from core.monitor.assessment import Cause
from core.monitor.status import ALARM_LEVELS, AlarmKind, Level

REJOIN_S = 1.0
ALARMING = frozenset({State.INVALID, State.STALE})
"""States that may raise a caution; no other state is an alarm by itself."""
CLOSED_KEPT = 50
"""Acknowledged alarms that a flight keeps in memory; the store has all."""


def gives_alarm(kind: AlarmKind, assessment: Assessment) -> bool:
    """Whether an assessment raises an alarm of this kind.

    Between manoeuvres a monitor is not withdrawn: nothing is assessed there.
    """
    if kind == "risk":
        return bool(assessment.alert)
    return assessment.state is State.INVALID and assessment.cause is not Cause.BETWEEN


def certainty_of(exceedance: MeasuredExceedance) -> int:
    """2 from trim, 1 as recorded, 0 by a value beyond any plausible one."""
    if exceedance.judged != "recorded":
        return 2
    return 0 if exceedance.doubt == NOT_PLAUSIBLE else 1


class Onsets:
    """The onsets of one condition, and which of them raise an alarm.

    is_active: whether the condition holds at the newest sample.
    """

    def __init__(self) -> None:
        self.is_active = False
        self._last_t: float | None = None
        self._latest = ""
        self._open: set[str] = set()
        self._flown = bytearray()
        self._has_restarted = False

    def restart(self, *, ends: bool) -> None:
        self._has_restarted = True
        if ends:
            self.is_active, self._last_t = False, None

    def renew(self) -> None:
        """Take a sample of a condition that goes on for a separate onset."""
        self.is_active, self._latest = False, ""

    def forget(self) -> None:
        """Raise an alarm at the next onset also where the condition held before."""
        self._flown.clear()

    def begins(self, index: int, t: float, active: bool) -> bool:
        """Whether this sample is an onset that raises an alarm."""
        began = active and not self.is_active
        rings = began and not self._joins(index, t)
        self.is_active = active
        if active:
            self._last_t = t
            self._note_flown(index)
        return rings

    def fly_again(self, index: int) -> None:
        """The sample of an onset that has raised its alarm is flown again."""
        self._has_restarted = True
        self._note_flown(index)

    def _note_flown(self, index: int) -> None:
        if index >= 0:
            self._flown.extend(bytes(max(index + 1 - len(self._flown), 0)))
            self._flown[index] = True

    def latch(self, alarm_id: str, held_t: float | None = None) -> None:
        """held_t: of a restored alarm, when its condition held [s]."""
        self._latest = alarm_id
        self._open.add(alarm_id)
        self._last_t = self._last_t if held_t is None else held_t

    def release(self, alarm_id: str) -> None:
        self._open.discard(alarm_id)

    def _joins(self, index: int, t: float) -> bool:
        if self._has_restarted and 0 <= index < len(self._flown) and self._flown[index]:
            return True
        last = self._last_t if self._latest in self._open else None
        return last is not None and t - last < REJOIN_S


class Alarms:
    """The alarms of one flight. longest: [s] of a manoeuvre."""

    def __init__(self, longest: float = inf) -> None:
        self._longest = longest
        self._open: dict[str, Alarm] = {}
        self._closed: list[Alarm] = []
        self._number = 0
        self._n_open = dict.fromkeys(Level, 0)
        self._onsets: dict[AlarmKind, Onsets] = {kind: Onsets() for kind in ALARM_LEVELS}
        self._may_be_active = False
        self._missing: set[str] = set()
        self._certainty = 0
        self._evidence: dict[str, Alarm] = {}
        self._risks: list[Alarm] = []

    @property
    def evidence(self) -> list[Alarm]:
        """The alarms that decide whether the flight was warned, however many were acknowledged.

        The risks of the manoeuvre of the earliest exceedance from trim, that exceedance, what
        froze last before it, the earliest and the latest exceedance of all.
        """
        return [*self._risks, *self._evidence.values()]

    @property
    def at_hand(self) -> list[Alarm]:
        """All unacknowledged alarms and the last acknowledged ones, in the order raised."""
        return sorted([*self._closed, *self._open.values()], key=lambda alarm: alarm.number)

    def n_open(self, level: Level) -> int:
        return self._n_open[level]

    def note_stored(self, alarm_id: str) -> None:
        if alarm_id in self._open:
            self._open[alarm_id] = replace(self._open[alarm_id], stored=True)

    def restart(self) -> None:
        for kind, onsets in self._onsets.items():
            onsets.restart(ends=ALARM_LEVELS[kind] is Level.WARNING)

    def forget(self) -> None:
        """Let the onsets under other limits raise alarms wherever they are."""
        for onsets in self._onsets.values():
            onsets.forget()

    def restore(self, alarms: list[Alarm], active: Collection[AlarmKind], head: int) -> None:
        """Restore stored alarms. active: kinds whose alarm is of a condition that still holds.

        head: newest sample of the record; those after it are flown again.
        """
        for alarm in alarms:
            if alarm.seq > head and alarm.kind in ("risk", "invalid"):
                self._onsets[alarm.kind].fly_again(alarm.seq)
            self._number = max(self._number, alarm.number)
            self._keep_evidence(alarm)
            if alarm.acknowledged is None:
                self._keep_open(alarm)
                self._onsets[alarm.kind].latch(alarm.id, alarm.t if alarm.kind == "limit" else None)
            else:
                self._closed = [*self._closed, alarm][-CLOSED_KEPT:]
        for kind in active:
            self._onsets[kind].is_active = self._may_be_active = True
        if "invalid" in active:
            self._missing = {alarm.reason or "" for alarm in alarms if alarm.kind == "invalid"}

    def update(
        self,
        seq: int,
        index: int,
        assessment: Assessment,
        exceedance: Exceeded | None,
        clock: Clock,
        late: str = "",
        only: AlarmKind | None = None,
        beyond: str = "",
        arrived: float | None = None,
        manoeuvre: int = 0,
    ) -> list[Alarm]:
        """Return the alarms that a sample raises, an exceedance first.

        index: the sample's number in its source; a loop repeats it.   late: why the source is late;
        empty if it is not.   only: the one kind to check, for an onset that a seek passes.
        beyond: see Ruling.   arrived, manoeuvre: see Alarm.
        """
        t, state, reason = assessment.t, assessment.state, assessment.reason
        gives_cause = exceedance is not None or assessment.alert or late or state in ALARMING
        if not gives_cause and not self._may_be_active:
            return []
        if assessment.cause is Cause.MISSING and reason not in self._missing:
            self._onsets["invalid"].renew()
            self._missing.add(reason)
        if only is not None and ALARM_LEVELS[only] is Level.WARNING:
            self._onsets[only].is_active = False
        at, measured, received = (t, None, None) if exceedance is None else exceedance
        if measured is not None:
            self._renew_limit(measured)
            beyond = "; ".join(filter(None, (beyond, measured.doubt)))
        conditions: tuple[tuple[AlarmKind, float, bool, str | None], ...] = (
            ("limit", at, exceedance is not None, beyond or None),
            ("risk", t, gives_alarm("risk", assessment), None),
            ("invalid", t, gives_alarm("invalid", assessment), reason),
            ("stale", clock.now(), bool(late) or state is State.STALE, late or reason),
        )
        raised = [
            self._raise(
                kind,
                seq=seq,
                t=at if kind == "limit" else t,
                p_value=assessment.p_value,
                exceedance=measured if kind == "limit" else None,
                reason=why,
                raised=clock.utc(),
                manoeuvre=manoeuvre,
                arrived=arrived if kind != "limit" or received is None else received,
                cause=assessment.cause if kind == "invalid" else None,
            )
            for kind, when, is_active, why in conditions
            if only in (None, kind)
            and (is_active or self._onsets[kind].is_active)
            and (kind != "risk" or state is State.OK)
            and self._onsets[kind].begins(index, when, is_active)
        ]
        if not (self._onsets["invalid"].is_active or self._n_open[Level.CAUTION]):
            self._missing.clear()
        self._may_be_active = any(onsets.is_active for onsets in self._onsets.values())
        return raised

    def exceed(
        self,
        seq: int,
        index: int,
        exceeded: Exceeded,
        reason: str,
        clock: Clock,
        manoeuvre: int = 0,
    ) -> list[Alarm]:
        """A received sample exceeds a limit: return the alarm that this raises, if any.

        One that came after later samples and is the earliest beyond a limit raises its own alarm.
        seq, index: of the newest grid sample, see `update`.   reason: what is in doubt of it; empty
        for nothing.   manoeuvre: see Alarm.
        """
        t, exceedance, arrived = exceeded
        self._renew_limit(exceedance)
        first = self._evidence.get("limit" if exceedance.judged == "recorded" else "from trim")
        if first is not None and t < first.t - SAME_TIME:
            self._onsets["limit"].renew()
        about = {"t": t, "exceedance": exceedance, "reason": reason or None, "arrived": arrived}
        about["manoeuvre"] = manoeuvre
        return self._begin("limit", seq, t, clock, index, **about)

    def note_late(self, seq: int, index: int, t: float, reason: str, clock: Clock) -> list[Alarm]:
        """No sample followed seq, at t [s]: return the caution that this raises, if any."""
        return self._begin("stale", seq, clock.now(), clock, index, t=t, reason=reason)

    def note_doubts(
        self, seq: int, index: int, doubts: Sequence[Doubt], clock: Clock
    ) -> list[Alarm]:
        cautions = [doubt for doubt in doubts if doubt.level is Level.CAUTION]
        kinds = {doubt.kind for doubt in cautions}
        for kind in DOUBT_KINDS:
            self._onsets[kind].is_active &= kind in kinds
        raised = []
        for kind, _, t, reason, channels in cautions:
            if kind is None:
                continue
            about = {"t": t, "reason": reason, "channels": list(channels) or None}
            raised += self._begin(kind, seq, clock.now(), clock, index, **about)
        return raised

    def _begin(
        self, kind: AlarmKind, seq: int, when: float, clock: Clock, index: int, **about: Any
    ) -> list[Alarm]:
        """A condition holds after sample seq: return the alarm that this raises, if any.

        index: see `update`.
        """
        self._may_be_active = True
        if not self._onsets[kind].begins(index, when, True):
            return []
        return [self._raise(kind, seq=seq, p_value=None, raised=clock.utc(), **about)]

    def _renew_limit(self, exceedance: MeasuredExceedance) -> None:
        """Take an exceedance that is more certain than the latest alarm for a new onset."""
        if certainty_of(exceedance) > self._certainty:
            self._onsets["limit"].renew()

    def _raise(self, kind: AlarmKind, **about: Any) -> Alarm:
        self._number += 1
        alarm = Alarm(self._number, kind=kind, level=ALARM_LEVELS[kind], **about)
        self._keep_open(alarm)
        self._keep_evidence(alarm)
        self._onsets[kind].latch(alarm.id)
        return alarm

    def _keep_evidence(self, alarm: Alarm) -> None:
        evidence, t = self._evidence, attrgetter("t")
        if alarm.kind == "frozen" and alarm.t <= evidence.get("from trim", alarm).t:
            evidence["frozen"] = alarm
        if alarm.level is not Level.WARNING:
            return
        if alarm.exceedance is not None:
            self._certainty = certainty_of(alarm.exceedance)
        if alarm.kind == "risk":
            first = evidence.get("from trim")
            if first is None or alarm.t <= first.t:
                recent = [risk for risk in self._risks if alarm.t - risk.t <= self._longest]
                self._risks = [*recent, alarm]
            return
        for name in ("limit", "from trim") if exceeds_from_trim(alarm) else ("limit",):
            evidence[name] = min(evidence.get(name, alarm), alarm, key=t)
        evidence["latest"] = max(evidence.get("latest", alarm), alarm, key=t)

    def _keep_open(self, alarm: Alarm) -> None:
        self._open[alarm.id] = alarm
        self._n_open[alarm.level] += 1

    def acknowledge(self, alarm_id: str, by: str, utc: str) -> tuple[Alarm, bool]:
        """Acknowledge an alarm once. Returns it, and whether this was the first acknowledgement.

        KeyError for an alarm that is not in memory.
        """
        alarm = self._open.pop(alarm_id, None)
        if alarm is None:
            closed = {alarm.id: alarm for alarm in self._closed}
            return closed[alarm_id], False
        self._n_open[alarm.level] -= 1
        self._onsets[alarm.kind].release(alarm_id)
        alarm = replace(alarm, acknowledged=utc, by=by)
        self._closed = [*self._closed, alarm][-CLOSED_KEPT:]
        return alarm, True
