"""Stored scorings: recordings as monitors scored them, without the samples."""

from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import Connection, Row, Select, delete, insert, select

from app.store.flights import replays_of
from app.store.recordings import fetch_recording
from app.store.repository import Entry, InUse, Repository, columns, complete, fetch
from app.store.tables import monitors, scorings
from core.specification import PlainSpecification


@dataclass(frozen=True)
class ScoringInfo(Entry):
    """A recording as a monitor scored it, without the samples."""

    id: str
    recording_id: str
    monitor_id: str
    monitor_name: str
    monitor_digest: str
    """SHA-256 of the portable monitor"""
    specification: PlainSpecification
    """what the monitor warns of: limits by channel, a label, null where it is not known"""
    request_digest: str
    """SHA-256 of all that decides the samples"""
    digest: str
    """SHA-256 of the samples: the same request gives the same"""
    created: str
    """UTC, ISO 8601"""
    version: str
    """program that scored it"""
    epsilon: float
    """accepted miss rate"""
    lead: float
    """promised by the monitor [s]"""
    dt: float
    """sample interval [s]"""
    request: dict[str, Any]
    """epsilon, trim and manoeuvres as asked for"""
    mapping: dict[str, Any]
    """that was used"""
    n_samples: int
    start: float
    """[s]"""
    end: float
    """[s]"""
    notes: list[str]
    """what was assumed and done, oldest first"""
    quality: dict[str, Any] | None
    """of the recorded times and channels"""
    manoeuvres: list[dict[str, Any]]
    """each with its trim, validity, alerts, exceedance and outcome"""
    outside_exceedances: list[dict[str, Any]]
    """those that begin in no manoeuvre: t [s], channel and value of the first recorded sample, from
    the trim of the manoeuvre before"""


class ScoringRepository(Repository):
    """Scorings of recordings by id."""

    def add(self, scoring: ScoringInfo) -> ScoringInfo:
        """Store a scoring whose samples are in their place.

        Returns the stored one: an earlier one where the request was carried out before.
        NotFound where the recording or the monitor was deleted meanwhile.
        """
        values = {key: value for key, value in asdict(scoring).items() if key in scorings.c}
        with self._writing() as connection:
            fetch_recording(connection, scoring.recording_id)
            monitor = select(monitors.c.id).where(complete(monitors, scoring.monitor_id))
            fetch(connection, monitor, "monitor", scoring.monitor_id)
            earlier = _same_request(scoring.recording_id, scoring.request_digest)
            if (row := connection.execute(earlier).one_or_none()) is not None:
                return _entry(row)
            connection.execute(insert(scorings).values(**values))
        return scoring

    def find(self, recording_id: str, request_digest: str) -> ScoringInfo | None:
        """The scoring that this request led to before, None where it was never carried out."""
        with self._reading() as connection:
            row = connection.execute(_same_request(recording_id, request_digest)).one_or_none()
        return None if row is None else _entry(row)

    def info(self, recording_id: str, scoring_id: str) -> ScoringInfo:
        """What a scoring of this recording is; NotFound."""
        with self._reading() as connection:
            return _scoring(connection, recording_id, scoring_id)

    def of(self, recording_id: str) -> list[ScoringInfo]:
        """All scorings of a recording, newest first. NotFound."""
        query = _scorings(recording_id).order_by(scorings.c.created.desc())
        with self._reading() as connection:
            fetch_recording(connection, recording_id)
            return [_entry(row) for row in connection.execute(query)]

    def ids(self) -> set[str]:
        """Ids of all scorings of all recordings."""
        with self._reading() as connection:
            return set(connection.execute(select(scorings.c.id)).scalars())

    def delete(self, recording_id: str, scoring_id: str) -> None:
        """Delete a scoring. NotFound; InUse while it is flown."""
        with self._deleting() as connection:
            info = _scoring(connection, recording_id, scoring_id)
            if users := replays_of(connection, "scoring", scoring_id):
                raise InUse(f"the scoring by {info.monitor_name}", users)
            connection.execute(delete(scorings).where(scorings.c.id == scoring_id))


def _scorings(recording_id: str) -> Select:
    of_monitor = monitors.c.name.label("monitor_name"), monitors.c.specification
    joined = select(*columns(scorings, ScoringInfo), *of_monitor).join(
        monitors, monitors.c.id == scorings.c.monitor_id
    )
    return joined.where(scorings.c.recording_id == recording_id)


def _same_request(recording_id: str, request_digest: str) -> Select:
    return _scorings(recording_id).where(scorings.c.request_digest == request_digest)


def _scoring(connection: Connection, recording_id: str, scoring_id: str) -> ScoringInfo:
    query = _scorings(recording_id).where(scorings.c.id == scoring_id)
    return _entry(fetch(connection, query, "scoring", scoring_id))


def _entry(row: Row) -> ScoringInfo:
    return ScoringInfo(**row._mapping)
