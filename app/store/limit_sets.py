"""Stored limit sets: versions that never change, and which of them flights were held against."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import Connection, func, insert, select

from app.store.flights import fetch_flight
from app.store.repository import Entry, Repository, columns, fetch
from app.store.tables import flight_limits, limit_set_versions, limit_sets, new_id, now
from core.limit_set import LimitSet, limit_set_from_plain, limit_set_to_plain


@dataclass(frozen=True)
class LimitSetInfo(Entry):
    """A limit set, whatever its version."""

    id: str
    name: str
    created: str
    """UTC, ISO 8601"""
    newest: int
    """number of its newest version: 1, 2, ..."""


@dataclass(frozen=True)
class StoredLimits(Entry):
    """A version of a limit set, as it was stored for ever."""

    limit_set: str
    """id"""
    name: str
    """of the set"""
    version: int
    """1, 2, ... in the order they were made"""
    created: str
    """UTC, ISO 8601"""
    by: str
    """who made it"""
    text: str | None
    """why"""
    cases: list[dict[str, Any]]
    """flight conditions, each with its name, ranges and limits"""

    @property
    def limits(self) -> LimitSet:
        """What it says."""
        return limit_set_from_plain(self.cases)


@dataclass(frozen=True)
class FlightLimits(Entry):
    """A version of a limit set that was put in force during a flight."""

    number: int
    """1, 2, ... in its flight"""
    limit_set: str
    """id"""
    name: str
    """of the set"""
    version: int
    fixed: dict[str, float]
    """values of flight conditions that were declared"""
    seq: int
    """first sample number that it held for"""
    t: float
    """time of the sample before [s]; 0 before the first"""
    created: str
    """UTC, ISO 8601"""
    by: str
    """who put it in force"""


class LimitSetRepository(Repository):
    """Limit sets by id, and their versions by number."""

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
        """Store the next version of a set. NotFound."""
        with self._writing() as connection:
            newest = _info(connection, set_id).newest
            _add_version(connection, set_id, newest + 1, limits, by, text)
            return _version(connection, set_id, newest + 1)

    def all(self) -> list[LimitSetInfo]:
        """All limit sets, newest first."""
        with self._reading() as connection:
            rows = connection.execute(_sets().order_by(limit_sets.c.created.desc()))
            return [LimitSetInfo(**row._mapping) for row in rows]

    def versions(self, set_id: str) -> list[StoredLimits]:
        """All versions of a set, newest first. NotFound."""
        with self._reading() as connection:
            newest = _info(connection, set_id).newest
            return [_version(connection, set_id, n) for n in range(newest, 0, -1)]

    def version(self, set_id: str, version: int | None = None) -> StoredLimits:
        """A version of a set, the newest if None. NotFound."""
        with self._reading() as connection:
            newest = _info(connection, set_id).newest
            return _version(connection, set_id, newest if version is None else version)

    def note(self, flight_id: str, put: FlightLimits) -> None:
        """Store what was put in force; of two of one number the first stays. NotFound."""
        own = flight_limits.c
        same = select(own.number).where(own.flight_id == flight_id, own.number == put.number)
        with self._writing() as connection:
            fetch_flight(connection, flight_id)
            _info(connection, put.limit_set)
            if connection.execute(same).first() is None:
                row = asdict(put) | {"flight_id": flight_id, "limit_set_id": put.limit_set}
                del row["limit_set"], row["name"]
                connection.execute(insert(flight_limits).values(**row))

    def of_flights(self, flight_ids: Iterable[str]) -> dict[str, list[FlightLimits]]:
        """What was put in force during flights, in order, of those that had any."""
        wanted, own = set(flight_ids), flight_limits.c
        named = limit_sets.c.name, own.limit_set_id.label("limit_set"), own.flight_id
        query = select(*columns(flight_limits, FlightLimits), *named).join(limit_sets)
        found: dict[str, list[FlightLimits]] = {}
        with self._reading() as connection:
            for row in connection.execute(query.order_by(own.number)):
                values = dict(row._mapping)
                if (flight_id := values.pop("flight_id")) in wanted:
                    found.setdefault(flight_id, []).append(FlightLimits(**values))
        return found


def _sets() -> Any:
    of_set = limit_set_versions.c.limit_set_id == limit_sets.c.id
    newest = select(func.max(limit_set_versions.c.version)).where(of_set).scalar_subquery()
    return select(*columns(limit_sets, LimitSetInfo), newest.label("newest"))


def _info(connection: Connection, set_id: str) -> LimitSetInfo:
    query = _sets().where(limit_sets.c.id == set_id)
    return LimitSetInfo(**fetch(connection, query, "limit set", set_id)._mapping)


def _version(connection: Connection, set_id: str, version: int) -> StoredLimits:
    own = limit_set_versions.c
    named = own.limit_set_id.label("limit_set"), limit_sets.c.name
    query = select(*columns(limit_set_versions, StoredLimits), *named).join(limit_sets)
    query = query.where(own.limit_set_id == set_id, own.version == version)
    row = fetch(connection, query, f"version {version} of limit set", set_id)
    return StoredLimits(**row._mapping)


def _add_version(
    connection: Connection, set_id: str, version: int, limits: LimitSet, by: str, text: str | None
) -> None:
    row = {"limit_set_id": set_id, "version": version, "created": now(), "by": by, "text": text}
    row["cases"] = limit_set_to_plain(limits)
    connection.execute(insert(limit_set_versions).values(**row))
