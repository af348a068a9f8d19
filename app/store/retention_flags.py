"""The flag `keep`, which protects a row from retention, and the stored size of each thing."""

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


class RetentionFlagRepository(Repository):
    """Flags of flights and recordings, and sizes."""

    def set_flight(self, flight_id: str, keep: bool) -> None:
        self._set(flights, "flight", flight_id, keep)

    def set_recording(self, recording_id: str, keep: bool) -> None:
        self._set(recordings, "recording", recording_id, keep)

    def sizes(self) -> dict[str, dict[str, int]]:
        """Bytes in the database of each flight, dataset and monitor, by table and id."""
        return {
            "flights": self._sizes(assessment_chunks, assessment_chunks.c.flight_id),
            "datasets": self._sizes(dataset_blocks, dataset_blocks.c.dataset_id),
            "monitors": self._sizes(monitor_parts, monitor_parts.c.monitor_id),
        }

    def reusable(self) -> int | None:
        """Free bytes inside SQLite's file, which it will reuse; None for other databases."""
        return reusable_bytes(self._engine)

    def _sizes(self, table: Table, owner: Column[str]) -> dict[str, int]:
        query = select(owner, func.sum(func.length(table.c.content))).group_by(owner)
        with self._reading() as connection:
            return {identity: int(size) for identity, size in connection.execute(query)}

    def _set(self, table: Table, kind: str, identity: str, keep: bool) -> None:
        is_row = table.c.id == identity
        if table is recordings:
            is_row &= recordings.c.complete
        with self._writing() as connection:
            fetch(connection, select(table.c.id).where(is_row), kind, identity)
            connection.execute(update(table).where(is_row).values(keep=keep))
