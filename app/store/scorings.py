"""Stored scorings: recordings as monitors scored them, without the samples; markers beside them."""

from dataclasses import asdict, replace

from sqlalchemy import Connection, Select, delete, insert, select, update

from app.store.entries import Marker, ScoringInfo
from app.store.recordings import flown_by
from app.store.repository import InUse, Shelf, columns, found, whole
from app.store.tables import markers, monitors, recordings, scorings


class StoredScorings(Shelf):
    """Scorings of recordings by id, and the markers that people set on a recording."""

    def add_scoring(self, scoring: ScoringInfo) -> ScoringInfo:
        """Keep a scoring whose samples are in their place.

        Returns the one that is kept: an earlier one where the order was carried out before.
        NotFound where the recording or the monitor was deleted meanwhile.
        """
        row = {key: value for key, value in asdict(scoring).items() if key in scorings.c}
        with self._writing() as connection:
            _check_recording(connection, scoring.recording_id)
            monitor = select(monitors.c.id).where(whole(monitors, scoring.monitor_id))
            found(connection, monitor, "monitor", scoring.monitor_id)
            earlier = _same_order(scoring.recording_id, scoring.order_digest)
            if (kept := connection.execute(earlier).one_or_none()) is not None:
                return _entry(kept)
            connection.execute(insert(scorings).values(**row))
        return scoring

    def same_scoring(self, recording_id: str, order_digest: str) -> ScoringInfo | None:
        """The scoring that this order led to before, None where it was never carried out."""
        with self._reading() as connection:
            row = connection.execute(_same_order(recording_id, order_digest)).one_or_none()
        return None if row is None else _entry(row)

    def scoring(self, recording_id: str, scoring_id: str) -> ScoringInfo:
        """What a scoring of this recording is; NotFound."""
        with self._reading() as connection:
            return _scoring(connection, recording_id, scoring_id)

    def scorings(self, recording_id: str) -> list[ScoringInfo]:
        """All scorings of a recording, newest first. NotFound."""
        query = _scorings(recording_id).order_by(scorings.c.created.desc())
        with self._reading() as connection:
            _check_recording(connection, recording_id)
            return [_entry(row) for row in connection.execute(query)]

    def scoring_ids(self) -> set[str]:
        """Ids of all scorings of all recordings."""
        with self._reading() as connection:
            return set(connection.execute(select(scorings.c.id)).scalars())

    def delete_scoring(self, recording_id: str, scoring_id: str) -> None:
        """Delete a scoring. NotFound; InUse while it is flown."""
        with self._writing() as connection:
            info = _scoring(connection, recording_id, scoring_id)
            if users := flown_by(connection, "scoring", scoring_id):
                raise InUse(f"the scoring by {info.monitor_name}", users)
            connection.execute(delete(scorings).where(scorings.c.id == scoring_id))

    def add_marker(self, recording_id: str, marker: Marker) -> Marker:
        """Keep a remark on a recording. NotFound."""
        with self._writing() as connection:
            _check_recording(connection, recording_id)
            values = asdict(marker) | {"recording_id": recording_id}
            connection.execute(insert(markers).values(**values))
        return marker

    def markers(self, recording_id: str) -> list[Marker]:
        """All remarks on a recording, in the order of their times. NotFound."""
        query = select(*columns(markers, Marker)).where(markers.c.recording_id == recording_id)
        with self._reading() as connection:
            _check_recording(connection, recording_id)
            rows = connection.execute(query.order_by(markers.c.t, markers.c.created))
            return [Marker(**row._mapping) for row in rows]

    def change_marker(self, recording_id: str, marker: Marker) -> Marker:
        """Put a remark in the place of the one of its id; return it as it is kept. NotFound."""
        with self._writing() as connection:
            kept = _marker(connection, recording_id, marker.id)
            marker = replace(marker, created=kept.created)
            this = markers.c.id == marker.id
            connection.execute(update(markers).where(this).values(**asdict(marker)))
        return marker

    def delete_marker(self, recording_id: str, marker_id: str) -> None:
        """Delete a remark. NotFound."""
        with self._writing() as connection:
            _marker(connection, recording_id, marker_id)
            connection.execute(delete(markers).where(markers.c.id == marker_id))


def _check_recording(connection: Connection, recording_id: str) -> None:
    query = select(recordings.c.id).where(whole(recordings, recording_id))
    found(connection, query, "recording", recording_id)


def _scorings(recording_id: str) -> Select:
    of_monitor = monitors.c.name.label("monitor_name"), monitors.c.dataset_recipe
    joined = select(*columns(scorings, ScoringInfo), *of_monitor).join(
        monitors, monitors.c.id == scorings.c.monitor_id
    )
    return joined.where(scorings.c.recording_id == recording_id)


def _same_order(recording_id: str, order_digest: str) -> Select:
    return _scorings(recording_id).where(scorings.c.order_digest == order_digest)


def _scoring(connection: Connection, recording_id: str, scoring_id: str) -> ScoringInfo:
    query = _scorings(recording_id).where(scorings.c.id == scoring_id)
    return _entry(found(connection, query, "scoring", scoring_id))


def _entry(row) -> ScoringInfo:
    values = dict(row._mapping)
    recipe = values.pop("dataset_recipe")
    return ScoringInfo(**values, specification=recipe.get("specification", {}))


def _marker(connection: Connection, recording_id: str, marker_id: str) -> Marker:
    query = select(*columns(markers, Marker)).where(
        markers.c.id == marker_id, markers.c.recording_id == recording_id
    )
    return Marker(**found(connection, query, "marker", marker_id)._mapping)
