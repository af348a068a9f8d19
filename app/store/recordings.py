"""Stored recordings, the meaning of their columns, and remarks on them.

The files themselves are in the data directory, see `app.recordings.files`.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, Select, delete, func, insert, select, update

from app.store.flights import replays_of
from app.store.repository import (
    Entries,
    Entry,
    InUse,
    Page,
    Repository,
    Time,
    check_deletable,
    columns,
    fetch,
    require,
)
from app.store.tables import flights, mappings, markers, new_id, now, recordings, scorings

MappingState = Literal["proposed", "remembered", "confirmed"]
MarkerKind = Literal["note", "marker"]


@dataclass(frozen=True)
class RecordingInfo(Entry):
    """An uploaded recording, without the meaning of its columns."""

    id: str
    name: str
    created: Time
    size: int
    """of the file [bytes]"""
    digest: str
    """SHA-256 of the file"""
    format: str
    """key of its format in the catalog"""
    aircraft: str | None
    duration: float | None
    """of the mapped channels [s]; null if the mapping cannot be applied"""
    mapping_state: MappingState
    confirmed_over: dict[str, list[str]] | None
    """warnings by channel that were open when its mapping was confirmed; null if unknown"""
    n_scorings: int
    same_as: str | None
    """id of an earlier upload of the same bytes"""
    keep: bool
    """whether it is kept permanently"""
    flight_id: str | None
    """id of the live flight it was made from, if still stored; null for an upload"""


@dataclass(frozen=True)
class MappedColumns(Entry):
    """Meaning of a recording's columns, as plain data."""

    mapping: dict[str, Any]
    """see app.telemetry.mapping.mapping"""
    mapping_state: MappingState
    proposal: dict[str, Any]
    """why this mapping was proposed, and the alternatives"""
    quality: dict[str, Any] | None
    """quality of the mapped times and channels"""
    problem: str | None
    """why the mapping cannot be applied; null if it can"""
    duration: float | None
    """of the mapped channels [s]; null if the mapping cannot be applied"""
    statistics: list[list[float | None]]
    """[n, missing, min, max, mean] of each signal, in the unit of the file"""
    confirmed_over: dict[str, list[str]] | None = None
    """warnings by channel that were open when the mapping was confirmed; null if unknown"""


@dataclass(frozen=True)
class RememberedMapping(Entry):
    """A mapping confirmed earlier."""

    aircraft: str
    """aircraft it was confirmed for"""
    mapping: dict[str, Any]
    """see app.telemetry.mapping.mapping"""


@dataclass(frozen=True)
class Marker(Entry):
    """A remark on a moment or an interval of a recording."""

    id: str
    created: Time
    kind: MarkerKind
    t: float
    """[s]"""
    end: float | None
    """[s] of an interval; null: a moment"""
    text: str


