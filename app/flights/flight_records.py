"""Frames, alarms and markers of flights, in progress or ended, stored or not yet."""

import asyncio
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from math import isfinite
from typing import Any

import numpy as np
from pydantic import ValidationError

from app.flights.flight import Flight
from app.messages import LiveStatus, plain_frame
from app.recordings.scoring_answers import stored_assessment
from app.store.flights import FlightInfo
from app.store.store import NotFound, Store
from app.telemetry.journal import Journals
from core.channels import Dictionary
from core.flight_events import Alarm, FlightMarker, TrimChange
from core.monitor.assessment import CAUSES

NAME, ACCEPT_USELESS = "name", "accept_useless"
"""Stored with the source of a flight."""
MOST_DIGITS = 12


class FlightRecords:
    """The records of a server's flights.

    under_way: flights in progress by id.   threads: where an acknowledgement is written.
    journals: of live flights; None if the server keeps none.
    """

    def __init__(
        self,
        store: Store,
        under_way: Mapping[str, Flight],
        threads: Executor,
        journals: Journals | None,
    ) -> None:
        self._store, self._under_way, self._threads = store, under_way, threads
        self._journals = journals

    async def alarms(self, flight_id: str) -> list[Alarm]:
        """All alarms of a flight, in the order raised. NotFound."""
        flight = self._under_way.get(flight_id)
        at_hand = flight.alarms.at_hand if flight else []
        stored = await asyncio.to_thread(self._store.alarms.of, flight_id)
        alarms = {alarm.number: alarm for alarm in stored}
        alarms |= {alarm.number: alarm for alarm in at_hand}
        return [alarms[number] for number in sorted(alarms)]

    async def acknowledge(self, flight_id: str, alarm_id: str, by: str) -> Alarm:
        """Acknowledge an alarm, stored first; the first acknowledgement counts.

        NotFound; StoreError: it is not acknowledged.
        """
        flight = self._under_way.get(flight_id)
        if flight is not None:
            await flight.recorder.store_alarms()
        if not (alarm_id.isascii() and alarm_id.isdigit()) or len(alarm_id) > MOST_DIGITS:
            raise NotFound(f"flight {flight_id} has no alarm {alarm_id}")
        stored = await asyncio.get_running_loop().run_in_executor(
            self._threads, self._store.alarms.acknowledge, flight_id, int(alarm_id), by
        )
        if flight is not None:
            with suppress(KeyError):
                flight.acknowledge(alarm_id, stored.by or by, stored.acknowledged or "")
        return stored

    async def markers(self, flight_id: str) -> list[FlightMarker]:
        """All markers of a flight, in the order set. NotFound."""
        flight = self._under_way.get(flight_id)
        stored = await asyncio.to_thread(self._store.flight_markers.of, flight_id)
        markers = {marker.number: marker for marker in stored}
        return list((markers | (flight.markers if flight else {})).values())

    async def frames(
        self, flight_id: str, first: int, last: int, trims: Sequence[TrimChange] | None = None
    ) -> list[dict[str, Any]]:
        """Flown frames first..last, as streamed. trims: of the flight. NotFound."""
        flight = self._under_way.get(flight_id)
        waiting = flight.recorder.waiting(first, last) if flight else []
        stored = await asyncio.to_thread(self._stored_frames, flight_id, first, last)
        head = stored[-1]["seq"] if stored else -1
        stored += [
            plain_frame(sample.seq, sample.y, sample.assessment, None, sample.display)
            for sample in waiting
            if sample.seq > head
        ]
        if trims:
            await asyncio.to_thread(self._add_sensor, flight_id, stored, trims)
        return stored

    async def live_status(self, flight_id: str) -> LiveStatus | None:
        flight = self._under_way.get(flight_id)
        if flight is not None or self._journals is None:
            return flight.live if flight else None
        end = await asyncio.to_thread(self._journals.last, flight_id)
        try:
            return LiveStatus.model_validate(end["live"])
        except (KeyError, ValidationError):
            return None

    async def trims(self, flight_id: str) -> list[TrimChange] | None:
        """Where its trim changed; None where it subtracts none, or that is not known."""
        if (flight := self._under_way.get(flight_id)) is not None:
            return flight.trims
        live = await self.live_status(flight_id)
        return live.trims if live else None

    async def end_reason(self, info: FlightInfo) -> str:
        """Why and by whom a flight was ended; of older records in the journal only. OSError.

        Empty where it is not recorded.
        """
        if self._under_way.get(info.id) is not None:
            return ""
        if info.end_reason is not None or self._journals is None:
            return info.end_reason or ""
        return str((await asyncio.to_thread(self._journals.last, info.id)).get("reason", ""))

    def _add_sensor(
        self, flight_id: str, frames: list[dict[str, Any]], trims: Sequence[TrimChange]
    ) -> None:
        """Add values as recorded, where the flight showed them beside those from trim."""
        monitor = self._store.monitors.info(self._store.flights.info(flight_id).monitor_id)
        keys = Dictionary.from_stored(monitor.dictionary).keys
        for frame in frames:
            in_use = {change.channel: change for change in trims if change.t <= frame["t"]}
            values = {
                key: frame["y"][keys.index(key)] + change.value
                for key, change in in_use.items()
                if change.is_far and change.value is not None
            }
            if known := {key: value for key, value in values.items() if isfinite(value)}:
                frame["sensor"] = known

    def _stored_frames(self, flight_id: str, first: int, last: int) -> list[dict[str, Any]]:
        stored = self._store.flights.assessments(flight_id, first, last)
        names = "p_value", "alert", "state"
        frames = []
        for i, (t, y_hat) in enumerate(zip(stored.t, stored.y_hat, strict=True)):
            sample = {name: getattr(stored, name)[i] for name in names}
            known = y_hat if np.isfinite(y_hat).all() else None
            display = [
                stored_assessment(t, shown.samples[i], shown.reasons[i]) for shown in stored.display
            ]
            why = stored.reasons[i], known, CAUSES[stored.cause[i]]
            assessment = stored_assessment(t, sample, *why)
            frames.append(plain_frame(int(stored.seq[i]), stored.y[i], assessment, None, display))
        return frames


def flight_name(info: FlightInfo) -> str:
    return str(info.source.get(NAME, info.source.get("kind", "flight")))


def source_of(info: FlightInfo) -> dict[str, Any]:
    return {key: info.source[key] for key in info.source if key not in (NAME, ACCEPT_USELESS)}


def accepts_useless(info: FlightInfo) -> bool:
    """Whether a stored flight was started with a monitor that alerts on most safe flights."""
    return bool(info.source.get(ACCEPT_USELESS, False))
