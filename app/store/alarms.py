"""Stored alarms: numbered in their flight, acknowledged once."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import func, insert, select, update

from app.store.flights import fetch_flight
from app.store.repository import Entry, Repository, columns, fetch
from app.store.tables import alarms, new_id, now
from core.monitor.status import Level

AlarmKind = Literal["risk", "limit"]


@dataclass(frozen=True)
class StoredAlarm(Entry):
    """A latched alert as it is stored."""

    id: str
    flight_id: str
    number: int
    """1, 2, ... in its flight"""
    seq: int
    """sample number"""
    t: float
    """time of the sample [s]"""
    p_value: float | None
    """risk; null where the state of the sample was not `ok`"""
    kind: AlarmKind
    """a predicted exceedance, `risk`, or a measured one, `limit`"""
    level: Level
    """14 CFR 25.1322"""
    exceedance: dict[str, Any] | None
    """of kind `limit`: channel, value, limit, and which value was judged"""
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
    ) -> str:
        """Store an alarm of a flight, raised now; return its id. NotFound."""
        alarm_id = new_id()
        last = select(func.max(alarms.c.number)).where(alarms.c.flight_id == flight_id)
        row = {
            "id": alarm_id,
            "flight_id": flight_id,
            "seq": seq,
            "t": t,
            "p_value": p_value,
            "kind": kind,
            "level": str(level),
            "exceedance": exceedance,
        }
        with self._writing() as connection:
            fetch_flight(connection, flight_id)
            number = (connection.execute(last).scalar() or 0) + 1
            connection.execute(insert(alarms).values(**row, number=number, raised=now()))
        return alarm_id

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
