"""Stored monitor sets, which never change, and the flights that use one."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from sqlalchemy import Connection, delete, insert, select

from app.store.monitors import MonitorInfo
from app.store.repository import Entry, InUse, Repository, Time, require
from app.store.tables import (
    flight_monitor_sets,
    flights,
    monitor_set_cases,
    monitor_sets,
    monitors,
    new_id,
    now,
)
from core.conditions import ConditionKey, Range, ranges_from_plain
from core.monitor.monitor_set import MonitorSet


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
            alike = select(monitor_sets.c.id).where(monitor_sets.c.name == name)
            if (other := connection.execute(alike).scalars().first()) is not None:
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
