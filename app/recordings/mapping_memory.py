"""Remember mappings of an aircraft from one recording to the next, for page and command."""

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
    """Stored mappings of one aircraft's recorders. StoreError if the store cannot be opened."""

    settings: Settings
    aircraft: str

    def recall(self, contents: Contents) -> Mapping | None:
        """The last mapping of this aircraft, preferably one for exactly these signals."""
        with self._mappings(contents) as (mappings, signature):
            remembered = mappings.find(self.aircraft, signature)
        return None if remembered is None else Mapping.from_plain(remembered.mapping)

    def remember(self, contents: Contents, mapping: Mapping) -> None:
        """Use this mapping for the aircraft's next recording."""
        with self._mappings(contents) as (mappings, signature):
            mappings.save(self.aircraft, signature, mapping.to_plain())

    @contextmanager
    def _mappings(self, contents: Contents) -> Iterator[tuple["MappingRepository", str]]:
        """The store's mappings, and the signature of the signals."""
        from app.recordings.mapped_columns import signature
        from app.store.store import open_store  # slow to import, and only needed here

        store = open_store(self.settings.url, recover=False)
        try:
            yield store.mappings, signature(contents)
        finally:
            store.close()
