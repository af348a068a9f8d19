"""The audit log: who changed what, and when. Rows are added and read, never changed."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

from sqlalchemy import ColumnElement, insert, select

from app.store.repository import Entry, Repository, columns
from app.store.tables import audit

READ_AT_ONCE = 1000


@dataclass(frozen=True)
class AuditEntry(Entry):
    """A change, a login, or an attempt refused because of the role."""

    time: str
    """of the answer, UTC, ISO 8601"""
    who: str
    """person's name; `server` for the token in the settings, `local` without authentication"""
    role: str
    address: str
    """client address"""
    method: str
    """HTTP method; `WEBSOCKET` for a WebSocket that sends"""
    path: str
    status: int
    """of the answer; 403: refused because of the role"""


class AuditRepository(Repository):
    """Entries in the order they were written."""

    def add(self, entries: Sequence[AuditEntry]) -> None:
        with self._writing() as connection:
            connection.execute(insert(audit), [asdict(entry) for entry in entries])

    def read(
        self, since: str | None = None, until: str | None = None, who: str | None = None
    ) -> Iterator[AuditEntry]:
        """Entries with since <= time < until (UTC, ISO 8601), of a person if given."""
        conditions: list[ColumnElement[bool]] = []
        if since is not None:
            conditions.append(audit.c.time >= since)
        if until is not None:
            conditions.append(audit.c.time < until)
        if who is not None:
            conditions.append(audit.c.who == who)
        last = 0
        while True:
            query = select(*columns(audit, AuditEntry), audit.c.id)
            query = query.where(audit.c.id > last, *conditions).order_by(audit.c.id)
            with self._reading() as connection:
                rows = connection.execute(query.limit(READ_AT_ONCE)).all()
            for row in rows:
                stored = dict(row._mapping)
                last = stored.pop("id")
                yield AuditEntry(**stored)
            if len(rows) < READ_AT_ONCE:
                return
