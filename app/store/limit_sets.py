"""Stored limit sets, whose versions never change, and the versions in force during flights."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Select, func, insert, select

from app.store.repository import Entries, Entry, Time, columns, fetch
from app.store.tables import flight_limits, limit_set_versions, limit_sets, new_id, now
from core.flight_events import FlightLimits
from core.limits.limit_sets import LimitSet, limit_set_from_plain, limit_set_to_plain


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
