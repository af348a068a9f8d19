"""The store: datasets, monitors, jobs, flights and recordings in one database, by URL or path.

Every method is synchronous and may be called from any thread; coroutines call it through
`asyncio.to_thread`. Only this package converts between rows and core objects.
"""

import asyncio
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Engine, select

from app.store.alarms import AlarmRepository, FlightMarkerRepository
from app.store.answers import AnswerRepository
from app.store.campaigns import CampaignRepository
from app.store.condition_sets import LimitSetRepository, MonitorSetRepository
from app.store.database import (
    Damaged,
    StoreError,
    address,
    check_pages,
    make_engine,
    read_only_engine,
    reading,
)
from app.store.datasets import DatasetRepository
from app.store.disk import LastStop, Reserve
from app.store.flights import FlightRepository
from app.store.jobs import JobRepository
from app.store.monitors import AirframeRepository, MonitorRepository
from app.store.ownership import Ownership, Taken, owned
from app.store.people import AuditRepository, SessionRepository, TokenRepository
from app.store.recordings import MappingRepository, MarkerRepository, RecordingRepository
from app.store.repository import InUse, KeptPermanently, NotFound, Writer
from app.store.schema import bring_up_to_date, current_revision
from app.store.scorings import ScoringRepository
from app.store.tables import datasets, monitors
from core.channels import Dictionary

LOG = logging.getLogger("forewarn")
ANSWER_S = 2.0
"""A store that takes longer to answer is not ready [s]."""
CHECK_S = 5.0
__all__ = ["Damaged", "InUse", "KeptPermanently", "NotFound", "Store", "StoreError", "open_store"]


class Store:
    """One database and its repositories, one per table family; see `open_store`."""

    def __init__(self, engine: Engine) -> None:
        self.reserve = Reserve(engine.url)
        self._writer = Writer(self.reserve)
        shared = engine, self._writer
        self.engine = engine
        self.last_stop = LastStop(engine.url)
        self.ownership: Ownership | None = None
        self._n_noted = -1
        self.datasets = DatasetRepository(*shared)
        self.monitors = MonitorRepository(*shared)
        self.airframes = AirframeRepository(*shared)
        self.jobs = JobRepository(*shared)
        self.flights = FlightRepository(*shared)
        self.alarms = AlarmRepository(*shared)
        self.flight_markers = FlightMarkerRepository(*shared)
        self.limit_sets = LimitSetRepository(*shared)
        self.monitor_sets = MonitorSetRepository(*shared)
        self.recordings = RecordingRepository(*shared)
        self.mappings = MappingRepository(*shared)
        self.scorings = ScoringRepository(*shared)
        self.markers = MarkerRepository(*shared)
        self.campaigns = CampaignRepository(*shared)
        self.answers = AnswerRepository(*shared)
        self.tokens = TokenRepository(*shared)
        self.sessions = SessionRepository(*shared)
        self.audit = AuditRepository(*shared)

    def dictionaries(self) -> list[Dictionary]:
        """The dictionaries of monitors and datasets that are not lateral, each once."""
        stored = []
        with reading(self.engine) as connection:
            for table in (monitors, datasets):
                has_own = table.c.dictionary.is_not(None) & table.c.complete
                query = select(table.c.dictionary).where(has_own).order_by(table.c.created.desc())
                stored += connection.execute(query).scalars()
        return list(dict.fromkeys(map(Dictionary.from_plain, stored)))

    def recover(self) -> None:
        """Clean up after a process that died: mark its work interrupted, delete partial content.

        The work of another process that serves the database is left alone. If the database cannot
        be written now, this happens before the next write.
        `app.recordings.files` cleans up recordings, whose content is in folders.
        """
        try:
            with owned(self.engine.url):
                self._recover()
        except Taken as error:
            LOG.warning("work in progress is left alone: %s", error)
        except StoreError as error:
            LOG.warning("the store is read-only for now: %s", error)
            self._writer.unfinished = self._recover

    def _recover(self) -> None:
        for repository in (self.jobs, self.flights, self.monitors, self.datasets):
            repository.recover()

    @contextmanager
    def owned(self) -> Iterator[None]:
        """Serve the database, alone. Taken if another process does."""
        with owned(self.engine.url) as ownership:
            self.ownership = self._writer.ownership = ownership
            try:
                yield
            finally:
                self.ownership = self._writer.ownership = None

    def revision(self) -> str:
        return str(current_revision(self.engine.url))

    def start(self) -> None:
        """Report a database that is older than its last good stop; a server calls this first."""
        try:
            if older := self.last_stop.finding():
                self.last_stop.older = older
                LOG.error("%s", older)
            self.touch()
        except StoreError as error:
            LOG.warning("the database cannot be compared with its last stop: %s", error)

    def stop(self) -> None:
        try:
            self.last_stop.note(self.engine, stopped=True)
        except StoreError as error:
            LOG.warning("the stop was not noted: %s", error)

    def touch(self) -> None:
        """Test writing to the database. StoreError."""
        self._n_noted = self._writer.n_turns
        self.last_stop.note(self.engine)

    @property
    def has_written(self) -> bool:
        """Whether anything was written since the last `touch`."""
        return self._n_noted != self._writer.n_turns

    def damage(self) -> list[str]:
        """Check the whole database; one line per fault."""
        return check_pages(self.engine)

    def close(self) -> None:
        """Close idle connections; the store remains usable and opens new ones."""
        self.engine.dispose()


def open_store(url_or_path: str | Path, *, recover: bool = True) -> Store:
    """Open the store, creating it if missing and upgrading it if an older program made it.

    recover: mark running work as interrupted and delete partial content, unless another process
    serves the database. False only to read.
    StoreError if it cannot be used; a database from a newer program is left unchanged.
    """
    url = address(url_or_path)
    if recover:
        Reserve(url).free()
    bring_up_to_date(url)
    store = Store(make_engine(url))
    if recover:
        store.recover()
    return store


def served_store(url: str | Path) -> Store | None:
    """The store of another process, to read while that serves it; None if there is none yet."""
    engine = read_only_engine(address(url))
    return None if engine is None else Store(engine)


class StoreHealth:
    """Whether the store works, as of the newest check.

    fault: one sentence; empty if the store works.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._check: asyncio.Future[str] | None = None
        self.fault = ""

    async def check(self) -> str:
        """Check now and return the fault; a store that hangs is checked only once."""
        if self._check is None or self._check.done():
            self._check = asyncio.ensure_future(asyncio.to_thread(_fault_of, self._store))
        try:
            self.fault = await asyncio.wait_for(asyncio.shield(self._check), ANSWER_S)
        except TimeoutError:
            self.fault = f"the store has not answered for {ANSWER_S:g} s: check its disk"
        return self.fault

    async def repeat(self, is_needed: Callable[[], bool]) -> None:
        """Check every CHECK_S while `is_needed()` or after a write; never returns.

        A database whose lock can be lost is checked always.
        """
        while True:
            await asyncio.sleep(CHECK_S)
            ownership = self._store.ownership
            can_be_lost = ownership is not None and ownership.can_be_lost
            if is_needed() or can_be_lost or self._store.has_written:
                await self.check()


def _fault_of(store: Store) -> str:
    if store.ownership is not None and (fault := store.ownership.check()):
        return fault
    try:
        store.jobs.all()
    except Exception:
        return "the store cannot be read: see the log for the reason"
    try:
        store.touch()
    except Exception:
        return "the store cannot be written: check that its disk has space and allows writing"
    return ""
