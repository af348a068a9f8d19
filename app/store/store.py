"""The store: datasets, monitors, jobs, flights, recordings in one database, by URL or path.

Every method is synchronous and may be called from any thread; a coroutine calls it through
`asyncio.to_thread`. Only this module and its `stored_*` parts know both rows and core objects.
"""

from pathlib import Path

from sqlalchemy import delete

from app.store.database import StoreError, address, damage, make_engine
from app.store.datasets import StoredDatasets
from app.store.flights import StoredFlights, interrupt_flights
from app.store.jobs import StoredJobs, interrupt_jobs
from app.store.monitors import StoredMonitors
from app.store.recordings import StoredRecordings
from app.store.repository import InUse, NotFound
from app.store.schema import bring_up_to_date, current_revision
from app.store.scorings import StoredScorings
from app.store.tables import datasets, monitors

__all__ = ["InUse", "NotFound", "Store", "StoreError", "open_store"]


class Store(
    StoredDatasets, StoredMonitors, StoredJobs, StoredFlights, StoredRecordings, StoredScorings
):
    """All that is kept. Open it with `open_store`."""

    def recover(self) -> None:
        """Clear up after a process that died: interrupted work, half-stored content.

        Recordings, whose content lies in folders, are cleared up by `app.recordings.files`.
        """
        with self._writing() as connection:
            interrupt_jobs(connection)
            interrupt_flights(connection)
            for table in (monitors, datasets):
                connection.execute(delete(table).where(~table.c.complete))

    def revision(self) -> str:
        """Revision of the schema."""
        return str(current_revision(self.engine.url))

    def damage(self) -> list[str]:
        """Look through the whole database; one line for each thing that is wrong with it."""
        return damage(self.engine)

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
    bring_up_to_date(url)
    store = Store(make_engine(url))
    if recover:
        store.recover()
    return store
