"""Follows the live flights of the server that owns the database, to take them over at once.

The flights are replayed from their journals while these grow, so at the take-over only the newest
lines are left. A flight that cannot be followed is replayed from its start then.
"""

import logging
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from app.flights.clock import Clock, MonotonicClock
from app.flights.flight_recordings import RESUMED_WITHIN_S
from app.flights.flight_records import source_of
from app.flights.preparation import Preparation
from app.flights.recorder import Recorder
from app.flights.sources.live import LiveFlight, LiveSetup
from app.flights.sources.source import header_of
from app.flights.sources.udp import UdpAccess
from app.store.flights import FlightInfo
from app.store.store import Store, StoreError, served_store
from app.telemetry.journal import JournalReader, Journals

LOG = logging.getLogger("forewarn")
EVERY_S = 0.5
"""[s] How often the journals are read."""
END_S = 1.0
"""[s] A database that does not answer delays a take-over no longer."""


class Followed(NamedTuple):
    """A flight up to the newest line that was read of its journal."""

    flight: LiveFlight
    setup: LiveSetup
    reader: JournalReader

    def is_continued_by(self, info: FlightInfo) -> bool:
        """Whether journal and record still hold what was read. OSError."""
        return self.flight.head <= stored_head(info) and self.reader.is_continued()


def stored_head(info: FlightInfo) -> int:
    """Newest sample of the record; -1 before the first."""
    return -1 if info.head is None else info.head


class Follower:
    """Follows the flights of a database, in a separate thread; only reads."""

    def __init__(self, url: str | Path, journals: Journals, clock: Clock | None = None) -> None:
        self._url, self._journals, self._clock = url, journals, clock or MonotonicClock()
        self._followed: dict[str, Followed | None] = {}
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        if self._thread is None:
            self._thread = threading.Thread(target=self._follow, name="following", daemon=True)
            self._thread.start()

    def end(self) -> Mapping[str, Followed]:
        """Follow no longer; the flights by id."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join(END_S)
            if self._thread.is_alive():
                return {}
        return {key: followed for key, followed in self._followed.items() if followed is not None}

    def _follow(self) -> None:
        store = None
        while not self._ending.wait(EVERY_S):
            try:
                store = store or served_store(self._url)
                if store is not None:
                    self.read(store)
            except StoreError:  # its owner may still create or upgrade it
                continue
        if store is not None:
            store.close()

    def read(self, store: Store) -> None:
        """Replay what the journals of the unfinished flights hold by now."""
        flights = {info.id: info for info in unfinished(store, self._journals)}
        self._followed = {key: self._followed[key] for key in flights if key in self._followed}
        for flight_id, info in flights.items():
            try:
                self._read(store, info)
            except StoreError:
                continue  # it is followed once its monitor can be loaded
            except Exception:
                LOG.exception("flight %s is replayed from its start at a take-over", flight_id)
                self._followed[flight_id] = None

    def _read(self, store: Store, info: FlightInfo) -> None:
        known = self._followed.get(info.id)
        if info.id in self._followed and known is None:
            return
        if known is not None and not known.is_continued_by(info):
            known = None
        if known is None:
            if not header_of(path := self._journals.path(info.id)):
                return  # its flight starts
            known = self._followed[info.id] = self._new(store, info, path)
        stored = stored_head(info)
        for line in known.reader.lines():
            known.flight.follow([line], stored)
            if self._ending.is_set():
                return
        known.flight.follow([], stored)

    def _new(self, store: Store, info: FlightInfo, path: Path) -> Followed:
        preparation = Preparation(store, None, self._journals, UdpAccess())
        plan, setup = preparation.resumed(info, self._journals)
        recorder = Recorder(store, info.id, self._clock)
        flight = LiveFlight(plan, setup, recorder, self._clock, _ignore, None)
        flight.is_restoring = True
        return Followed(flight, setup, JournalReader(path))


def _ignore(status: str, reason: str) -> None:
    """A flight that is followed does not end by itself."""


def unfinished(store: Store, journals: Journals) -> list[FlightInfo]:
    """Live flights that are in progress or may be resumed: their journals grew lately."""
    return [
        info
        for info in store.flights.unfinished()
        if source_of(info).get("kind") == "live" and _grew_lately(journals.path(info.id))
    ]


def _grew_lately(path: Path) -> bool:
    try:
        return time.time() - path.stat().st_mtime < RESUMED_WITHIN_S
    except OSError:
        return False
