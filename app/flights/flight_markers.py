"""The markers of a flight in progress, as sent to every watcher."""

from app.messages import FlightMarker
from app.store.alarms import StoredFlightMarker
from core.flight_markers import FLIGHT_MARKERS, FlightMarkerKey

KEPT = 50
"""Stored markers that a flight keeps in memory; the store has all."""


class FlightMarkers:
    """The markers of one flight, numbered from 1."""

    def __init__(self) -> None:
        self._markers: dict[int, FlightMarker] = {}
        self._number = 0

    @property
    def at_hand(self) -> list[FlightMarker]:
        """Markers not stored yet, and the last stored ones, in the order set."""
        return list(self._markers.values())

    def restore(self, markers: list[FlightMarker]) -> None:
        self._markers |= {marker.number: marker for marker in markers[-KEPT:]}
        self._number = max(self._markers, default=0)

    def add(
        self, kind: FlightMarkerKey, seq: int, t: float, created: str, by: str, text: str | None
    ) -> FlightMarker:
        self._number += 1
        about = {"seq": seq, "t": t, "created": created, "by": by, "text": text}
        marker = self._markers[self._number] = sent(kind, number=self._number, **about)
        return marker

    def note_stored(self, number: int) -> FlightMarker:
        """Mark a marker as stored, and return it."""
        marker = self._markers[number].model_copy(update={"stored": True})
        self._markers[number] = marker
        for old in [n for n, known in self._markers.items() if known.stored][:-KEPT]:
            del self._markers[old]
        return marker


def sent(kind: FlightMarkerKey, **about: object) -> FlightMarker:
    known = FLIGHT_MARKERS[kind]
    words = {"word": known.word, "meaning": known.meaning, "level": known.level}
    return FlightMarker.model_validate({"kind": kind, **words, **about})


def of_store(stored: StoredFlightMarker) -> FlightMarker:
    about = {name: getattr(stored, name) for name in ("number", "seq", "t", "created", "by")}
    return sent(stored.kind, **about, text=stored.text, stored=True)


def to_store(marker: FlightMarker) -> StoredFlightMarker:
    about = {name: getattr(marker, name) for name in ("number", "seq", "t", "created", "by")}
    return StoredFlightMarker(kind=marker.kind, **about, text=marker.text)
