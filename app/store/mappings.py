"""Confirmed mappings of an aircraft, proposed for its next recording."""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import delete, insert, select

from app.store.repository import Entry, Repository
from app.store.tables import mappings, new_id, now


@dataclass(frozen=True)
class RememberedMapping(Entry):
    """A mapping confirmed earlier."""

    aircraft: str
    """aircraft it was confirmed for"""
    mapping: dict[str, Any]
    """see app.telemetry.mapping.mapping"""


class MappingRepository(Repository):
    """Mappings by aircraft and signature of the signals."""

    def save(self, aircraft: str, signature: str, mapping: dict[str, Any]) -> None:
        """Store a mapping for this aircraft, replacing the earlier one."""
        key = {"aircraft": aircraft, "signature": signature}
        same = (mappings.c.aircraft == aircraft) & (mappings.c.signature == signature)
        with self._writing() as connection:
            connection.execute(delete(mappings).where(same))
            row = {"id": new_id(), **key, "saved": now(), "mapping": mapping}
            connection.execute(insert(mappings).values(**row))

    def find(self, aircraft: str | None, signature: str) -> RememberedMapping | None:
        """Mapping last confirmed for this aircraft, preferably for the same signals.

        None if the aircraft is unknown: on another, signs may be reversed under the same names.
        """
        if not aircraft:
            return None
        table = mappings.c
        newest = select(table.aircraft, table.mapping).order_by(table.saved.desc()).limit(1)
        of_aircraft = table.aircraft == aircraft
        with self._reading() as connection:
            for condition in (of_aircraft & (table.signature == signature), of_aircraft):
                row = connection.execute(newest.where(condition)).one_or_none()
                if row is not None:
                    return RememberedMapping(**row._mapping)
        return None
