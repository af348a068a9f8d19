"""Alarms: alerts latched until someone acknowledges them.

An alert is raised as an alarm at its onset, the first sample above epsilon, once. It ends at an
assessed sample not above epsilon, or where the flight restarts (seek, loop); a sample that could
not be assessed ends nothing. The next onset is an alarm of its own, except while an alarm waits for
its acknowledgement and
- it is the last one and the alert had ended for less than REJOIN_S: a flicker is one alarm, or
- the sample is the very one that raised it: a loop does not ring again each time round.
An acknowledged alarm is over: every onset after it rings.
"""

from collections.abc import Callable

from app.messages import Alarm
from core.monitor import Assessment, State

REJOIN_S = 1.0
CLOSED_KEPT = 50
"""Acknowledged alarms that a flight keeps at hand; the store has all."""


class Alarms:
    """The alarms of one flight."""

    def __init__(self) -> None:
        self._open: dict[str, Alarm] = {}
        self._closed: list[Alarm] = []
        self._number = 0
        self._alert = False
        self._last_alert_t: float | None = None
        self._latest = ""
        self._onsets: dict[str, int] = {}

    @property
    def at_hand(self) -> list[Alarm]:
        """All open alarms and the last acknowledged ones, in the order raised."""
        return sorted([*self._closed, *self._open.values()], key=lambda alarm: alarm.number)

    @property
    def n_open(self) -> int:
        """Alarms that nobody acknowledged."""
        return len(self._open)

    def restart(self) -> None:
        """The next sample does not follow the last one."""
        self._alert, self._last_alert_t = False, None

    def update(
        self, seq: int, index: int, said: Assessment, utc: Callable[[], str]
    ) -> Alarm | None:
        """Take an assessed sample; return the alarm that it raises.

        index: the sample's number in its source, which a loop meets again.
        utc: gives the present date and time.
        """
        if said.state is not State.OK:
            return None
        began = bool(said.alert) and not self._alert
        self._alert = bool(said.alert)
        alarm = None
        if began and not self._joins(index, said.t):
            self._number += 1
            alarm = Alarm(
                id=str(self._number),
                number=self._number,
                seq=seq,
                t=said.t,
                p_value=said.p_value,
                raised=utc(),
            )
            self._open[alarm.id] = alarm
            self._latest = alarm.id
            self._onsets[alarm.id] = index
        if said.alert:
            self._last_alert_t = said.t
        return alarm

    def _joins(self, index: int, t: float) -> bool:
        last = self._last_alert_t if self._latest in self._open else None
        return index in self._onsets.values() or (last is not None and t - last < REJOIN_S)

    def acknowledge(self, alarm_id: str, by: str, utc: str) -> tuple[Alarm, bool]:
        """Acknowledge; the first one stays. Returns the alarm and whether this was the first.

        KeyError for an alarm that is not at hand.
        """
        alarm = self._open.pop(alarm_id, None)
        self._onsets.pop(alarm_id, None)
        if alarm is None:
            closed = {alarm.id: alarm for alarm in self._closed}
            return closed[alarm_id], False
        alarm = alarm.model_copy(update={"acknowledged": utc, "by": by})
        self._closed = [*self._closed, alarm][-CLOSED_KEPT:]
        return alarm, True
