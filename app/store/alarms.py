"""Stored alarms and markers of flights, numbered within their flight."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import Connection, bindparam, func, insert, select, update

from app.store.flights import head_of
from app.store.repository import Entry, NotFound, Repository, Time, columns, fetch, require
from app.store.tables import alarms, flight_markers, flights, new_id, now
from core.flight_markers import FlightMarkerKey
from core.monitor.status import AlarmKind, Level

_BY_NUMBER = (alarms.c.flight_id == bindparam("flight")) & (alarms.c.number == bindparam("number"))
_NUMBERED, _INSERT = select(alarms.c.id).where(_BY_NUMBER), insert(alarms)
"""Built once, because flights in progress wait for these statements."""


@dataclass(frozen=True)
class StoredAlarm(Entry):
    """A latched alert."""

    id: str
    flight_id: str
    number: int
    """1, 2, ... in its flight"""
    seq: int
    """sample number; -1 before the first"""
    t: float
    """time of the sample [s]"""
    p_value: float | None
    """risk; null if the state of the sample was not `ok`"""
    kind: AlarmKind
    """`risk` for a predicted exceedance, `limit` for a measured one, else the kind of caution"""
    level: Level
    """14 CFR 25.1322"""
    exceedance: dict[str, Any] | None
    """for kind `limit`: channel, value, limit, and which value was judged"""
    reason: str | None
    """reason for a caution"""
    raised: Time
    acknowledged: Time | None
    by: str | None
    """who acknowledged it"""


class AlarmRepository(Repository):
    """Alarms of flights, each acknowledged once."""

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
        """Store an alarm of a flight and return its id.

        number: within the flight, next free if None; an alarm already stored is left unchanged.
        raised: UTC in ISO 8601, now if None.
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
            number = _next_number(connection, flight_id) if number is None else number
            existing = connection.execute(_NUMBERED, {"flight": flight_id, "number": number})
            if (stored := existing.scalar_one_or_none()) is not None:
                return stored
            row |= {"number": number, "raised": raised or now()}
            connection.execute(_INSERT, row)
        return alarm_id

    def acknowledge_number(self, flight_id: str, number: int, by: str) -> StoredAlarm:
        with self._reading() as connection:
            require(connection, flights, flight_id)
            numbered = connection.execute(_NUMBERED, {"flight": flight_id, "number": number})
            alarm_id = numbered.scalar_one_or_none()
        if alarm_id is None:
            raise NotFound(f"flight {flight_id} has no alarm {number}")
        return self.acknowledge(alarm_id, by)

    def acknowledge(self, alarm_id: str, by: str) -> StoredAlarm:
        """Record who acknowledged an alarm; only the first acknowledgement counts."""
        unacknowledged = (alarms.c.id == alarm_id) & alarms.c.acknowledged.is_(None)
        query = select(*columns(alarms, StoredAlarm)).where(alarms.c.id == alarm_id)
        with self._writing() as connection:
            connection.execute(
                update(alarms).where(unacknowledged).values(acknowledged=now(), by=by)
            )
            return StoredAlarm(**fetch(connection, query, "alarm", alarm_id)._mapping)

    def of(self, flight_id: str) -> list[StoredAlarm]:
        """Alarms of a flight in the order they were raised."""
        query = select(*columns(alarms, StoredAlarm)).where(alarms.c.flight_id == flight_id)
        with self._reading() as connection:
            require(connection, flights, flight_id)
            rows = connection.execute(query.order_by(alarms.c.number))
            return [StoredAlarm(**row._mapping) for row in rows]

    def of_flights(self, flight_ids: Iterable[str]) -> dict[str, list[StoredAlarm]]:
        """Alarms by flight, in the order they were raised; flights without any are absent."""
        query = select(*columns(alarms, StoredAlarm)).order_by(alarms.c.number)
        by_flight = self._by_flight(query, flight_ids)
        return {key: [StoredAlarm(**row) for row in rows] for key, rows in by_flight.items()}


def _next_number(connection: Connection, flight_id: str) -> int:
    last = select(func.max(alarms.c.number)).where(alarms.c.flight_id == flight_id)
    return (connection.execute(last).scalar() or 0) + 1


@dataclass(frozen=True)
class StoredFlightMarker(Entry):
    """A marker set during a flight."""

    number: int
    """1, 2, ... in its flight"""
    kind: FlightMarkerKey
    seq: int
    """newest sample number when it was set; -1 before the first sample"""
    t: float
    """time of that sample [s]"""
    created: Time
    by: str
    """who set it"""
    text: str | None
    """remark"""


class FlightMarkerRepository(Repository):
    """Markers of flights."""

    def add(self, flight_id: str, marker: StoredFlightMarker) -> None:
        """Store a marker; one already stored under this number is left unchanged."""
        self._add_numbered(flight_markers, flight_id, {"id": new_id()} | asdict(marker))

    def of(self, flight_id: str) -> list[StoredFlightMarker]:
        """Markers of a flight in the order they were set."""
        query = select(*columns(flight_markers, StoredFlightMarker)).where(
            flight_markers.c.flight_id == flight_id
        )
        with self._reading() as connection:
            require(connection, flights, flight_id)
            rows = connection.execute(query.order_by(flight_markers.c.number))
            return [StoredFlightMarker(**row._mapping) for row in rows]
