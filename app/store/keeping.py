"""What is kept for ever, and how much the rows of each thing take."""

from sqlalchemy import Column, Table, func, select, update

from app.store.database import reusable_bytes
from app.store.repository import Repository, fetch
from app.store.tables import (
    assessment_chunks,
    dataset_blocks,
    flights,
    monitor_parts,
    recordings,
)


class KeepingRepository(Repository):
    """The flag `keep` of flights and recordings, and sizes."""

    def set_flight(self, flight_id: str, keep: bool) -> None:
        """Say whether a flight is kept for ever. NotFound."""
        self._set(flights, "flight", flight_id, keep)

    def set_recording(self, recording_id: str, keep: bool) -> None:
        """Say whether a recording is kept for ever. NotFound."""
        self._set(recordings, "recording", recording_id, keep)

    def sizes(self) -> dict[str, dict[str, int]]:
        """Bytes in the database of each flight, dataset and monitor, by table and id."""
        return {
            "flights": self._sizes(assessment_chunks, assessment_chunks.c.flight_id),
            "datasets": self._sizes(dataset_blocks, dataset_blocks.c.dataset_id),
            "monitors": self._sizes(monitor_parts, monitor_parts.c.monitor_id),
        }

    def reusable(self) -> int | None:
        """Bytes of SQLite's file that hold nothing and are used again; None elsewhere."""
        return reusable_bytes(self._engine)

    def _sizes(self, table: Table, owner: Column[str]) -> dict[str, int]:
        query = select(owner, func.sum(func.length(table.c.content))).group_by(owner)
        with self._reading() as connection:
            return {identity: int(size) for identity, size in connection.execute(query)}

    def _set(self, table: Table, what: str, identity: str, keep: bool) -> None:
        this = table.c.id == identity
        if table is recordings:
            this &= recordings.c.complete
        with self._writing() as connection:
            fetch(connection, select(table.c.id).where(this), what, identity)
            connection.execute(update(table).where(this).values(keep=keep))
