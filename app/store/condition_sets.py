"""Stored limit sets and monitor sets, by flight condition: neither changes, and flights use them.

A limit set has versions, of which one is in force at a time; a monitor set has none.
"""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Select, delete, func, insert, select

from app.store.monitors import MonitorInfo
from app.store.repository import Entries, Entry, InUse, Repository, Time, columns, fetch, require
from app.store.tables import (
    flight_limits,
    flight_monitor_sets,
    flights,
    limit_set_versions,
    limit_sets,
    monitor_set_cases,
    monitor_sets,
    monitors,
    new_id,
    now,
)
from core.conditions import ConditionKey, Range, ranges_from_plain
from core.flight_events import FlightLimits
from core.limits.limit_sets import LimitSet, limit_set_from_plain, limit_set_to_plain
from core.monitor.monitor_set import MonitorSet


@dataclass(frozen=True)
class LimitSetInfo(Entry):
    """A limit set, independent of its versions."""

    id: str
    name: str
    created: Time
    newest: int
    """newest version: 1, 2, ..."""


@dataclass(frozen=True)
class StoredLimits(Entry):
    """A version of a limit set, which never changes."""

    limit_set: str
    """id"""
    name: str
    """of the set"""
    version: int
    """1, 2, ... in order of creation"""
    created: Time
    by: str
    """person who made it"""
    text: str | None
    """why"""
    cases: list[dict[str, Any]]
    """flight conditions, each with name, ranges and limits"""

    @property
    def limits(self) -> LimitSet:
        return limit_set_from_plain(self.cases)


class LimitSetRepository(Entries[LimitSetInfo]):
    """Limit sets by id, their versions by number."""

    table, entry = limit_sets, LimitSetInfo

    def add(self, name: str, limits: LimitSet, by: str, text: str | None = None) -> StoredLimits:
        """Store a limit set with its first version."""
        set_id = new_id()
        with self._writing() as connection:
            row = {"id": set_id, "name": name, "created": now()}
            connection.execute(insert(limit_sets).values(**row))
            _add_version(connection, set_id, 1, limits, by, text)
            return _version(connection, set_id, 1)

    def add_version(
        self, set_id: str, limits: LimitSet, by: str, text: str | None = None
    ) -> StoredLimits:
        with self._writing() as connection:
            newest = self._fetch(connection, set_id).newest
            _add_version(connection, set_id, newest + 1, limits, by, text)
            return _version(connection, set_id, newest + 1)

    def versions(self, set_id: str) -> list[StoredLimits]:
        """All versions of a set, newest first."""
        with self._reading() as connection:
            newest = self._fetch(connection, set_id).newest
            return [_version(connection, set_id, n) for n in range(newest, 0, -1)]

    def version(self, set_id: str, version: int | None = None) -> StoredLimits:
        """A version of a set; the newest if None."""
        with self._reading() as connection:
            newest = self._fetch(connection, set_id).newest
            return _version(connection, set_id, newest if version is None else version)

    def note(self, flight_id: str, limits: FlightLimits) -> None:
        """Store limits put in force; those already stored under this number are left unchanged."""
        self._add_numbered(flight_limits, flight_id, limits, limit_set_id=limits.limit_set)

    def of_flights(self, flight_ids: Iterable[str]) -> dict[str, list[FlightLimits]]:
        """Limits put in force during flights, in order; flights without any are absent."""
        limits = flight_limits.c
        named = limit_sets.c.name, limits.limit_set_id.label("limit_set"), limits.flight_id
        query = select(*columns(flight_limits, FlightLimits), *named).join(limit_sets)
        by_flight = self._by_flight(query.order_by(limits.number), flight_ids)
        return {
            key: [FlightLimits(**{k: row[k] for k in row if k != "flight_id"}) for row in rows]
            for key, rows in by_flight.items()
        }

    def _query(self) -> Select:
        of_set = limit_set_versions.c.limit_set_id == limit_sets.c.id
        newest = select(func.max(limit_set_versions.c.version)).where(of_set).scalar_subquery()
        return select(*columns(limit_sets, LimitSetInfo), newest.label("newest"))


def _version(connection: Connection, set_id: str, version: int) -> StoredLimits:
    versions = limit_set_versions.c
    named = versions.limit_set_id.label("limit_set"), limit_sets.c.name
    query = select(*columns(limit_set_versions, StoredLimits), *named).join(limit_sets)
    query = query.where(versions.limit_set_id == set_id, versions.version == version)
    row = fetch(connection, query, f"version {version} of limit set", set_id)
    return StoredLimits(**row._mapping)


