"""Aircraft of the users' own, drawn in the scenes of a monitor's flights: the files as uploaded."""

import hashlib
from dataclasses import dataclass

from sqlalchemy import delete, func, insert, select

from app.store.repository import Repository, Time, columns, require
from app.store.tables import airframes, monitors, now


@dataclass(frozen=True)
class AirframeInfo:
    """An aircraft that was uploaded for the scenes of a monitor."""

    created: Time
    by: str
    """person who uploaded it"""
    digest: str
    """SHA-256 of the file"""
    size: int
    """[bytes]"""


class AirframeRepository(Repository):
    """At most one for each monitor, deleted with it."""

    def put(self, monitor_id: str, content: bytes, by: str) -> AirframeInfo:
        """Store a file in place of any before. NotFound without such a monitor."""
        info = AirframeInfo(now(), by, hashlib.sha256(content).hexdigest(), len(content))
        row = {"created": info.created, "by": by, "digest": info.digest, "content": content}
        with self._writing() as connection:
            require(connection, monitors, monitor_id)
            connection.execute(delete(airframes).where(airframes.c.monitor_id == monitor_id))
            connection.execute(insert(airframes).values(monitor_id=monitor_id, **row))
        return info

    def info(self, monitor_id: str) -> AirframeInfo | None:
        """NotFound without such a monitor."""
        size = func.length(airframes.c.content).label("size")
        query = select(*columns(airframes, AirframeInfo), size)
        with self._reading() as connection:
            require(connection, monitors, monitor_id)
            row = connection.execute(query.where(airframes.c.monitor_id == monitor_id)).first()
        return None if row is None else AirframeInfo(**row._mapping)

    def file(self, monitor_id: str) -> bytes | None:
        query = select(airframes.c.content).where(airframes.c.monitor_id == monitor_id)
        with self._reading() as connection:
            return connection.execute(query).scalar()

    def remove(self, monitor_id: str) -> None:
        """No effect where there is none. NotFound without such a monitor."""
        with self._deleting() as connection:
            require(connection, monitors, monitor_id)
            connection.execute(delete(airframes).where(airframes.c.monitor_id == monitor_id))
