"""The recorder: writes every sample, alarm and marker of a flight to the store, off the loop.

Alarms and markers are stored at once, and alarms are announced when they are. Samples are written
in order, one batch per `interval`. What the store refuses waits and is retried; if MOST_WAITING
samples wait, the oldest are lost and counted. A process that dies loses at most the samples of the
last interval, and no alarm that was announced as stored.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import numpy.typing as npt

from app.flights.clock import Clock, Timer
from app.messages import LimitsFrom
from app.store.assessments import DISPLAY, StoredDisplay
from app.store.store import NotFound, Store, StoreError, StoreHealth
from core.counted import counted
from core.flight_events import Alarm, FlightLimits, FlightMarker
from core.limits.exceedance import ChannelExceedances
from core.monitor import Assessment
from core.monitor.assessment import CAUSES, code_of
from core.types import Array, Flags

LOG = logging.getLogger("forewarn")
INTERVAL_S = 2.0
JOURNALLED_S = 8.0
"""Interval for a flight whose journal already holds its samples [s]."""
ANNOUNCED_S = 0.05
"""An alarm that is not stored by then is announced as not stored yet [s]."""
PARTS = 64
"""Parts of an interval, by which the first batches of flights are spread."""
BATCH = 10_000
"""Most samples per write."""
MOST_WAITING = 200_000
Columns = tuple[Array, Flags, npt.NDArray[np.uint8]]


Event = Alarm | FlightMarker | FlightLimits


class RecordedSample(NamedTuple):
    """A sample that waits for the store."""

    seq: int
    y: Array
    assessment: Assessment
    display: tuple[Assessment, ...] = ()
    manoeuvre: int = 0


class PendingEvent:
    """An alarm, a marker or a change of limits that waits for the store.

    announce: called with whether it is stored; called again once it is, if it was not.
    """

    def __init__(self, event: Event, announce: Callable[[bool], object]) -> None:
        self.event, self.announce, self.is_announced = event, announce, False

    def announce_unstored(self) -> None:
        """Announce it once although it is not stored."""
        if not self.is_announced:
            self.is_announced = True
            self.announce(False)

    def announce_stored(self) -> None:
        self.is_announced = True
        self.announce(True)


class Recorder:
    """Records one flight.

    threads: where it writes, so that other work of the server does not delay an alarm.
    store_health: reveals a fault of the store even while nothing waits.
    interval: longest wait of a sample for the next batch [s].
    is_spread: the first batch comes earlier, at a different time for each flight, so that flights
    started together do not write together.
    """

    interval = INTERVAL_S
    is_spread = False

    def __init__(
        self,
        store: Store,
        flight_id: str,
        clock: Clock,
        threads: Executor | None = None,
        store_health: StoreHealth | None = None,
    ) -> None:
        self._store, self._flight_id, self._clock = store, flight_id, clock
        self._threads = threads
        self._samples: list[RecordedSample] = []
        self._raised: deque[PendingEvent] = deque()
        self._writing, self._storing_alarms = asyncio.Lock(), asyncio.Lock()
        self._timer: Timer | None = None
        self._when = 0.0
        self._task: asyncio.Task[bool] | None = None
        self._alarms_task: asyncio.Task[None] | None = None
        self.lost = self.n_added = 0
        self._store_health, self._refusal = store_health, ""

    @property
    def problem(self) -> str:
        """Why the store refused the last write, or would refuse one now; empty if it does not."""
        return self._refusal or (self._store_health.fault if self._store_health else "")

    @property
    def unwritten(self) -> int:
        return len(self._samples)

    @property
    def waiting_words(self) -> str:
        """What waits for the store, with counts: `12 samples and 1 alarm`."""
        kinds = {"alarm": Alarm, "marker": FlightMarker, "limit set": FlightLimits}
        counts = {"sample": self.unwritten} | {
            name: sum(isinstance(raised.event, kind) for raised in self._raised)
            for name, kind in kinds.items()
        }
        parts = [counted(n, name) for name, n in counts.items() if n]
        return " and ".join(parts) or "status and time of its end"

    def add(
        self,
        seq: int,
        y: Array,
        assessment: Assessment,
        display: tuple[Assessment, ...] = (),
        manoeuvre: int = 0,
    ) -> None:
        """manoeuvre: number of the one that the sample is part of, 0 for none."""
        self.n_added += 1
        self._samples.append(RecordedSample(seq, y, assessment, display, manoeuvre))
        if len(self._samples) > MOST_WAITING:
            del self._samples[:BATCH]
            self.lost += BATCH
        if self._timer is None:
            is_first = self.is_spread and seq == 0
            part = 1 + crc32(self._flight_id.encode()) % PARTS if is_first else PARTS
            self._schedule(self.interval * part / PARTS)

    def add_event(self, event: Event, announce: Callable[[bool], object] = lambda _: None) -> None:
        """Store an event, then announce it, see PendingEvent.

        An alarm is announced even if the store refuses it or takes longer than ANNOUNCED_S: a full
        disk must not suppress a warning. The watchers have all other events already.
        """
        raised = PendingEvent(event, announce)
        raised.is_announced = not isinstance(event, Alarm)
        self._raised.append(raised)
        self._store_alarms_soon(raised)

    def announce_pending(self) -> None:
        for raised in self._raised:
            raised.announce_unstored()

    def waiting(self, first: int, last: int) -> list[RecordedSample]:
        return [sample for sample in self._samples if first <= sample.seq <= last]

    async def store_alarms(self) -> None:
        """Store every pending alarm, marker and change of limits. StoreError."""
        async with self._storing_alarms:
            while self._raised:
                raised = self._raised[0]
                await self._run(self._write_event, raised.event)
                self._raised.popleft()
                raised.announce_stored()

    async def flush(self) -> bool:
        """Write all that waits now. Returns False if the store refused it."""
        try:
            await self._flush()
        except Exception as error:
            if not self._refusal:
                LOG.exception("flight %s is not recorded; retrying", self._flight_id)
            self._refusal = str(error) or type(error).__name__
            self.announce_pending()
            return False
        if self._refusal:
            text = "flight %s is recorded again: %d samples were lost"
            LOG.warning(text, self._flight_id, self.lost)
            self._refusal = ""
        return True

    async def complete(
        self,
        status: str,
        exceeded_t: float | None = None,
        exceedances: Sequence[ChannelExceedances] = (),
        held: Sequence[LimitsFrom] | None = None,
        journal_digest: str | None = None,
        end_reason: str | None = None,
    ) -> None:
        """Write the rest of the record and the end of the flight. StoreError: it can be retried.

        exceeded_t: first exceedance [s].   exceedances: per channel.
        held: limits that were in force; None if unknown.   journal_digest: of a live flight.
        end_reason: why it ended, and who ended it.
        """
        if not await self.flush():
            raise StoreError(
                f"{self.waiting_words} of flight {self._flight_id} wait for the store, which "
                f"refuses them ({self.problem}); they are written as soon as it accepts them"
            )
        self._stop_timer()
        result = [asdict(exceedance) for exceedance in exceedances]
        limits = None if held is None else [limits.model_dump() for limits in held]
        about = status, exceeded_t, result, limits, journal_digest, end_reason
        await self._run(self._store.flights.end, self._flight_id, *about)

    def give_up(self) -> None:
        """Count what the store still refuses as lost."""
        self._stop_timer()
        self.lost += self.unwritten
        LOG.error(
            "flight %s: %d samples and %d alarms or markers were lost",
            self._flight_id,
            self.unwritten,
            len(self._raised),
        )
        self._samples, self._raised = [], deque()

    async def _flush(self) -> None:
        async with self._writing:
            await self.store_alarms()
            newest = self._samples[-1].seq if self._samples else -1
            while self._samples and self._samples[0].seq <= newest:
                await self._write_some()

    def _schedule(self, seconds: float) -> None:
        """Write after this time [s], unless a write is due sooner."""
        when = self._clock.now() + seconds
        if self._timer is not None and self._when <= when:
            return
        self._stop_timer()
        self._timer, self._when = self._clock.call_at(when, self._due), when

    def _stop_timer(self) -> None:
        if self._timer:
            self._timer.cancel()

    def _due(self) -> None:
        self._timer = None
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._flush_or_retry())
        else:
            self._schedule(INTERVAL_S)

    async def _flush_or_retry(self) -> bool:
        is_written = await self.flush()
        if not is_written:
            self._schedule(INTERVAL_S)
        return is_written

    def _store_alarms_soon(self, raised: PendingEvent) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(ANNOUNCED_S, raised.announce_unstored)
        if self._alarms_task is None or self._alarms_task.done():
            self._alarms_task = loop.create_task(self._try_alarms())

    async def _try_alarms(self) -> None:
        try:
            await self.store_alarms()
        except Exception as error:
            text = "an alarm or a marker of flight %s is not stored: %s"
            LOG.warning(text, self._flight_id, error)
            self.announce_pending()
            self._schedule(INTERVAL_S)

    async def _write_some(self) -> None:
        batch = self._samples[:BATCH]
        try:
            await self._run(self._write, batch)
        except (NotFound, ValueError):
            LOG.exception("flight %s: the store has no place for this", self._flight_id)
            self.lost += len(batch)
        written = batch[-1].seq
        self._samples = [sample for sample in self._samples if sample.seq > written]

    async def _run(self, work: Callable[..., object], *arguments: Any) -> None:
        await asyncio.get_running_loop().run_in_executor(self._threads, work, *arguments)

    def _write(self, batch: list[RecordedSample]) -> None:
        assessments = [sample.assessment for sample in batch]
        unknown = np.full(len(batch[0].y), np.nan)
        display = [
            _to_store(column) for column in zip(*(sample.display for sample in batch), strict=True)
        ]
        self._store.flights.append(
            self._flight_id,
            batch[0].seq,
            np.array([assessment.t for assessment in assessments]),
            np.array([sample.y for sample in batch]),
            *_columns(assessments),
            np.array(
                [
                    unknown if assessment.y_hat is None else assessment.y_hat
                    for assessment in assessments
                ]
            ),
            [assessment.reason for assessment in assessments],
            display,
            [CAUSES.index(assessment.cause) for assessment in assessments],
            [sample.manoeuvre for sample in batch],
        )

    def _write_event(self, event: Event) -> None:
        try:
            if isinstance(event, Alarm):
                self._store.alarms.add(self._flight_id, event)
            elif isinstance(event, FlightLimits):
                self._store.limit_sets.note(self._flight_id, event)
            else:
                self._store.flight_markers.add(self._flight_id, event)
        except NotFound:
            LOG.exception("flight %s: the store has no place for this", self._flight_id)


def _columns(assessments: Sequence[Assessment]) -> Columns:
    return (
        np.array([np.nan if a.p_value is None else a.p_value for a in assessments]),
        np.array([bool(a.alert) for a in assessments]),
        np.array([code_of(a.state) for a in assessments], np.uint8),
    )


def _to_store(assessments: Sequence[Assessment]) -> StoredDisplay:
    samples = np.empty(len(assessments), DISPLAY)
    for name, column in zip(DISPLAY.names or (), _columns(assessments), strict=True):
        samples[name] = column
    return StoredDisplay(samples, tuple(assessment.reason for assessment in assessments))
