"""Retention: deletes old flights and recordings, by age or by total size.

By age: flights that ended and recordings that were uploaded more than so many days ago. By size:
the oldest, until the rest fits. Never deleted: items kept permanently, running flights, the
recording of a flight kept permanently, and those that a remaining flight replays. Monitors and
datasets are never deleted. SQLite's file keeps its size; freed space inside it is reused.
"""

import asyncio
import logging
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import inf
from typing import Literal

from app.recordings.recordings import Recordings
from app.store.flights import FlightInfo, FlightInProgress
from app.store.store import InUse, KeptPermanently, NotFound, StoreError
from app.store.tables import time_text
from app.telemetry.journal import Journals

LOG = logging.getLogger("forewarn")
DAY_S, FIRST_AFTER_S = 86_400.0, 600.0
GB = 10**9
RetainedKind = Literal["flight", "recording"]


@dataclass(frozen=True)
class RetentionRule:
    """Limits of retention. older_than: age [days].   above: total size allowed [bytes]."""

    older_than: float | None = None
    above: int | None = None

    def __bool__(self) -> bool:
        return self.older_than is not None or self.above is not None


def retention_rule(days: float, size_gb: float) -> RetentionRule:
    """The rule from the settings, in which 0 means no rule. ValueError."""
    for value in (days, size_gb):
        if not 0 <= value < inf:
            raise ValueError(f"{value} was given: give an age and a size of 0 or more")
    return RetentionRule(days or None, int(size_gb * GB) or None)


@dataclass(frozen=True)
class Retained:
    """A flight or recording. since: when it ended or was uploaded, UTC.

    needed: it is running or kept permanently, or its flight is.   replays: id of the recording that
    a flight replays.
    """

    kind: RetainedKind
    id: str
    name: str
    since: str
    size: int
    keep: bool
    needed: bool
    replays: str | None = None


@dataclass(frozen=True)
class Retention:
    """Items that a rule deletes, oldest first, and the others."""

    goes: list[Retained]
    stays: list[Retained]

    @property
    def freed(self) -> int:
        """Bytes freed."""
        return sum(item.size for item in self.goes)


def everything(recordings: Recordings, journals: Journals) -> list[Retained]:
    """All flights, with the size of their journals, and all recordings."""
    store, files = recordings.store, recordings.files
    sizes, flights = store.flights.sizes(), store.flights.all()
    flown = {info.recording for info in flights if info.keep}
    return [_flight(info, sizes.get(info.id, 0) + journals.size(info.id)) for info in flights] + [
        Retained(
            "recording",
            info.id,
            info.name,
            info.created,
            files.size(info.id),
            info.keep,
            info.keep or info.id in flown,
        )
        for info in store.recordings.all()
    ]


def _flight(info: FlightInfo, size: int) -> Retained:
    is_needed = info.keep or info.status == "running"
    name = str(info.source.get("name", info.source.get("kind", "flight")))
    replays = info.source.get("recording")
    since = info.ended or info.created
    return Retained("flight", info.id, name, since, size, info.keep, is_needed, replays)


def choose(items: Iterable[Retained], rule: RetentionRule, now: datetime) -> Retention:
    """Apply a rule at a given time, without deleting."""
    ordered = sorted(items, key=lambda item: (item.since, item.kind, item.id))
    by_id = {item.id: item for item in ordered}
    n_replaying = Counter(item.replays for item in ordered if item.replays)
    goes: dict[str, Retained] = {}

    def may_go(item: Retained) -> bool:
        return item.id not in goes and not item.needed and not n_replaying[item.id]

    def go(item: Retained) -> None:
        goes[item.id] = item
        if item.replays:
            n_replaying[item.replays] -= 1

    if rule.older_than is not None:
        before = time_text(now - timedelta(days=rule.older_than))
        for kind in ("flight", "recording"):  # flights refer to recordings
            for item in ordered:
                if item.kind == kind and item.since < before and may_go(item):
                    go(item)
    if rule.above is not None:
        left = sum(item.size for item in ordered if item.id not in goes)
        for item in ordered:
            replayed = by_id.get(item.replays or "")  # deletable after its last flight
            for candidate in (item, replayed):
                if left > rule.above and candidate and candidate.size and may_go(candidate):
                    go(candidate)
                    left -= candidate.size
    stays = [item for item in ordered if item.id not in goes]
    return Retention([item for item in ordered if item.id in goes], stays)


def retain(recordings: Recordings, journals: Journals, rule: RetentionRule) -> Retention:
    """Delete by a rule, except items kept or flown in the meantime. StoreError."""
    chosen = choose(everything(recordings, journals), rule, datetime.now(UTC))
    deleted = []
    for item in sorted(chosen.goes, key=lambda item: item.kind):  # flights first
        try:
            if item.kind == "flight":
                recordings.store.flights.delete(item.id)
                journals.delete(item.id)
            else:
                recordings.delete(item.id)
        except (KeptPermanently, InUse, FlightInProgress, NotFound) as error:
            LOG.info("retention keeps %s %s: %s", item.kind, item.id, error)
            continue
        LOG.info("retention deleted %s %s (%s, of %s)", item.kind, item.id, item.name, item.since)
        deleted.append(item)
    return Retention(
        deleted, [*chosen.stays, *(item for item in chosen.goes if item not in deleted)]
    )


async def retain_daily(recordings: Recordings, journals: Journals, rule: RetentionRule) -> None:
    """Delete by a rule once a day, first FIRST_AFTER_S after the start; never returns."""
    await asyncio.sleep(FIRST_AFTER_S)
    while True:
        try:
            await asyncio.to_thread(retain, recordings, journals, rule)
        except (StoreError, OSError) as error:
            LOG.warning("retention failed, next attempt in a day: %s", error)
        await asyncio.sleep(DAY_S)
