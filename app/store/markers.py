"""Stored markers: remarks that people set on a recording."""

from dataclasses import asdict, dataclass, replace
from typing import Literal

from sqlalchemy import Connection, delete, insert, select, update

from app.store.recordings import fetch_recording
from app.store.repository import Entry, Repository, columns, fetch
from app.store.tables import markers

MarkerKind = Literal["note", "marker"]


@dataclass(frozen=True)
class Marker(Entry):
    """A remark on a moment or an interval of a recording."""

    id: str
    created: str
    """UTC, ISO 8601"""
    kind: MarkerKind
    t: float
    """[s]"""
    end: float | None
    """[s] of an interval; null: a moment"""
    text: str


class MarkerRepository(Repository):
    """Markers of recordings."""

    def add(self, recording_id: str, marker: Marker) -> Marker:
        with self._writing() as connection:
            fetch_recording(connection, recording_id)
            values = asdict(marker) | {"recording_id": recording_id}
            connection.execute(insert(markers).values(**values))
        return marker

    def of(self, recording_id: str) -> list[Marker]:
        """Remarks on a recording, ordered by time."""
        query = select(*columns(markers, Marker)).where(markers.c.recording_id == recording_id)
        with self._reading() as connection:
            fetch_recording(connection, recording_id)
            rows = connection.execute(query.order_by(markers.c.t, markers.c.created))
            return [Marker(**row._mapping) for row in rows]

    def update(self, recording_id: str, marker: Marker) -> Marker:
        """Replace the remark with this id, keeping its time of creation; return it as stored."""
        with self._writing() as connection:
            marker = replace(marker, created=_marker(connection, recording_id, marker.id).created)
            is_row = markers.c.id == marker.id
            connection.execute(update(markers).where(is_row).values(**asdict(marker)))
        return marker

    def delete(self, recording_id: str, marker_id: str) -> None:
        with self._deleting() as connection:
            _marker(connection, recording_id, marker_id)
            connection.execute(delete(markers).where(markers.c.id == marker_id))


def _marker(connection: Connection, recording_id: str, marker_id: str) -> Marker:
    query = select(*columns(markers, Marker)).where(
        markers.c.id == marker_id, markers.c.recording_id == recording_id
    )
    return Marker(**fetch(connection, query, "marker", marker_id)._mapping)
