"""Stored markers of flights: what was called, when and by whom."""

from dataclasses import asdict, dataclass

from sqlalchemy import insert, select

from app.store.flights import fetch_flight
from app.store.repository import Entry, Repository, columns
from app.store.tables import flight_markers, new_id
from core.flight_markers import FlightMarkerKey


@dataclass(frozen=True)
class StoredFlightMarker(Entry):
    """A marker as it is stored."""

    number: int
    """1, 2, ... in its flight"""
    kind: FlightMarkerKey
    seq: int
    """newest sample number; -1 before the first"""
    t: float
    """time of that sample [s]"""
    created: str
    """UTC, ISO 8601"""
    by: str
    """who set it"""
    text: str | None
    """what was said"""


class FlightMarkerRepository(Repository):
    """Markers of flights."""

    def add(self, flight_id: str, marker: StoredFlightMarker) -> None:
        """Store a marker; of two of one number in its flight the first stays. NotFound."""
        own = flight_markers.c
        same = select(own.id).where(own.flight_id == flight_id, own.number == marker.number)
        with self._writing() as connection:
            fetch_flight(connection, flight_id)
            if connection.execute(same).first() is None:
                row = {"id": new_id(), "flight_id": flight_id} | asdict(marker)
                connection.execute(insert(flight_markers).values(**row))

    def of(self, flight_id: str) -> list[StoredFlightMarker]:
        """Markers of a flight in the order they were set. NotFound."""
        query = select(*columns(flight_markers, StoredFlightMarker)).where(
            flight_markers.c.flight_id == flight_id
        )
        with self._reading() as connection:
            fetch_flight(connection, flight_id)
            rows = connection.execute(query.order_by(flight_markers.c.number))
            return [StoredFlightMarker(**row._mapping) for row in rows]
