"""The store: datasets, monitors, jobs, flights, recordings in one database, by URL or path.

Every method is synchronous and may be called from any thread; a coroutine calls it through
`asyncio.to_thread`. Only this package knows both rows and core objects.
"""

import logging
from pathlib import Path

from sqlalchemy import Engine

from app.store.alarms import AlarmRepository
from app.store.answers import AnswerRepository
from app.store.audit import AuditRepository
from app.store.campaigns import CampaignRepository
from app.store.database import Damaged, StoreError, address, damage, make_engine, touch
from app.store.datasets import DatasetRepository
from app.store.flight_markers import FlightMarkerRepository
from app.store.flights import FlightRepository
from app.store.jobs import JobRepository
from app.store.keeping import KeepingRepository
from app.store.limit_sets import LimitSetRepository
from app.store.mappings import MappingRepository
from app.store.markers import MarkerRepository
from app.store.monitors import MonitorRepository
from app.store.recordings import RecordingRepository
from app.store.repository import InUse, KeptForEver, NotFound, Writer
from app.store.reserve import Reserve
from app.store.schema import bring_up_to_date, current_revision, forget_copies
from app.store.scorings import ScoringRepository
from app.store.tokens import TokenRepository

LOG = logging.getLogger("forewarn")
__all__ = ["Damaged", "InUse", "KeptForEver", "NotFound", "Store", "StoreError", "open_store"]


class Store:
    """One database and its repositories, one for each family of tables; see `open_store`."""

    def __init__(self, engine: Engine) -> None:
        self.reserve = Reserve(engine.url)
        self._writer = Writer(self.reserve)
        shared = engine, self._writer
        self.engine = engine
        self.datasets = DatasetRepository(*shared)
        self.monitors = MonitorRepository(*shared)
        self.jobs = JobRepository(*shared)
        self.flights = FlightRepository(*shared)
        self.alarms = AlarmRepository(*shared)
        self.flight_markers = FlightMarkerRepository(*shared)
        self.limit_sets = LimitSetRepository(*shared)
        self.recordings = RecordingRepository(*shared)
        self.mappings = MappingRepository(*shared)
        self.scorings = ScoringRepository(*shared)
        self.markers = MarkerRepository(*shared)
        self.campaigns = CampaignRepository(*shared)
        self.keeping = KeepingRepository(*shared)
        self.answers = AnswerRepository(*shared)
        self.tokens = TokenRepository(*shared)
        self.audit = AuditRepository(*shared)

    def recover(self) -> None:
        """Clear up after a process that died: interrupted work, half-stored content.

        Where the disk takes no writes this is done before the first one that it takes.
        Recordings, whose content lies in folders, are cleared up by `app.recordings.files`.
        """
        try:
            self._recover()
        except StoreError as error:
            LOG.warning("the store can only be read for now: %s", error)
            self._writer.unfinished = self._recover

    def _recover(self) -> None:
        for repository in (self.jobs, self.flights, self.monitors, self.datasets):
            repository.recover()

    def revision(self) -> str:
        """Revision of the schema."""
        return str(current_revision(self.engine.url))

    def touch(self) -> None:
        """See that the database takes writes; StoreError."""
        touch(self.engine)

    def damage(self) -> list[str]:
        """Look through the whole database; one line for each thing that is wrong with it."""
        return damage(self.engine)

    def forget_copies(self) -> None:
        """The start was good: copies made before an earlier migration are not needed any more."""
        forget_copies(self.engine.url)

    def close(self) -> None:
        """Close idle connections; the store may still be used and opens new ones."""
        self.engine.dispose()


def open_store(url_or_path: str | Path, *, recover: bool = True) -> Store:
    """Open the store, making it where it is missing and upgrading one of an older program.

    recover: work that was running is reported as interrupted, half-stored content is removed.
    False for a look at a store that another process is serving.
    StoreError where it cannot be used; a database of a newer program is left untouched.
    """
    url = address(url_or_path)
    if recover:
        Reserve(url).free()
    bring_up_to_date(url)
    store = Store(make_engine(url))
    if recover:
        store.recover()
    return store
