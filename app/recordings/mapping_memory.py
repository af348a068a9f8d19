"""Mappings remembered for an aircraft from one recording to the next, for page and command."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.settings import Settings
from app.telemetry.contents import Contents
from app.telemetry.mapping.mapping import Mapping

if TYPE_CHECKING:
    from app.store.mappings import MappingRepository


@dataclass(frozen=True)
class MappingMemory:
    """What the store knows of one aircraft's recorders. StoreError where it cannot be opened."""

    settings: Settings
    aircraft: str

    def recall(self, contents: Contents) -> Mapping | None:
        """The mapping last remembered for this aircraft, best of one for these very signals."""
        with self._mappings(contents) as (mappings, signature):
            remembered = mappings.find(self.aircraft, signature)
        return None if remembered is None else Mapping.from_plain(remembered.mapping)

    def keep(self, contents: Contents, mapping: Mapping) -> None:
        """Use this mapping for the next recording of the aircraft."""
        with self._mappings(contents) as (mappings, signature):
            mappings.save(self.aircraft, signature, mapping.to_plain())

    @contextmanager
    def _mappings(self, contents: Contents) -> Iterator[tuple["MappingRepository", str]]:
        """The store's mappings, and the signature of a recording's signals."""
        from app.recordings.mapped_columns import signature
        from app.store.store import open_store  # slow to import, and only needed here

        store = open_store(self.settings.url, recover=False)
        try:
            yield store.mappings, signature(contents)
        finally:
            store.close()
