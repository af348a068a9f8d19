"""Stored alarms and markers of flights, numbered within their flight."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

from sqlalchemy import func, select, update

from app.store.repository import NotFound, Repository, columns, require
from app.store.tables import alarms, flight_markers, flights, new_id, now
from core.flight_events import Alarm, FlightMarker
from core.limits.exceedance import DOUBTS, MeasuredExceedance
from core.monitor.assessment import Cause, State
from core.monitor.status import Level, cause_of

_ALARMS = select(alarms.c.flight_id, *columns(alarms, Alarm)).order_by(alarms.c.number)


class AlarmRepository(Repository):
    """Alarms of flights, each acknowledged once."""

    def add(self, flight_id: str, alarm: Alarm) -> None:
        """Store an alarm of a flight; one already stored under this number is left unchanged."""
        others: dict[str, Any] = {"id": new_id(), "level": str(alarm.level)}
        others["exceedance"] = alarm.exceedance and asdict(alarm.exceedance)
        others["cause"] = alarm.cause and str(alarm.cause)
        self._add_numbered(alarms, flight_id, alarm, **others)

    def acknowledge(self, flight_id: str, number: int, by: str) -> Alarm:
        """Record who acknowledged an alarm; only the first acknowledgement counts."""
        numbered = (alarms.c.flight_id == flight_id) & (alarms.c.number == number)
        first = update(alarms).where(numbered, alarms.c.acknowledged.is_(None))
        with self._writing() as connection:
            require(connection, flights, flight_id)
            connection.execute(first.values(acknowledged=now(), by=by))
            row = connection.execute(_ALARMS.where(numbered)).one_or_none()
        if row is None:
            raise NotFound(f"flight {flight_id} has no alarm {number}")
        self.on_change()
        return _alarm(row._mapping)

    def of(self, flight_id: str) -> list[Alarm]:
        with self._reading() as connection:
            require(connection, flights, flight_id)
            rows = connection.execute(_ALARMS.where(alarms.c.flight_id == flight_id))
            return [_alarm(row._mapping) for row in rows]

    def open_levels(self, flight_ids: Iterable[str]) -> dict[str, Counter[Level]]:
        """Number of unacknowledged alarms by level; flights without any are absent."""
        unacknowledged = alarms.c.acknowledged.is_(None)
        query = select(alarms.c.flight_id, alarms.c.level, func.count().label("n"))
        query = query.where(unacknowledged).group_by(alarms.c.flight_id, alarms.c.level)
        return {
            key: Counter({Level(row["level"]): row["n"] for row in rows})
            for key, rows in self._by_flight(query, flight_ids).items()
        }


def _alarm(row: Mapping[Any, Any]) -> Alarm:
    """Earlier versions stored doubt and cause in words alone."""
    about = {**row, "level": Level(row["level"]), "stored": True}
    reason = row["reason"] or ""
    if row["exceedance"]:
        by_reason = next((doubt for doubt in DOUBTS if doubt in reason), "")
        about["exceedance"] = MeasuredExceedance(**{"doubt": by_reason} | row["exceedance"])
    if row["kind"] == "invalid":
        known = row["cause"] and Cause(row["cause"])
        about["cause"] = known or cause_of(State.INVALID, reason)
    del about["id"], about["flight_id"]
    return Alarm(**about)


class FlightMarkerRepository(Repository):
    """Markers of flights."""

    def add(self, flight_id: str, marker: FlightMarker) -> None:
        """Store a marker; one already stored under this number is left unchanged."""
        self._add_numbered(flight_markers, flight_id, marker, id=new_id())

    def of(self, flight_id: str) -> list[FlightMarker]:
        query = select(*columns(flight_markers, FlightMarker)).where(
            flight_markers.c.flight_id == flight_id
        )
        with self._reading() as connection:
            require(connection, flights, flight_id)
            rows = connection.execute(query.order_by(flight_markers.c.number))
            return [FlightMarker(**row._mapping, stored=True) for row in rows]