class RecordingRepository(Entries[RecordingInfo]):
    """Recordings by id."""

    table, entry = recordings, RecordingInfo

    def add(
        self,
        recording_id: str,
        name: str,
        size: int,
        digest: str,
        file_format: str,
        aircraft: str | None,
        mapped: MappedColumns,
    ) -> None:
        """Store a recording, hidden until `complete`; its folder is then moved into place."""
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
        self, recording_id: str, flight_id: str | None = None, remarks: Iterable[Marker] = ()
    ) -> None:
        """Make a recording visible once its folder is in place.

        flight_id: live flight it was made from.   remarks: markers from that flight.
        """
        is_row = recordings.c.id == recording_id
        rows = [asdict(marker) | {"recording_id": recording_id} for marker in remarks]
        with self._writing() as connection:
            connection.execute(update(recordings).where(is_row).values(complete=True))
            if flight_id is not None:
                flown = update(flights).where(flights.c.id == flight_id)
                digest = select(recordings.c.digest).where(is_row).scalar_subquery()
                known = func.coalesce(flights.c.journal_digest, digest)
                connection.execute(flown.values(recording_id=recording_id, journal_digest=known))
            if rows:
                connection.execute(insert(markers), rows)

    def mapped_columns(self, recording_id: str) -> MappedColumns:
        of_recording = recordings.c.complete, recordings.c.id == recording_id
        query = select(*columns(recordings, MappedColumns)).where(*of_recording)
        with self._reading() as connection:
            row = fetch(connection, query, "recording", recording_id)
            return MappedColumns(**row._mapping)

    def confirm_mapping(
        self, recording_id: str, mapped: MappedColumns, aircraft: str | None = None
    ) -> None:
        """Replace the mapping. aircraft: new aircraft, None to keep it."""
        changed = {field.name for field in fields(mapped)} - {"statistics", "proposal"}
        values = {name: getattr(mapped, name) for name in changed}
        values |= {} if aircraft is None else {"aircraft": aircraft}
        with self._writing() as connection:
            require(connection, recordings, recording_id)
            is_row = recordings.c.id == recording_id
            connection.execute(update(recordings).where(is_row).values(**values))

    def withdraw(self, recording_id: str) -> None:
        """Hide a recording before its folder is deleted, and delete its scorings.

        InUse while it is replayed; KeptPermanently.
        """
        with self._deleting() as connection:
            name = self._fetch(connection, recording_id).name
            if users := replays_of(connection, "recording", recording_id):
                raise InUse(f"recording {name}", users)
            check_deletable(connection, recordings, recording_id)
            is_row = recordings.c.id == recording_id
            connection.execute(update(recordings).where(is_row).values(complete=False))
            connection.execute(delete(scorings).where(scorings.c.recording_id == recording_id))

    def purge(self, recording_id: str) -> None:
        """Delete the row of a hidden recording, after its folder."""
        is_row = (recordings.c.id == recording_id) & ~recordings.c.complete
        with self._deleting() as connection:
            connection.execute(delete(recordings).where(is_row))

    def incomplete(self) -> list[str]:
        """Ids of recordings that were being added or deleted when a server died."""
        query = select(recordings.c.id).where(~recordings.c.complete)
        with self._reading() as connection:
            return list(connection.execute(query).scalars())

    def listed(self, limit: int, after: str, aircraft: str, text: str) -> Page[RecordingInfo]:
        """Recordings newest first; other arguments as in `page`.

        aircraft: whole name of the aircraft.   text: part of the recording's name; "" for any.
        """
        conditions = list[ColumnElement[bool]]()
        if aircraft:
            conditions.append(recordings.c.aircraft == aircraft)
        if text := text.strip():
            conditions.append(recordings.c.name.icontains(text, autoescape=True))
        return self.page(limit, after, *conditions)

    def _query(self) -> Select:
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
        query = select(*columns(recordings, RecordingInfo), n_scorings, same_as, flight_id)
        return query.where(recordings.c.complete)


class MarkerRepository(Repository):
    """Markers of recordings."""

    def add(self, recording_id: str, marker: Marker) -> Marker:
        with self._writing() as connection:
            require(connection, recordings, recording_id)
            values = asdict(marker) | {"recording_id": recording_id}
            connection.execute(insert(markers).values(**values))
        return marker

    def of(self, recording_id: str) -> list[Marker]:
        """Remarks on a recording, ordered by time."""
        query = select(*columns(markers, Marker)).where(markers.c.recording_id == recording_id)
        with self._reading() as connection:
            require(connection, recordings, recording_id)
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


class MappingRepository(Repository):
    """Mappings by aircraft and signature of the signals."""

    def save(self, aircraft: str, signature: str, mapping: dict[str, Any]) -> None:
        """Store a mapping for this aircraft, replacing the earlier one."""
        key = {"aircraft": aircraft, "signature": signature}
        same = (mappings.c.aircraft == aircraft) & (mappings.c.signature == signature)
        with self._writing() as connection:
            connection.execute(delete(mappings).where(same))
            row = {"id": new_id(), **key, "saved": now(), "mapping": mapping}
            connection.execute(insert(mappings).values(**row))

    def find(self, aircraft: str | None, signature: str) -> RememberedMapping | None:
        """Mapping last confirmed for this aircraft, preferably for the same signals.

        None if the aircraft is unknown: on another, signs may be reversed under the same names.
        """
        if not aircraft:
            return None
        table = mappings.c
        newest = select(table.aircraft, table.mapping).order_by(table.saved.desc()).limit(1)
        of_aircraft = table.aircraft == aircraft
        with self._reading() as connection:
            for condition in (of_aircraft & (table.signature == signature), of_aircraft):
                row = connection.execute(newest.where(condition)).one_or_none()
                if row is not None:
                    return RememberedMapping(**row._mapping)
        return None
