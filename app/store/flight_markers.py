"""Stored flight markers: what was called, when and by whom."""

from dataclasses import asdict, dataclass

from sqlalchemy import insert, select

from app.store.flights import fetch_flight
from app.store.repository import Entry, Repository, columns
from app.store.tables import flight_markers, new_id
from core.flight_markers import FlightMarkerKey


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
    created: str
    """UTC, ISO 8601"""
    by: str
    """who set it"""
    text: str | None
    """remark"""


class FlightMarkerRepository(Repository):
    """Markers of flights."""

    def add(self, flight_id: str, marker: StoredFlightMarker) -> None:
        """Store a marker; one already stored under this number is left unchanged."""
        marked = flight_markers.c
        existing = select(marked.id).where(
            marked.flight_id == flight_id, marked.number == marker.number
        )
        with self._writing() as connection:
            fetch_flight(connection, flight_id)
            if connection.execute(existing).first() is None:
                row = {"id": new_id(), "flight_id": flight_id} | asdict(marker)
                connection.execute(insert(flight_markers).values(**row))

    def of(self, flight_id: str) -> list[StoredFlightMarker]:
        """Markers of a flight in the order they were set."""
        query = select(*columns(flight_markers, StoredFlightMarker)).where(
            flight_markers.c.flight_id == flight_id
        )
        with self._reading() as connection:
            fetch_flight(connection, flight_id)
            rows = connection.execute(query.order_by(flight_markers.c.number))
            return [StoredFlightMarker(**row._mapping) for row in rows]
