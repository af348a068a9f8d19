"""Retention: which flights and recordings go because they are old, or all are too much.

By age goes what ended, or came in, before so many days. By size the oldest go until what is left
takes no more than so much. Never goes what is kept for ever, a flight under way, the recording of a
live flight that is kept, and one that a flight which stays replays: what is referenced stays.
Monitors and datasets are no matter of retention. Space in SQLite's file that a flight leaves is
used again, and the file keeps its size.
"""

import asyncio
import logging
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import inf
from typing import Literal

from app.live.journal import Journals
from app.recordings.recordings import Recordings
from app.store.flights import FlightInfo, UnderWay
from app.store.store import InUse, KeptForEver, NotFound, StoreError
from app.store.tables import time_text

LOG = logging.getLogger("forewarn")
DAY_S, FIRST_AFTER_S = 86_400.0, 600.0
GB = 10**9
RetainedKind = Literal["flight", "recording"]


@dataclass(frozen=True)
class RetentionRule:
    """What goes. older_than: [days].   above: [bytes] that may stay. None: no matter."""

    older_than: float | None = None
    above: int | None = None

    def __bool__(self) -> bool:
        return self.older_than is not None or self.above is not None


def retention_rule(days: float, size_gb: float) -> RetentionRule:
    """The rule of settings, in which 0 says no matter. ValueError for what is no number."""
    for value in (days, size_gb):
        if not 0 <= value < inf:
            raise ValueError(f"{value} was given: age and size are 0 or more")
    return RetentionRule(days or None, int(size_gb * GB) or None)


@dataclass(frozen=True)
class Retained:
    """A flight or a recording as retention sees it. since: UTC, when it ended or came in.

    needed: it is under way or kept for ever, or its flight is.   replays: id of the recording that
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
    """What goes by a rule, the oldest first, and what stays."""

    goes: list[Retained]
    stays: list[Retained]

    @property
    def freed(self) -> int:
        """Bytes of what goes."""
        return sum(one.size for one in self.goes)


def everything(recordings: Recordings, journals: Journals) -> list[Retained]:
    """All flights, with their journals, and recordings."""
    store, files = recordings.store, recordings.files
    sizes, flights = store.keeping.sizes()["flights"], store.flights.all()
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


def choose(all_of_it: Iterable[Retained], rule: RetentionRule, now: datetime) -> Retention:
    """Which of these go by a rule at a time."""
    ordered = sorted(all_of_it, key=lambda one: (one.since, one.kind, one.id))
    by_id = {one.id: one for one in ordered}
    n_replaying = Counter(one.replays for one in ordered if one.replays)
    goes: dict[str, Retained] = {}

    def may_go(one: Retained) -> bool:
        return one.id not in goes and not one.needed and not n_replaying[one.id]

    def go(one: Retained) -> None:
        goes[one.id] = one
        if one.replays:
            n_replaying[one.replays] -= 1

    if rule.older_than is not None:
        before = time_text(now - timedelta(days=rule.older_than))
        for kind in ("flight", "recording"):  # first what refers to the others
            for one in ordered:
                if one.kind == kind and one.since < before and may_go(one):
                    go(one)
    if rule.above is not None:
        left = sum(one.size for one in ordered if one.id not in goes)
        for flown in ordered:
            replayed = by_id.get(flown.replays or "")  # older, and free to go with its last flight
            for one in (flown, replayed):
                if left > rule.above and one is not None and one.size and may_go(one):
                    go(one)
                    left -= one.size
    stays = [one for one in ordered if one.id not in goes]
    return Retention([one for one in ordered if one.id in goes], stays)


def retain(recordings: Recordings, journals: Journals, rule: RetentionRule) -> Retention:
    """Delete what goes by a rule; what someone kept or flies meanwhile stays. StoreError."""
    chosen = choose(everything(recordings, journals), rule, datetime.now(UTC))
    gone = []
    for one in sorted(chosen.goes, key=lambda one: one.kind):  # flights first
        try:
            if one.kind == "flight":
                recordings.store.flights.delete(one.id)
                journals.delete(one.id)
            else:
                recordings.delete(one.id)
        except (KeptForEver, InUse, UnderWay, NotFound) as error:
            LOG.info("retention leaves %s %s: %s", one.kind, one.id, error)
            continue
        LOG.info("retention deleted %s %s (%s, of %s)", one.kind, one.id, one.name, one.since)
        gone.append(one)
    return Retention(gone, [*chosen.stays, *(one for one in chosen.goes if one not in gone)])


async def retain_daily(recordings: Recordings, journals: Journals, rule: RetentionRule) -> None:
    """Delete by a rule once a day, the first time a while after the start; never returns."""
    await asyncio.sleep(FIRST_AFTER_S)
    while True:
        try:
            await asyncio.to_thread(retain, recordings, journals, rule)
        except (StoreError, OSError) as error:
            LOG.warning("retention is tried again tomorrow: %s", error)
        await asyncio.sleep(DAY_S)
