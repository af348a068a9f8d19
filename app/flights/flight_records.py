"""Frames, alarms and markers of flights, in progress or ended, stored or not yet."""

import asyncio
from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import suppress
from typing import Any

import numpy as np

from app.flights.flight import Flight
from app.flights.flight_markers import of_store
from app.messages import Alarm, FlightMarker, plain_frame
from app.store.alarms import StoredAlarm
from app.store.assessments import StoredDisplay
from app.store.flights import FlightInfo
from app.store.store import NotFound, Store
from core.limits.exceedance import MeasuredExceedance
from core.monitor import Assessment, State
from core.monitor.assessment import STATES
from core.monitor.status import cause_of

NAME, ACCEPT_USELESS = "name", "accept_useless"
"""Stored with the source of a flight."""
MOST_DIGITS = 12


class FlightRecords:
    """The records of a server's flights.

    under_way: flights in progress by id.   threads: where an acknowledgement is written.
    """

    def __init__(self, store: Store, under_way: Mapping[str, Flight], threads: Executor) -> None:
        self._store, self._under_way, self._threads = store, under_way, threads

    async def alarms(self, flight_id: str) -> list[Alarm]:
        """All alarms of a flight, in the order raised. NotFound."""
        flight = self._under_way.get(flight_id)
        at_hand = flight.alarms.at_hand if flight else []
        stored = await asyncio.to_thread(self._store.alarms.of, flight_id)
        alarms = {alarm.number: _alarm(alarm) for alarm in stored}
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
            self._threads, self._store.alarms.acknowledge_number, flight_id, int(alarm_id), by
        )
        if flight is not None:
            with suppress(KeyError):
                flight.acknowledge(alarm_id, stored.by or by, stored.acknowledged or "")
        return _alarm(stored)

    async def markers(self, flight_id: str) -> list[FlightMarker]:
        """All markers of a flight, in the order set. NotFound."""
        flight = self._under_way.get(flight_id)
        at_hand = flight.markers.at_hand if flight else []
        stored = await asyncio.to_thread(self._store.flight_markers.of, flight_id)
        markers = {marker.number: of_store(marker) for marker in stored}
        return list((markers | {marker.number: marker for marker in at_hand}).values())

    async def frames(self, flight_id: str, first: int, last: int) -> list[dict[str, Any]]:
        """Flown frames first..last, as streamed. NotFound."""
        flight = self._under_way.get(flight_id)
        waiting = flight.recorder.waiting(first, last) if flight else []
        stored = await asyncio.to_thread(self._stored_frames, flight_id, first, last)
        head = stored[-1]["seq"] if stored else -1
        return stored + [
            plain_frame(sample.seq, sample.y, sample.assessment, None, sample.display)
            for sample in waiting
            if sample.seq > head
        ]

    def _stored_frames(self, flight_id: str, first: int, last: int) -> list[dict[str, Any]]:
        stored = self._store.flights.assessments(flight_id, first, last)
        frames = []
        for i, code in enumerate(stored.state.tolist()):
            ok = STATES[code] is State.OK
            y_hat = stored.y_hat[i] if ok and np.isfinite(stored.y_hat[i]).all() else None
            assessment = Assessment(
                float(stored.t[i]),
                float(stored.p_value[i]) if ok else None,
                bool(stored.alert[i]) if ok else None,
                STATES[code],
                stored.reasons[i],
                y_hat,
                cause=cause_of(STATES[code], stored.reasons[i]),
            )
            display = [_displayed(shown, i, assessment.t) for shown in stored.display]
            frames.append(plain_frame(int(stored.seq[i]), stored.y[i], assessment, None, display))
        return frames


def _displayed(stored: StoredDisplay, i: int, t: float) -> Assessment:
    """Assessment of stored sample i by a monitor for display."""
    p_value, alert, code = stored.samples[i].tolist()
    ok = STATES[code] is State.OK
    risk = (p_value, alert) if ok else (None, None)
    state, reason = STATES[code], stored.reasons[i]
    return Assessment(t, *risk, state, reason, cause=cause_of(state, reason))


def _alarm(stored: StoredAlarm) -> Alarm:
    return Alarm(
        id=str(stored.number),
        number=stored.number,
        seq=stored.seq,
        t=stored.t,
        p_value=stored.p_value,
        kind=stored.kind,
        level=stored.level,
        exceedance=MeasuredExceedance(**stored.exceedance) if stored.exceedance else None,
        reason=stored.reason,
        cause=cause_of(State.INVALID, stored.reason or "") if stored.kind == "invalid" else None,
        raised=stored.raised,
        acknowledged=stored.acknowledged,
        by=stored.by,
        stored=True,
    )


def flight_name(info: FlightInfo) -> str:
    return str(info.source.get(NAME, info.source.get("kind", "flight")))


def source_of(info: FlightInfo) -> dict[str, Any]:
    """The source of a stored flight as requested."""
    return {key: info.source[key] for key in info.source if key not in (NAME, ACCEPT_USELESS)}


def accepts_useless(info: FlightInfo) -> bool:
    """Whether a stored flight was started with a monitor that alerts on most safe flights."""
    return bool(info.source.get(ACCEPT_USELESS, False))
