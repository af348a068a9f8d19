"""Disk usage of the stored data, and free space."""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from app.recordings.files import SPARE_BYTES
from app.recordings.recordings import Recordings
from app.store.database import file_of, reusable_bytes
from app.telemetry.journal import Journals
from app.upkeep.retention import Retained, everything

SHORT_BYTES = 8 * SPARE_BYTES
"""Warn below this: uploads are refused with less than SPARE_BYTES left."""
MOST_LISTED = 10


@dataclass(frozen=True)
class DiskSpace:
    """Disk of the data directory [bytes]. warning: empty if space is sufficient."""

    total: int
    free: int
    warning: str


@dataclass(frozen=True)
class KindUsage:
    """Size of all items of a kind [bytes]. oldest: UTC, ISO 8601; null if there are none."""

    kind: str
    n: int
    n_kept: int
    size: int
    oldest: str | None


@dataclass(frozen=True)
class StorageUsage:
    """Disk usage of the stored data [bytes].

    database: SQLite's file and log; null for other databases.   reusable: free space inside that
    file, used before it grows.   journals: of live flights, included in their size; a journal that
    became a recording counts there instead.   largest, oldest: flights and recordings.
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
    disk = shutil.disk_usage(data_dir)
    warning = (
        f"the disk of the data directory has {disk.free / 10**9:.2f} GB left: below "
        f"{SPARE_BYTES / 10**9:.2f} GB uploads are refused, and on a full disk flights are not "
        "recorded; delete flights or recordings, or use a larger disk"
    )
    return DiskSpace(disk.total, disk.free, warning if disk.free < SHORT_BYTES else "")


def usage_of(recordings: Recordings, journals: Journals, data_dir: Path) -> StorageUsage:
    """Usage of everything stored. StoreError."""
    store, items = recordings.store, everything(recordings, journals)
    kinds = [_kind(kind, items) for kind in ("flight", "recording")]
    for kind, repository in (("dataset", store.datasets), ("monitor", store.monitors)):
        infos, sizes = repository.all(), repository.sizes()
        size = sum(sizes.get(info.id, 0) for info in infos)
        oldest = min((info.created for info in infos), default=None)
        kinds.append(KindUsage(kind, len(infos), 0, size, oldest))
    database = file_of(store.engine.url)
    return StorageUsage(
        space=space_of(data_dir),
        database=None if database is None else _size(database),
        reusable=reusable_bytes(store.engine),
        recordings=kinds[1].size,
        journals=sum(journals.size(info.id) for info in store.flights.all()),
        kinds=kinds,
        largest=sorted(items, key=lambda item: -item.size)[:MOST_LISTED],
        oldest=sorted(items, key=lambda item: item.since)[:MOST_LISTED],
    )


def _kind(kind: str, items: list[Retained]) -> KindUsage:
    items = [item for item in items if item.kind == kind]
    return KindUsage(
        kind,
        len(items),
        sum(item.keep for item in items),
        sum(item.size for item in items),
        min((item.since for item in items), default=None),
    )


def _size(database: Path) -> int:
    files: Iterable[Path] = (database, database.with_name(f"{database.name}-wal"))
    return sum(path.stat().st_size for path in files if path.exists())
