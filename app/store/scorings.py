"""Stored scorings: results of monitors on recordings, without the samples."""

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from typing import Any

from sqlalchemy import Row, Select, delete, insert, select

from app.store.database import Damaged, to_text
from app.store.flights import replays_of
from app.store.repository import Entry, InUse, Repository, Time, columns, fetch, require
from app.store.tables import monitors, recordings, scorings
from core.limits.limits import PlainSpecification


@dataclass(frozen=True)
class ScoringInfo(Entry):
    """Result of a monitor on a recording, without the samples."""

    id: str
    recording_id: str
    monitor_id: str
    monitor_name: str
    monitor_digest: str
    """SHA-256 of the portable monitor"""
    specification: PlainSpecification
    """limits the monitor warns of, by channel; a label for other kinds, null if unknown"""
    request_digest: str
    """SHA-256 of everything that determines the samples"""
    digest: str
    """SHA-256 of the samples; the same request gives the same digest"""
    created: Time
    version: str
    """version of the program that scored it"""
    epsilon: float
    """accepted miss rate"""
    lead: float
    """lead time of the monitor [s]"""
    dt: float
    """sample interval [s]"""
    request: dict[str, Any]
    """epsilon, trim and manoeuvres as requested"""
    mapping: dict[str, Any]
    """mapping used"""
    n_samples: int
    start: float
    """[s]"""
    end: float
    """[s]"""
    notes: list[str]
    """assumptions and steps, oldest first"""
    quality: dict[str, Any] | None
    """quality of the recorded times and channels, and whether the sensors agree"""
    manoeuvres: list[dict[str, Any]]
    """each with trim, validity, alerts, exceedance and outcome"""
    outside_exceedances: list[dict[str, Any]]
    """exceedances that start outside manoeuvres: t [s], channel and value of the first sample,
    relative to the trim of the manoeuvre before"""
    limits_in_force: list[dict[str, Any]] | None = None
    """limits of a limit set, from start to end; null if none was used, or in older scorings"""
    row_digest: str | None = None
    """SHA-256 of all other fields; null if an older program stored the scoring"""

    def sealed(self) -> "ScoringInfo":
        return replace(self, row_digest=self._digest())

    @property
    def damage(self) -> str:
        """Error message if it has changed since it was stored, else empty."""
        if self.row_digest in (None, self._digest()):
            return ""
        return (
            f"scoring {self.id} is damaged (its content does not match its digest): delete this "
            "scoring and score the recording again"
        )

    def _digest(self) -> str:
        content = json.loads(to_text(asdict(replace(self, row_digest=None))))
        if content["limits_in_force"] is None:  # older programs did not have it
            del content["limits_in_force"]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


class ScoringRepository(Repository):
    """Scorings of recordings."""

    def add(self, scoring: ScoringInfo) -> ScoringInfo:
        """Store a scoring whose samples are in place.

        Returns the stored scoring, which is an earlier one if the request is a repetition.
        NotFound if the recording or monitor was deleted in the meantime; Damaged.
        """
        scoring = scoring.sealed()
        values = {key: value for key, value in asdict(scoring).items() if key in scorings.c}
        with self._writing() as connection:
            require(connection, recordings, scoring.recording_id)
            require(connection, monitors, scoring.monitor_id)
            earlier = _same_request(scoring.recording_id, scoring.request_digest)
            if (row := connection.execute(earlier).one_or_none()) is not None:
                return _checked(row)
            connection.execute(insert(scorings).values(**values))
        return scoring

    def find(self, recording_id: str, request_digest: str) -> ScoringInfo | None:
        """Earlier scoring for the same request, if any. Damaged."""
        with self._reading() as connection:
            row = connection.execute(_same_request(recording_id, request_digest)).one_or_none()
        return None if row is None else _checked(row)

    def info(self, recording_id: str, scoring_id: str) -> ScoringInfo:
        """Damaged if it has changed since it was stored."""
        with self._reading() as connection:
            query = _scorings(recording_id).where(scorings.c.id == scoring_id)
            return _checked(fetch(connection, query, "scoring", scoring_id))

    def of(self, recording_id: str) -> list[ScoringInfo]:
        """All scorings of a recording, newest first; `damage` of each may be set."""
        query = _scorings(recording_id).order_by(scorings.c.created.desc())
        with self._reading() as connection:
            require(connection, recordings, recording_id)
            return [ScoringInfo(**row._mapping) for row in connection.execute(query)]

    def ids(self, recording_id: str | None = None) -> set[str]:
        """Ids of all scorings, or of one recording's."""
        query = select(scorings.c.id)
        if recording_id is not None:
            query = query.where(scorings.c.recording_id == recording_id)
        with self._reading() as connection:
            return set(connection.execute(query).scalars())

    def delete(self, recording_id: str, scoring_id: str) -> None:
        """Delete a scoring. InUse while it is replayed."""
        with self._deleting() as connection:
            of_recording = scorings.c.recording_id == recording_id
            is_row = (scorings.c.id == scoring_id) & of_recording
            monitor_name = select(monitors.c.name).join(scorings).where(is_row)
            name = fetch(connection, monitor_name, "scoring", scoring_id).name
            if users := replays_of(connection, "scoring", scoring_id):
                raise InUse(f"the scoring by {name}", users)
            connection.execute(delete(scorings).where(scorings.c.id == scoring_id))


def _scorings(recording_id: str) -> Select:
    of_monitor = monitors.c.name.label("monitor_name"), monitors.c.specification
    joined = select(*columns(scorings, ScoringInfo), *of_monitor).join(
        monitors, monitors.c.id == scorings.c.monitor_id
    )
    return joined.where(scorings.c.recording_id == recording_id)


def _same_request(recording_id: str, request_digest: str) -> Select:
    return _scorings(recording_id).where(scorings.c.request_digest == request_digest)


def _checked(row: Row) -> ScoringInfo:
    info = ScoringInfo(**row._mapping)
    if info.damage:
        raise Damaged(info.damage)
    return info