def _add_version(
    connection: Connection, set_id: str, version: int, limits: LimitSet, by: str, text: str | None
) -> None:
    row = {"limit_set_id": set_id, "version": version, "created": now(), "by": by, "text": text}
    row["cases"] = limit_set_to_plain(limits)
    connection.execute(insert(limit_set_versions).values(**row))


@dataclass(frozen=True)
class StoredCase(Entry):
    """A flight condition and its monitor."""

    name: str
    ranges: dict[ConditionKey, Range]
    """from the first number to below the second, in SI units; null for no bound"""
    monitor: str
    """id"""
    monitor_name: str


@dataclass(frozen=True)
class MonitorSetInfo(Entry):
    """Monitors of one test by flight condition."""

    id: str
    name: str
    created: Time
    by: str
    """person who made it"""
    text: str | None
    """why"""
    cases: list[StoredCase]


@dataclass(frozen=True)
class FlownSet:
    """A flight's monitor set. fixed: declared values of the flight condition."""

    info: MonitorSetInfo
    fixed: dict[ConditionKey, float]


class MonitorSetRepository(Repository):
    """Monitor sets by id."""

    def all(self) -> list[MonitorSetInfo]:
        """All sets, newest first."""
        with self._reading() as connection:
            return _sets(connection)

    def info(self, set_id: str) -> MonitorSetInfo:
        with self._reading() as connection:
            return _set(connection, set_id)

    def add(
        self, name: str, monitor_set: MonitorSet[MonitorInfo], by: str, text: str | None = None
    ) -> MonitorSetInfo:
        """ValueError for the name of another set."""
        row = {"id": new_id(), "name": name, "created": now(), "by": by, "text": text}
        with self._writing() as connection:
            same_name = select(monitor_sets.c.id).where(monitor_sets.c.name == name)
            if (other := connection.execute(same_name).scalars().first()) is not None:
                raise ValueError(
                    f"monitor set {other} is called {name!r} too: give this one another name"
                )
            connection.execute(insert(monitor_sets).values(**row))
            for position, case in enumerate(monitor_set.cases):
                part = {"monitor_set_id": row["id"], "position": position, "name": case.name}
                part |= {"ranges": dict(case.ranges), "monitor_id": case.monitor.id}
                connection.execute(insert(monitor_set_cases).values(**part))
            return _set(connection, row["id"])

    def delete(self, set_id: str) -> None:
        """InUse if flights use it."""
        using = select(flights.c.id, flights.c.status).join(flight_monitor_sets)
        using = using.where(flight_monitor_sets.c.monitor_set_id == set_id)
        with self._deleting() as connection:
            name = _set(connection, set_id).name
            if rows := connection.execute(using.order_by(flights.c.created)).all():
                users = [(f"{row.status} flight", row.id) for row in rows]
                raise InUse(f"monitor set {name}", users)
            connection.execute(delete(monitor_sets).where(monitor_sets.c.id == set_id))

    def of_flights(self, flight_ids: Iterable[str]) -> dict[str, FlownSet]:
        """The monitor sets of flights by flight id; flights without one are absent."""
        by_flight = self._by_flight(select(flight_monitor_sets), flight_ids)
        wanted = {row["monitor_set_id"] for rows in by_flight.values() for row in rows}
        infos = {info.id: info for info in self.all() if info.id in wanted} if wanted else {}
        return {
            key: FlownSet(infos[row["monitor_set_id"]], row["fixed"])
            for key, (row,) in by_flight.items()
        }


def _set(connection: Connection, set_id: str) -> MonitorSetInfo:
    require(connection, monitor_sets, set_id)
    return _sets(connection, set_id)[0]


def _sets(connection: Connection, set_id: str | None = None) -> list[MonitorSetInfo]:
    """All sets, newest first, or one of them."""
    query = select(monitor_sets).order_by(monitor_sets.c.created.desc())
    parts = monitor_set_cases.c
    of_cases = select(monitor_set_cases, monitors.c.name.label("monitor_name")).join(monitors)
    if set_id is not None:
        query = query.where(monitor_sets.c.id == set_id)
        of_cases = of_cases.where(parts.monitor_set_id == set_id)
    cases = defaultdict[str, list[StoredCase]](list)
    for row in connection.execute(of_cases.order_by(parts.position)):
        case = StoredCase(row.name, ranges_from_plain(row.ranges), row.monitor_id, row.monitor_name)
        cases[row.monitor_set_id].append(case)
    rows = connection.execute(query)
    return [MonitorSetInfo(**row._mapping, cases=cases[row.id]) for row in rows]
