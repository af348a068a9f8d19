"""Mappings remembered for an aircraft from one recording to the next, for page and command."""

from dataclasses import dataclass

from app.recordings.mapped_columns import signature
from app.settings import Settings
from app.store.store import open_store
from app.telemetry.contents import Contents
from app.telemetry.mapping.mapping import Mapping


@dataclass(frozen=True)
class MappingMemory:
    """What the store knows of one aircraft's recorders. StoreError where it cannot be opened."""

    settings: Settings
    aircraft: str

    def recall(self, contents: Contents) -> Mapping | None:
        """The mapping last remembered for this aircraft, best of one for these very signals."""
        store = open_store(self.settings.url, recover=False)
        try:
            remembered = store.mappings.find(self.aircraft, signature(contents))
        finally:
            store.close()
        return None if remembered is None else Mapping.from_plain(remembered.mapping)

    def keep(self, contents: Contents, mapping: Mapping) -> None:
        """Use this mapping for the next recording of the aircraft."""
        store = open_store(self.settings.url, recover=False)
        try:
            store.mappings.save(self.aircraft, signature(contents), mapping.to_plain())
        finally:
            store.close()
