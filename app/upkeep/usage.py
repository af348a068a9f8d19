"""The disk that what is stored takes, and what is left of it."""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from app.live.journal import Journals
from app.recordings.files import SPARE_BYTES
from app.recordings.recordings import Recordings
from app.store.database import file_of
from app.upkeep.retention import Retained, everything

SHORT_BYTES = 8 * SPARE_BYTES
"""Less is short: 256 MiB before the disk is full no upload is taken any more."""
MOST_LISTED = 10


@dataclass(frozen=True)
class DiskSpace:
    """Of the disk that the data lie on [bytes]. warning: empty where there is enough."""

    total: int
    free: int
    warning: str


@dataclass(frozen=True)
class KindUsage:
    """What all of a kind take [bytes]. oldest: UTC, ISO 8601; null where there is none."""

    kind: str
    n: int
    n_kept: int
    size: int
    oldest: str | None


@dataclass(frozen=True)
class StorageUsage:
    """What is stored takes so much [bytes].

    database: SQLite's file and its log; null for another database.   reusable: of that, what was
    deleted and is used again before the file grows.   journals: of live flights, in whose size they
    are; not of one that is a recording, which takes it.   largest, oldest: flights and recordings.
    """

    space: DiskSpace
    database: int | None
    reusable: int | None
    recordings: int
    journals: int
    kinds: list[KindUsage]
    largest: list[Retained]
    oldest: list[Retained]


def space_of(data_dir: Path) -> DiskSpace:
    """How much the disk of the data has left."""
    disk = shutil.disk_usage(data_dir)
    words = (
        f"the disk of the data directory has {disk.free / 10**9:.2f} GB left: below "
        f"{SPARE_BYTES / 10**9:.2f} GB no recording is taken, and a full disk records no flight; "
        "delete flights or recordings, or choose a larger disk"
    )
    return DiskSpace(disk.total, disk.free, words if disk.free < SHORT_BYTES else "")


def usage_of(recordings: Recordings, journals: Journals, data_dir: Path) -> StorageUsage:
    """What everything takes. StoreError."""
    store, there = recordings.store, everything(recordings, journals)
    sizes = store.keeping.sizes()
    kinds = [
        _kind("flight", [one for one in there if one.kind == "flight"]),
        _kind("recording", [one for one in there if one.kind == "recording"]),
    ]
    for kind, infos in (("dataset", store.datasets.all()), ("monitor", store.monitors.all())):
        size = sum(sizes[f"{kind}s"].get(info.id, 0) for info in infos)
        oldest = min((info.created for info in infos), default=None)
        kinds.append(KindUsage(kind, len(infos), 0, size, oldest))
    database = file_of(store.engine.url)
    return StorageUsage(
        space=space_of(data_dir),
        database=None if database is None else _size(database),
        reusable=store.keeping.reusable(),
        recordings=kinds[1].size,
        journals=sum(journals.size(info.id) for info in store.flights.all()),
        kinds=kinds,
        largest=sorted(there, key=lambda one: -one.size)[:MOST_LISTED],
        oldest=sorted(there, key=lambda one: one.since)[:MOST_LISTED],
    )


def _kind(kind: str, there: list[Retained]) -> KindUsage:
    return KindUsage(
        kind,
        len(there),
        sum(one.keep for one in there),
        sum(one.size for one in there),
        min((one.since for one in there), default=None),
    )


def _size(database: Path) -> int:
    files: Iterable[Path] = (database, database.with_name(f"{database.name}-wal"))
    return sum(path.stat().st_size for path in files if path.exists())
