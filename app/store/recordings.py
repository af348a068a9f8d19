"""Stored recordings: what they are, what their columns are taken for, mappings to use again.

The files themselves lie in the data directory, see `app.recordings.files`.
"""

from dataclasses import asdict, fields
from typing import Any

from sqlalchemy import (
    Connection,
    Select,
    delete,
    func,
    insert,
    select,
    update,
)

from app.store.entries import MappedColumns, RecordingInfo, RememberedMapping
from app.store.repository import InUse, Shelf, columns, found, whole
from app.store.tables import channel_maps, flights, new_id, now, recordings, scorings


class StoredRecordings(Shelf):
    """Recordings by id."""

    def begin_recording(
        self,
        recording_id: str,
        name: str,
        size: int,
        digest: str,
        file_format: str,
        aircraft: str | None,
        mapped: MappedColumns,
    ) -> None:
        """Keep a recording whose folder is about to be put in its place; it is not seen yet."""
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

    def complete_recording(self, recording_id: str) -> None:
        """Let a recording be seen: its folder is in its place."""
        this = recordings.c.id == recording_id
        with self._writing() as connection:
            connection.execute(update(recordings).where(this).values(complete=True))

    def recording_info(self, recording_id: str) -> RecordingInfo:
        """What a recording is; NotFound."""
        with self._reading() as connection:
            return _recording(connection, recording_id)

    def recordings(self) -> list[RecordingInfo]:
        """All recordings, newest first."""
        query = _recordings().where(recordings.c.complete).order_by(recordings.c.created.desc())
        with self._reading() as connection:
            return [RecordingInfo(**row._mapping) for row in connection.execute(query)]

    def mapped_columns(self, recording_id: str) -> MappedColumns:
        """What its columns are taken for; NotFound."""
        query = select(*columns(recordings, MappedColumns)).where(whole(recordings, recording_id))
        with self._reading() as connection:
            row = found(connection, query, "recording", recording_id)
            return MappedColumns(**row._mapping)

    def earlier_recording(self, recording_id: str) -> str | None:
        """Id of the first recording of the same bytes, None where this is it. NotFound."""
        with self._reading() as connection:
            info = _recording(connection, recording_id)
            same = select(recordings.c.id).where(
                recordings.c.digest == info.digest, recordings.c.complete
            )
            first = same.order_by(recordings.c.created, recordings.c.id).limit(1)
            earliest = connection.execute(first).scalar_one()
        return None if earliest == recording_id else earliest

    def confirm_mapping(
        self, recording_id: str, mapped: MappedColumns, aircraft: str | None = None
    ) -> None:
        """Take the columns for this from now on; aircraft: another than was said. NotFound."""
        known = {field.name for field in fields(mapped)} - {"statistics", "proposal"}
        said: dict[str, Any] = {name: getattr(mapped, name) for name in known}
        said |= {} if aircraft is None else {"aircraft": aircraft}
        with self._writing() as connection:
            _recording(connection, recording_id)
            this = recordings.c.id == recording_id
            connection.execute(update(recordings).where(this).values(**said))

    def withdraw_recording(self, recording_id: str) -> None:
        """Let a recording be seen no more: its folder is about to go. NotFound; InUse if flown."""
        with self._writing() as connection:
            name = _recording(connection, recording_id).name
            if users := flown_by(connection, "recording", recording_id):
                raise InUse(f"recording {name}", users)
            this = recordings.c.id == recording_id
            connection.execute(update(recordings).where(this).values(complete=False))
            connection.execute(delete(scorings).where(scorings.c.recording_id == recording_id))

    def forget_recording(self, recording_id: str) -> None:
        """Delete the row of a recording that has no folder any more."""
        this = (recordings.c.id == recording_id) & ~recordings.c.complete
        with self._writing() as connection:
            connection.execute(delete(recordings).where(this))

    def unseen_recordings(self) -> list[str]:
        """Ids of recordings that were being put in their place, or removed, when a server died."""
        query = select(recordings.c.id).where(~recordings.c.complete)
        with self._reading() as connection:
            return list(connection.execute(query).scalars())

    def remember_mapping(self, aircraft: str, signature: str, mapping: dict[str, Any]) -> None:
        """Keep a mapping for the next recording of this aircraft."""
        key = {"aircraft": aircraft, "signature": signature}
        same = (channel_maps.c.aircraft == aircraft) & (channel_maps.c.signature == signature)
        with self._writing() as connection:
            connection.execute(delete(channel_maps).where(same))
            row = {"id": new_id(), **key, "saved": now(), "mapping": mapping}
            connection.execute(insert(channel_maps).values(**row))

    def remembered_mapping(self, aircraft: str | None, signature: str) -> RememberedMapping | None:
        """The mapping last confirmed for this aircraft, best of these very signals.

        None where the aircraft is not said: another's may be reversed under the same names.
        """
        if not aircraft:
            return None
        table = channel_maps.c
        newest = select(table.aircraft, table.mapping).order_by(table.saved.desc()).limit(1)
        of_aircraft = table.aircraft == aircraft
        with self._reading() as connection:
            for condition in (of_aircraft & (table.signature == signature), of_aircraft):
                row = connection.execute(newest.where(condition)).one_or_none()
                if row is not None:
                    return RememberedMapping(**row._mapping)
        return None


def flown_by(connection: Connection, what: str, identity: str) -> list[tuple[str, str]]:
    """Flights under way whose source is this recording or scoring, in words, with their ids."""
    running = select(flights.c.id, flights.c.source).where(flights.c.status == "running")
    return [
        ("running flight", row.id)
        for row in connection.execute(running.order_by(flights.c.created))
        if row.source.get(what) == identity
    ]


def _recordings() -> Select:
    n_scorings = (
        select(func.count())
        .where(scorings.c.recording_id == recordings.c.id)
        .scalar_subquery()
        .label("n_scorings")
    )
    return select(*columns(recordings, RecordingInfo), n_scorings)


def _recording(connection: Connection, recording_id: str) -> RecordingInfo:
    query = _recordings().where(whole(recordings, recording_id))
    return RecordingInfo(**found(connection, query, "recording", recording_id)._mapping)
