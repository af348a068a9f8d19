"""Integrity of the stored data.

A background check reads every page, digest and sample once after the start of the server, slowly
enough not to disturb flights. Damage is reported; readers check again and never serve damaged data.
"""

import logging
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

from app.recordings.files import Elsewhere, RecordingFiles, digest_of
from app.recordings.flown_journal import journal_damage
from app.recordings.samples import open_samples, open_tiles
from app.store.database import Damaged, Interrupted, check_pages
from app.store.recordings import RecordingInfo
from app.store.repository import Entry
from app.store.store import NotFound, Store, StoreError, open_store
from app.telemetry.journal import ENDING, Journals
from app.upkeep.archive import JOURNALS, RECORDINGS

LOG = logging.getLogger("forewarn")
BEGIN_AFTER_S = 5.0
"""Start of the background check [s] after the server's, so that first pages load quickly."""
PIECE_S = 0.01
"""Work between two rests [s]."""
REST = 4.0
"""Rest after work, in units of its duration: this uses a fifth of one processor."""
ID = re.compile(r"[0-9a-f]{12}")
Kind = Literal["database", "monitor", "dataset", "recording", "scoring", "flight"]
State = Literal["begun", "checking", "checked", "stopped"]


@dataclass(frozen=True)
class Damage(Entry):
    """A damaged item of the store; it is not served."""

    kind: Kind
    id: str
    """empty for the database itself"""
    name: str
    detail: str
    """what is wrong and what to do"""

    def __str__(self) -> str:
        return f"{self.kind} {self.name}: {self.detail}" if self.id else self.detail


@dataclass(frozen=True)
class Item:
    """A stored item; `check` raises StoreError if it is damaged."""

    kind: Kind
    id: str
    name: str
    check: Callable[[], object]

    def damage(self) -> Damage | Elsewhere | None:
        """None if the item is intact or was deleted meanwhile."""
        try:
            self.check()
        except NotFound:
            return None
        except Elsewhere as error:
            return error
        except StoreError as error:
            return Damage(self.kind, self.id, self.name, str(error))
        return None


class Inventory(NamedTuple):
    """Contents of a store.

    numbers: intact items by kind.   damaged: a sentence for each damaged one, or one that lies in
    another data directory.   unverified: flights without a digest.
    """

    numbers: Counter[str]
    damaged: list[str]
    unverified: set[str]


def inventory_of(url: str, data_dir: Path) -> Inventory:
    """Check every item of a store that no server has open. StoreError."""
    files, journals = RecordingFiles(data_dir / RECORDINGS), Journals(data_dir / JOURNALS)
    numbers, damaged, unverified = Counter[str](), list[str](), set[str]()
    with closing(open_store(url, recover=False)) as store:
        for item in all_items(store, files, journals, unverified):
            if (damage := item.damage()) is None:
                numbers[item.kind] += 1
            else:
                damaged.append(str(damage))
    return Inventory(numbers, damaged, unverified)


class Stopped(Exception):
    """The server is stopping."""


class Pace:
    """Work in pieces with rests, until it is stopped."""

    def __init__(self) -> None:
        self.stopped = threading.Event()
        self._since = time.perf_counter()

    def rest(self) -> None:
        """Rest after a piece of work. Stopped."""
        worked = time.perf_counter() - self._since
        if worked >= PIECE_S:
            self.stopped.wait(worked * REST)
            self._since = time.perf_counter()
        if self.stopped.is_set():
            raise Stopped


def all_items(
    store: Store,
    files: RecordingFiles,
    journals: Journals,
    unverified: set[str],
    rest: Callable[[], None] = lambda: None,
) -> Iterator[Item]:
    """All stored items except database pages.

    unverified: receives the ids of flights without a digest of their samples or journal.
    rest: called between pieces of work.
    """
    for monitor in store.monitors.all():
        yield Item("monitor", monitor.id, monitor.name, partial(store.monitors.file, monitor.id))
    digest = partial(digest_of, rest=rest)
    for recording in store.recordings.all():
        check = partial(_check_recording, files, recording, digest)
        yield Item("recording", recording.id, recording.name, check)
        for scoring_id in sorted(store.scorings.ids(recording.id)):
            check = partial(_check_scoring, store, files, recording.id, scoring_id, rest)
            yield Item("scoring", scoring_id, f"of {recording.name}", check)
    for flight in store.flights.all():
        check = partial(_check_flight, store, journals, flight.id, unverified, digest, rest)
        yield Item("flight", flight.id, f"of {flight.created[:19]}Z", check)
    for dataset in store.datasets.all():
        yield Item("dataset", dataset.id, dataset.name, partial(store.datasets.get, dataset.id))


def _check_flight(
    store: Store,
    journals: Journals,
    flight_id: str,
    unverified: set[str],
    digest: Callable[[Path], str],
    rest: Callable[[], None],
) -> None:
    if not store.flights.check(flight_id, rest):
        unverified.add(flight_id)
    info = store.flights.info(flight_id)
    if info.source.get("kind") != "live" or info.status == "running":
        return
    path = journals.path(flight_id)
    if info.journal_digest is None:
        unverified.add(flight_id)
    damage = journal_damage(info, digest(path) if path.exists() else None)
    if not damage or store.flights.info(flight_id) != info:  # resumed since
        return
    if not journals.root.is_dir():
        raise Elsewhere(
            f"{path} is missing: the journal is stored in another data directory; start the server "
            "with that one, or restore it from a backup"
        )
    raise Damaged(f"{damage}: {path}; restore the data directory from a backup")


