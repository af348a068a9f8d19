"""Stored recordings: what they are, and what their columns are taken for.

The files themselves lie in the data directory, see `app.recordings.files`.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, Literal

from sqlalchemy import Connection, Select, delete, func, insert, select, update

from app.store.flights import replays_of
from app.store.repository import (
    Entry,
    InUse,
    Repository,
    check_not_kept,
    columns,
    complete,
    fetch,
)
from app.store.tables import flights, markers, now, recordings, scorings

if TYPE_CHECKING:
    from app.store.markers import Marker

MappingState = Literal["proposed", "remembered", "confirmed"]


@dataclass(frozen=True)
class RecordingInfo(Entry):
    """An uploaded recording, without what its columns are taken for."""

    id: str
    name: str
    created: str
    """UTC, ISO 8601"""
    size: int
    """of the file [bytes]"""
    digest: str
    """SHA-256 of the file"""
    format: str
    """key of a format in the catalog"""
    aircraft: str | None
    duration: float | None
    """of the mapped channels [s]; null where the mapping cannot be applied"""
    mapping_state: MappingState
    confirmed_over: dict[str, list[str]] | None
    """warnings by channel that its mapping was confirmed over; null where it is not known"""
    n_scorings: int
    same_as: str | None
    """id of an earlier upload of the same bytes"""
    keep: bool
    """whether it is kept for ever"""
    flight_id: str | None
    """id of the live flight that it was, if that is stored still; null of an upload"""


@dataclass(frozen=True)
class MappedColumns(Entry):
    """What the columns of a recording are taken for, as plain data."""

    mapping: dict[str, Any]
    """as of app.telemetry.mapping.mapping"""
    mapping_state: MappingState
    proposal: dict[str, Any]
    """why the mapping was proposed, and what else could be"""
    quality: dict[str, Any] | None
    """of the times and channels so mapped"""
    problem: str | None
    """why the mapping cannot be applied"""
    duration: float | None
    """of the mapped channels [s]; null where the mapping cannot be applied"""
    statistics: list[list[float | None]]
    """[n, missing, min, max, mean] of each signal, in the file's unit"""
    confirmed_over: dict[str, list[str]] | None = None
    """warnings by channel that the mapping was confirmed over; null where it is not known"""


class RecordingRepository(Repository):
    """Recordings by id."""

    def begin(
        self,
        recording_id: str,
        name: str,
        size: int,
        digest: str,
        file_format: str,
        aircraft: str | None,
        mapped: MappedColumns,
    ) -> None:
        """Store a recording whose folder is about to be put in its place; it is not seen yet."""
        row = {
            "id": recording_id,
            "name": name,
            "created": now(),
            "size": size,
            "digest": digest,
            "format": file_format,
            "aircraft": aircraft,
        }
        with self._writing() as connection:
            connection.execute(insert(recordings).values(**row, **asdict(mapped), complete=False))

    def complete(
        self, recording_id: str, flight_id: str | None = None, remarks: Iterable["Marker"] = ()
    ) -> None:
        """Let a recording be seen: its folder is in its place.

        flight_id: of the live flight that it was.   remarks: markers that it has from there.
        """
        this = recordings.c.id == recording_id
        rows = [asdict(marker) | {"recording_id": recording_id} for marker in remarks]
        with self._writing() as connection:
            connection.execute(update(recordings).where(this).values(complete=True))
            if flight_id is not None:
                flown = update(flights).where(flights.c.id == flight_id)
                connection.execute(flown.values(recording_id=recording_id))
            if rows:
                connection.execute(insert(markers), rows)

    def info(self, recording_id: str) -> RecordingInfo:
        """What a recording is; NotFound."""
        with self._reading() as connection:
            return fetch_recording(connection, recording_id)

    def all(self) -> list[RecordingInfo]:
        """All recordings, newest first."""
        query = _recordings().where(recordings.c.complete).order_by(recordings.c.created.desc())
        with self._reading() as connection:
            return [RecordingInfo(**row._mapping) for row in connection.execute(query)]

    def mapped_columns(self, recording_id: str) -> MappedColumns:
        """What its columns are taken for; NotFound."""
        query = select(*columns(recordings, MappedColumns)).where(
            complete(recordings, recording_id)
        )
        with self._reading() as connection:
            row = fetch(connection, query, "recording", recording_id)
            return MappedColumns(**row._mapping)

    def confirm_mapping(
        self, recording_id: str, mapped: MappedColumns, aircraft: str | None = None
    ) -> None:
        """Take the columns for this from now on; aircraft: another than before. NotFound."""
        changed = {field.name for field in fields(mapped)} - {"statistics", "proposal"}
        values = {name: getattr(mapped, name) for name in changed}
        values |= {} if aircraft is None else {"aircraft": aircraft}
        with self._writing() as connection:
            fetch_recording(connection, recording_id)
            this = recordings.c.id == recording_id
            connection.execute(update(recordings).where(this).values(**values))

    def withdraw(self, recording_id: str) -> None:
        """Let a recording be seen no more: its folder is about to go.

        NotFound; InUse if flown; KeptForEver.
        """
        with self._deleting() as connection:
            name = fetch_recording(connection, recording_id).name
            if users := replays_of(connection, "recording", recording_id):
                raise InUse(f"recording {name}", users)
            check_not_kept(connection, recordings, "recording", recording_id)
            this = recordings.c.id == recording_id
            connection.execute(update(recordings).where(this).values(complete=False))
            connection.execute(delete(scorings).where(scorings.c.recording_id == recording_id))

    def purge(self, recording_id: str) -> None:
        """Delete the row of a recording that has no folder any more."""
        this = (recordings.c.id == recording_id) & ~recordings.c.complete
        with self._deleting() as connection:
            connection.execute(delete(recordings).where(this))

    def incomplete(self) -> list[str]:
        """Ids of recordings that were being put in their place, or removed, when a server died."""
        query = select(recordings.c.id).where(~recordings.c.complete)
        with self._reading() as connection:
            return list(connection.execute(query).scalars())


def _recordings() -> Select:
    n_scorings = (
        select(func.count())
        .where(scorings.c.recording_id == recordings.c.id)
        .scalar_subquery()
        .label("n_scorings")
    )
    same = recordings.alias()
    first = (
        select(same.c.id)
        .where(same.c.digest == recordings.c.digest, same.c.complete)
        .order_by(same.c.created, same.c.id)
        .limit(1)
        .scalar_subquery()
    )
    same_as = func.nullif(first, recordings.c.id).label("same_as")
    flown = select(flights.c.id).where(flights.c.recording_id == recordings.c.id)
    flight_id = flown.limit(1).scalar_subquery().label("flight_id")
    return select(*columns(recordings, RecordingInfo), n_scorings, same_as, flight_id)


def fetch_recording(connection: Connection, recording_id: str) -> RecordingInfo:
    """What a recording is; NotFound."""
    query = _recordings().where(complete(recordings, recording_id))
    return RecordingInfo(**fetch(connection, query, "recording", recording_id)._mapping)
