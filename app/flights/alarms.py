"""Alarms: warnings and cautions, latched until someone acknowledges them.

A risk above the alert level is a warning, and so is a measured exceedance, from the channels alone:
it asks nobody whether the monitor is applicable. That it is not, or that the source is late, is a
caution. Each kind is raised at its onset, once. A risk ends at an assessed sample that does not
alert; a sample that could not be assessed ends nothing. An exceedance ends at a sample within the
limits, a caution at a sample that gives no cause for it. Warnings end where the flight restarts
(seek, loop), cautions go on where the next sample finds them as they were. The next onset is an
alarm of its own, except while one of its kind waits for its acknowledgement and
- it is the last one and had ended for less than REJOIN_S: a flicker is one alarm, or
- the sample is the very one that raised it: a loop does not ring again each time round.
An acknowledged alarm is over: every onset after it rings.
"""

from collections import Counter
from typing import Any

from app.flights.clock import Clock
from app.flights.verdict import exceeds_from_trim
from app.messages import Alarm, MeasuredExceedance
from core.monitor import Assessment, State
from core.monitor.assessment import Cause
from core.monitor.status import ALARM_LEVELS, AlarmKind, Level

REJOIN_S = 1.0
ALARMING = frozenset({State.INVALID, State.STALE})
"""States that may be a caution; no other is an alarm by itself."""
CLOSED_KEPT = 50
"""Acknowledged alarms that a flight keeps at hand; the store has all."""


def gives_alarm(kind: AlarmKind, assessment: Assessment) -> bool:
    """Whether what is said of a sample is an alert, or withdraws the monitor where one is flown."""
    if kind == "risk":
        return bool(assessment.alert)
    return assessment.state is State.INVALID and assessment.cause is not Cause.BETWEEN


class Onsets:
    """Where one condition began: which of its onsets is an alarm of its own.

    is_active: whether it holds at the newest sample.
    """

    def __init__(self) -> None:
        self.is_active = False
        self._last_t: float | None = None
        self._latest = ""
        self._indices: dict[str, int] = {}

    def restart(self) -> None:
        """The next sample does not follow the last one."""
        self.is_active, self._last_t = False, None

    def begins(self, index: int, t: float, active: bool) -> bool:
        """Take a sample; whether it is an onset that rings."""
        began = active and not self.is_active
        rings = began and not self._joins(index, t)
        self.is_active = active
        if active:
            self._last_t = t
        return rings

    def latch(self, alarm_id: str, index: int) -> None:
        """Note the alarm that an onset raised."""
        self._latest, self._indices[alarm_id] = alarm_id, index

    def release(self, alarm_id: str) -> None:
        """The alarm was acknowledged."""
        self._indices.pop(alarm_id, None)

    def _joins(self, index: int, t: float) -> bool:
        last = self._last_t if self._latest in self._indices else None
        return index in self._indices.values() or (last is not None and t - last < REJOIN_S)