def _check_recording(
    files: RecordingFiles, info: RecordingInfo, digest: Callable[[Path], str]
) -> None:
    with files.present(info.id):
        files.check(info.id, info.digest, digest)


def _check_scoring(
    store: Store,
    files: RecordingFiles,
    recording_id: str,
    scoring_id: str,
    rest: Callable[[], None],
) -> None:
    info = store.scorings.info(recording_id, scoring_id)
    folder = files.scorings(recording_id)
    with files.present(recording_id):
        open_samples(folder, scoring_id, info.digest, files.verified, rest)
        open_tiles(folder, scoring_id, info.digest, files.verified)


class Integrity:
    """The integrity check of a server's data; `stop` ends the background check."""

    def __init__(self, store: Store, files: RecordingFiles, journals: Journals) -> None:
        self.store, self.files, self.journals = store, files, journals
        self.state: State = "begun"
        self.n_checked = 0
        self.unverified: set[str] = set()
        """ids of flights without a digest of their samples or journal"""
        self._elsewhere: set[str] = set()
        self._unlisted: set[str] = set()
        self._pace = Pace()
        self._known_damage: dict[tuple[Kind, str, str], Damage] = {}
        self._thread = threading.Thread(target=self._run, name="integrity", daemon=True)

    @property
    def n_damaged(self) -> int:
        return len(self._known_damage)

    def damaged(self) -> list[Damage]:
        """Damaged items, without those deleted since."""
        for key, damage in list(self._known_damage.items()):
            if not self._is_there(damage):
                self._known_damage.pop(key, None)
        return list(self._known_damage.values())

    def n_elsewhere(self) -> int:
        """Number of recordings and journals in another data directory, without those deleted."""
        if self._elsewhere:
            self._elsewhere &= self._listed()
        return len(self._elsewhere)

    def n_unlisted(self) -> int:
        """Number of recordings and journals of this data directory that the database lacks."""
        if self._unlisted:
            self._unlisted &= self._ids_of_files() - self._listed()
        return len(self._unlisted)

    def _find_unlisted(self) -> None:
        self._unlisted = self._ids_of_files() - self._listed()
        if self.n_unlisted():  # those of an upload that has just ended are listed by now
            LOG.warning(
                "%s: the database does not list the files of %s there: serve it with the database "
                "that does, or delete them",
                self.files.root.parent,
                ", ".join(sorted(self._unlisted)),
            )

    def _listed(self) -> set[str]:
        return {info.id for info in (*self.store.recordings.all(), *self.store.flights.all())}

    def _ids_of_files(self) -> set[str]:
        folders = {path.name for path in self.files.root.glob("*") if path.is_dir()}
        journals = {path.stem for path in self.journals.root.glob(f"*{ENDING}")}
        return {name for name in folders | journals if ID.fullmatch(name)}

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._pace.stopped.set()
        if self._thread.is_alive():
            self._thread.join()

    def check_all(self) -> None:
        """Check every page and every listed item. Stopped; StoreError."""
        pace = self._pace
        lines = check_pages(self.store.engine, pace.stopped, pace.rest)
        self._note_pages(lines)
        self.n_checked = 0
        try:
            self._find_unlisted()
            about = self.store, self.files, self.journals, self.unverified
            for item in all_items(*about, pace.rest):
                damage = item.damage()
                if isinstance(damage, Damage):
                    self._note(damage)
                elif damage and item.kind in ("recording", "flight"):
                    LOG.error("%s: %s", item.name, damage)
                    self._elsewhere.add(item.id)
                self.n_checked += 1
                pace.rest()
        except Damaged as error:
            self._note_pages([] if lines else [str(error)])

    def _run(self) -> None:
        if self._pace.stopped.wait(BEGIN_AFTER_S):
            self.state = "stopped"
            return
        self.state = "checking"
        try:
            self.check_all()
            self.state = "checked"
        except (Stopped, Interrupted):
            self.state = "stopped"
        except Exception:
            LOG.exception("the integrity check failed")
            self.state = "stopped"

    def _note_pages(self, lines: list[str]) -> None:
        for line in lines:
            detail = f"the database is damaged ({line}): restore a backup"
            self._note(Damage("database", "", "", detail))

    def _note(self, damage: Damage) -> None:
        key = damage.kind, damage.id, "" if damage.id else damage.detail
        if key not in self._known_damage:
            LOG.error("damaged: %s", damage)
        self._known_damage[key] = damage

    def _is_there(self, damage: Damage) -> bool:
        if damage.kind == "database":
            return True
        try:
            if damage.kind == "scoring":
                return damage.id in self.store.scorings.ids()
            getattr(self.store, f"{damage.kind}s").info(damage.id)
        except NotFound:
            return False
        except StoreError:
            return True
        return True
