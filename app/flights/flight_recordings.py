"""Live flights as recordings: the journal of an ended live flight becomes a recording.

After a failure, for example on a full disk, the journal stays and the next start tries again.
"""

import asyncio
import logging
import time
from datetime import UTC, datetime, timedelta
from operator import itemgetter

from app.flights.sources.source import header_of, mapping_of
from app.recipes.labels import kind_label
from app.recordings.files import NoSpace, digest_of
from app.recordings.flown_journal import FlownJournal, journal_damage
from app.recordings.recordings import Recordings
from app.recordings.workers import run_to_end
from app.store.database import Damaged
from app.store.flights import INTERRUPTED, FlightInfo
from app.store.recordings import Marker
from app.store.store import NotFound
from app.store.tables import new_id, now, time_text
from app.telemetry.journal import Journals, lines_of
from app.telemetry.recording import TelemetryError
from core.flight_events import FLIGHT_MARKERS

LOG = logging.getLogger("forewarn")
UNNAMED = "live"
"""Default name of a live flight, or the beginning of it."""
RESUMED_WITHIN_S = 600.0
"""The server resumes at its start no live flight whose last batch is older [s]."""


class FlightRecordings:
    """Makes recordings of live flights, one at a time."""

    def __init__(self, recordings: Recordings, journals: Journals) -> None:
        self._recordings, self._journals = recordings, journals
        self._store = recordings.store
        self._turn = asyncio.Lock()
        self.under_way: str | None = None
        """flight whose journal is being read"""

    async def make(self, flight_id: str) -> None:
        """Make the recording of an ended flight, unless there is or was one. Logs a failure."""
        async with self._turn:
            self.under_way = flight_id
            try:
                await run_to_end(self.make_now, flight_id)
            except NotFound:
                LOG.info("flight %s was deleted before it became a recording", flight_id)
            except TelemetryError as error:
                LOG.info("flight %s becomes no recording: %s", flight_id, error)
            except Exception:
                LOG.exception("flight %s is made a recording at the next start", flight_id)
            finally:
                self.under_way = None

    def make_now(self, flight_id: str) -> str | None:
        """Make the recording of an ended flight; for a thread. Returns its id.

        None for a flight that was not live or was interrupted recently. NotFound; StoreError;
        NoSpace; TelemetryError if it received nothing.
        """
        info, path = self._store.flights.info(flight_id), self._journals.path(flight_id)
        if not self._waits(info):
            return info.recording_id
        if not self._journals.is_whole(flight_id):
            raise NoSpace(f"the journal of flight {flight_id} waits for the disk")
        if damage := journal_damage(info, digest_of(path)):
            raise Damaged(f"flight {flight_id}: {damage}: restore the data directory")
        header = header_of(path)
        mapping, aircraft = mapping_of(self._store, info.source.get("recording"), header)
        name = self._name(info, header, aircraft)
        markers = self._markers(flight_id, str(header.get("began", now())))
        dictionary = self._recordings.dictionary_of(info.monitor_id)
        flown = FlownJournal(flight_id, path, name, aircraft, mapping, markers, dictionary)
        return self._recordings.add_journal(flown)

    def waiting(self) -> list[str]:
        """Ids of ended flights without a recording, the oldest first. StoreError.

        Flights that were interrupted recently are left out: they may be resumed.
        """
        return [info.id for info in reversed(self._store.flights.all()) if self._waits(info)]

    def _waits(self, info: FlightInfo) -> bool:
        path = self._journals.path(info.id)
        if info.recording_id is not None or info.status == "running" or not path.exists():
            return False
        age = time.time() - path.stat().st_mtime
        return info.status != INTERRUPTED or age >= RESUMED_WITHIN_S

    def _name(self, info: FlightInfo, header: dict[str, object], aircraft: str | None) -> str:
        given = str(info.source.get("name", header.get("name", UNNAMED)))
        if given != UNNAMED and not given.startswith(f"{UNNAMED}, "):
            return given
        recipe = self._store.monitors.info(info.monitor_id).dataset_recipe
        kinds = [(recipe.get(part) or {}).get("kind") for part in ("aircraft", "maneuver")]
        flown, maneuver = [kind_label(kind) if kind else "" for kind in kinds]
        test = " ".join(word for word in (aircraft or flown, maneuver) if word) or "flight"
        began = str(header.get("began", info.created))[:16].replace("T", " ")
        return f"{test}, flight {info.id}, {began} UTC"

    def _markers(self, flight_id: str, began: str) -> list[Marker]:
        """Markers of a flight: calls, manoeuvres begun by hand, and limits put in force.

        began: UTC, ISO 8601.
        """
        called = [
            (call.t, f"{FLIGHT_MARKERS[call.kind].word}, {call.by}", call.text, call.created)
            for call in self._store.flight_markers.of(flight_id)
        ]
        zero = datetime.fromisoformat(began)
        begun = [
            (
                float(line["t"]),
                f"manoeuvre begins, {line['by']}",
                None,
                time_text((zero + timedelta(seconds=line["a"])).astimezone(UTC)),
            )
            for line in lines_of(self._journals.path(flight_id))
            if line.get("e") == "manoeuvre" and line.get("t") is not None
        ]
        held = [
            (put.t, f"limits in force, {put.by}", f"{put.name} version {put.version}", put.created)
            for put in self._store.limit_sets.of_flights([flight_id]).get(flight_id, [])
        ]
        return [
            Marker(new_id(), created, "marker", t, None, f"{word}: {text}" if text else word)
            for t, word, text, created in sorted((*called, *begun, *held), key=itemgetter(0))
        ]
