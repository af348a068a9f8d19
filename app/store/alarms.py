"""Stored alarms: numbered in their flight, acknowledged once."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, bindparam, func, insert, select, update

from app.store.flights import fetch_flight, head_of
from app.store.repository import Entry, NotFound, Repository, columns, fetch
from app.store.tables import alarms, new_id, now
from core.monitor.status import AlarmKind, Level

_OWN = (alarms.c.flight_id == bindparam("flight")) & (alarms.c.number == bindparam("own"))
_NUMBERED, _INSERT = select(alarms.c.id).where(_OWN), insert(alarms)
"""Made once: flights under way wait for them."""


@dataclass(frozen=True)
class StoredAlarm(Entry):
    """A latched alert as it is stored."""

    id: str
    flight_id: str
    number: int
    """1, 2, ... in its flight"""
    seq: int
    """sample number; -1 before the first"""
    t: float
    """time of the sample [s]"""
    p_value: float | None
    """risk; null where the state of the sample was not `ok`"""
    kind: AlarmKind
    """a predicted exceedance, `risk`, or a measured one, `limit`; else what it cautions of"""
    level: Level
    """14 CFR 25.1322"""
    exceedance: dict[str, Any] | None
    """of kind `limit`: channel, value, limit, and which value was judged"""
    reason: str | None
    """of a caution: why"""
    raised: str
    """UTC, ISO 8601"""
    acknowledged: str | None
    """UTC, ISO 8601"""
    by: str | None
    """who acknowledged it"""


class AlarmRepository(Repository):
    """Alarms of flights."""

    def add(
        self,
        flight_id: str,
        seq: int,
        t: float,
        p_value: float | None,
        kind: AlarmKind = "risk",
        level: Level = Level.WARNING,
        exceedance: dict[str, Any] | None = None,
        reason: str | None = None,
        number: int | None = None,
        raised: str | None = None,
    ) -> str:
        """Store an alarm of a flight; return its id. NotFound.

        number: in its flight, the next one if absent; one that is stored already stays as it is.
        raised: UTC in ISO 8601, now if absent.
        """
        alarm_id = new_id()
        row: dict[str, Any] = {
            "id": alarm_id,
            "flight_id": flight_id,
            "seq": seq,
            "t": t,
            "p_value": p_value,
            "kind": kind,
            "level": str(level),
            "exceedance": exceedance,
            "reason": reason,
        }
        with self._writing() as connection:
            head_of(connection, flight_id)
            own = _next_number(connection, flight_id) if number is None else number
            same = connection.execute(_NUMBERED, {"flight": flight_id, "own": own})
            if (stored := same.scalar_one_or_none()) is not None:
                return stored
            row |= {"number": own, "raised": raised or now()}
            connection.execute(_INSERT, row)
        return alarm_id

    def acknowledge_number(self, flight_id: str, number: int, by: str) -> StoredAlarm:
        """Note who has seen the alarm of this number in its flight; the first stays. NotFound."""
        with self._reading() as connection:
            fetch_flight(connection, flight_id)
            numbered = connection.execute(_NUMBERED, {"flight": flight_id, "own": number})
            alarm_id = numbered.scalar_one_or_none()
        if alarm_id is None:
            raise NotFound(f"flight {flight_id} has no alarm {number}")
        return self.acknowledge(alarm_id, by)

    def acknowledge(self, alarm_id: str, by: str) -> StoredAlarm:
        """Note who has seen an alarm; the first one stays. NotFound."""
        waiting = (alarms.c.id == alarm_id) & alarms.c.acknowledged.is_(None)
        query = select(*columns(alarms, StoredAlarm)).where(alarms.c.id == alarm_id)
        with self._writing() as connection:
            connection.execute(update(alarms).where(waiting).values(acknowledged=now(), by=by))
            return StoredAlarm(**fetch(connection, query, "alarm", alarm_id)._mapping)

    def of(self, flight_id: str) -> list[StoredAlarm]:
        """Alarms of a flight in the order they were raised. NotFound."""
        query = select(*columns(alarms, StoredAlarm)).where(alarms.c.flight_id == flight_id)
        with self._reading() as connection:
            fetch_flight(connection, flight_id)
            rows = connection.execute(query.order_by(alarms.c.number))
            return [StoredAlarm(**row._mapping) for row in rows]

    def of_flights(self, flight_ids: Iterable[str]) -> dict[str, list[StoredAlarm]]:
        """Alarms of several flights in the order they were raised; none of a flight without."""
        wanted, found = set(flight_ids), defaultdict[str, list[StoredAlarm]](list)
        query = select(*columns(alarms, StoredAlarm)).order_by(alarms.c.flight_id, alarms.c.number)
        with self._reading() as connection:
            for row in connection.execute(query):
                if row.flight_id in wanted:
                    found[row.flight_id].append(StoredAlarm(**row._mapping))
        return dict(found)


def _next_number(connection: Connection, flight_id: str) -> int:
    last = select(func.max(alarms.c.number)).where(alarms.c.flight_id == flight_id)
    return (connection.execute(last).scalar() or 0) + 1