class Alarms:
    """The alarms of one flight."""

    def __init__(self) -> None:
        self._open: dict[str, Alarm] = {}
        self._closed: list[Alarm] = []
        self._number = 0
        self._n_open = Counter[Level]()
        self._onsets: dict[AlarmKind, Onsets] = {kind: Onsets() for kind in ALARM_LEVELS}
        self._may_be_active = False
        self._evidence: dict[str, Alarm] = {}

    @property
    def evidence(self) -> list[Alarm]:
        """The alarms that decide whether the flight was warned, however many were acknowledged.

        The earliest risk, the earliest exceedance from trim, the earliest and the latest of all.
        """
        return [*self._evidence.values()]

    @property
    def at_hand(self) -> list[Alarm]:
        """All open alarms and the last acknowledged ones, in the order raised."""
        return sorted([*self._closed, *self._open.values()], key=lambda alarm: alarm.number)

    def n_open(self, level: Level) -> int:
        """Alarms of a level that nobody acknowledged."""
        return self._n_open[level]

    def note_stored(self, alarm_id: str) -> None:
        """The store holds this alarm."""
        if alarm_id in self._open:
            stored = {"stored": True}
            self._open[alarm_id] = self._open[alarm_id].model_copy(update=stored)

    def restart(self) -> None:
        """The next sample does not follow the last one."""
        for kind, onsets in self._onsets.items():
            if ALARM_LEVELS[kind] is Level.WARNING:
                onsets.restart()

    def restore(self, alarms: list[Alarm]) -> None:
        """Take the alarms of a flight that goes on."""
        for alarm in alarms:
            self._number = max(self._number, alarm.number)
            self._keep_evidence(alarm)
            if alarm.acknowledged is None:
                self._keep_open(alarm)
                self._onsets[alarm.kind].latch(alarm.id, alarm.seq)
            else:
                self._closed = [*self._closed, alarm][-CLOSED_KEPT:]

    def update(
        self,
        seq: int,
        index: int,
        assessment: Assessment,
        exceedance: MeasuredExceedance | None,
        clock: Clock,
        late: str = "",
        only: AlarmKind | None = None,
    ) -> list[Alarm]:
        """Take a sample; return the alarms that it raises, an exceedance first.

        index: the sample's number in its source, which a loop meets again.   exceedance: of it.
        late: why the sample is not of now; empty where it is.   only: the kind that it is asked
        about, of a sample that a seek passes; None for all.
        """
        t, state, reason = assessment.t, assessment.state, assessment.reason
        gives_cause = exceedance is not None or assessment.alert or late or state in ALARMING
        if not gives_cause and not self._may_be_active:
            return []
        conditions: tuple[tuple[AlarmKind, float, bool, str | None], ...] = (
            ("limit", t, exceedance is not None, None),
            ("risk", t, gives_alarm("risk", assessment), None),
            ("invalid", t, gives_alarm("invalid", assessment), reason),
            ("stale", clock.now(), bool(late) or state is State.STALE, late or reason),
        )
        raised = [
            self._raise(
                kind,
                index,
                seq=seq,
                t=t,
                p_value=assessment.p_value,
                exceedance=exceedance if kind == "limit" else None,
                reason=why,
                cause=assessment.cause if kind == "invalid" else None,
                raised=clock.utc(),
            )
            for kind, when, is_active, why in conditions
            if only in (None, kind)
            and (is_active or self._onsets[kind].is_active)
            and (kind != "risk" or state is State.OK)
            and self._onsets[kind].begins(index, when, is_active)
        ]
        self._may_be_active = any(onsets.is_active for onsets in self._onsets.values())
        return raised

    def note_late(self, seq: int, t: float, reason: str, clock: Clock) -> list[Alarm]:
        """Nothing follows sample seq, of t [s]; return the alarm that this raises, if any."""
        self._may_be_active = True
        if not self._onsets["stale"].begins(seq, clock.now(), True):
            return []
        about = {"seq": seq, "t": t, "p_value": None, "reason": reason, "raised": clock.utc()}
        return [self._raise("stale", seq, **about)]

    def _raise(self, kind: AlarmKind, index: int, **about: Any) -> Alarm:
        self._number += 1
        number, level = self._number, ALARM_LEVELS[kind]
        alarm = Alarm(id=str(number), number=number, kind=kind, level=level, **about)
        self._keep_open(alarm)
        self._keep_evidence(alarm)
        self._onsets[kind].latch(alarm.id, index)
        return alarm

    def _keep_evidence(self, alarm: Alarm) -> None:
        if alarm.level is not Level.WARNING:
            return
        kept = self._evidence
        names = ["from trim"] if exceeds_from_trim(alarm) else []
        for name in (alarm.kind, *names):
            kept[name] = min(kept.get(name, alarm), alarm, key=lambda one: one.t)
        if alarm.kind == "limit":
            kept["latest"] = max(kept.get("latest", alarm), alarm, key=lambda one: one.t)

    def _keep_open(self, alarm: Alarm) -> None:
        self._open[alarm.id] = alarm
        self._n_open[alarm.level] += 1

    def acknowledge(self, alarm_id: str, by: str, utc: str) -> tuple[Alarm, bool]:
        """Acknowledge; the first one stays. Returns the alarm and whether this was the first.

        KeyError for an alarm that is not at hand.
        """
        alarm = self._open.pop(alarm_id, None)
        if alarm is None:
            closed = {alarm.id: alarm for alarm in self._closed}
            return closed[alarm_id], False
        self._n_open[alarm.level] -= 1
        self._onsets[alarm.kind].release(alarm_id)
        alarm = alarm.model_copy(update={"acknowledged": utc, "by": by})
        self._closed = [*self._closed, alarm][-CLOSED_KEPT:]
        return alarm, True
