"""The recorder: every sample, alarm and acknowledgement of a flight into the store, off the loop.

Writes are batched each INTERVAL_S, in order, one at a time. What the store refuses waits and is
tried again; only when MOST_WAITING samples wait are the oldest lost, and counted. A process that
dies loses the last INTERVAL_S at most.
"""

import asyncio
import logging
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from app.flights.clock import Clock, Timer
from app.messages import Alarm
from app.store.store import NotFound, Store
from core.channels import N_CHANNELS
from core.monitor import Assessment
from core.monitor.assessment import STATES
from core.types import Array

LOG = logging.getLogger("forewarn")
INTERVAL_S = 2.0
BATCH = 10_000
"""Most samples in one write."""
MOST_WAITING = 200_000
LAST_TRIES = 3
"""Writes tried at the end of a flight before what is left is given up."""
UNKNOWN = np.full(N_CHANNELS, np.nan)
CODES = {state: code for code, state in enumerate(STATES)}


class RecordedSample(NamedTuple):
    """A sample as it waits for the store."""

    seq: int
    y: Array
    said: Assessment


class Recorder:
    """Records one flight."""

    def __init__(self, store: Store, flight_id: str, clock: Clock) -> None:
        self._store, self._flight_id, self._clock = store, flight_id, clock
        self._samples: list[RecordedSample] = []
        self._notes: list[Callable[[], None]] = []
        self._store_ids: dict[str, str] = {}
        self._writing = asyncio.Lock()
        self._timer: Timer | None = None
        self._task: asyncio.Task[bool] | None = None
        self.lost = 0

    def add(self, seq: int, y: Array, said: Assessment) -> None:
        """Take a sample; it is written with the next batch."""
        self._samples.append(RecordedSample(seq, y, said))
        if len(self._samples) > MOST_WAITING:
            del self._samples[:BATCH]
            self.lost += BATCH
        self._schedule()

    def add_alarm(self, alarm: Alarm) -> None:
        """Take an alarm."""
        self._notes.append(partial(self._write_alarm, alarm))
        self._schedule()

    def add_acknowledgement(self, alarm: Alarm) -> None:
        """Take the acknowledgement of an alarm that was taken before."""
        self._notes.append(partial(self._write_acknowledgement, alarm.id, alarm.by or ""))
        self._schedule()

    def waiting(self, first: int, last: int) -> list[RecordedSample]:
        """Return samples first..last that are not in the store yet."""
        return [sample for sample in self._samples if first <= sample.seq <= last]

    async def flush(self) -> bool:
        """Write all that waits now; whether the store took it."""
        async with self._writing:
            try:
                while self._samples or self._notes:
                    await self._write_some()
            except Exception:
                LOG.exception("flight %s could not be recorded: tried again soon", self._flight_id)
                return False
        return True

    async def close(self) -> None:
        """Write all that is left; samples that the store refuses are lost and counted."""
        if self._timer:
            self._timer.cancel()
        for _ in range(LAST_TRIES):
            if await self.flush():
                return
        self.lost += len(self._samples)
        LOG.error("flight %s: %d samples were lost", self._flight_id, len(self._samples))
        self._samples, self._notes = [], []

    def _schedule(self) -> None:
        if self._timer is None:
            self._timer = self._clock.call_at(self._clock.now() + INTERVAL_S, self._due)

    def _due(self) -> None:
        self._timer = None
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._flush_again())
        else:
            self._schedule()

    async def _flush_again(self) -> bool:
        taken = await self.flush()
        if not taken:
            self._schedule()
        return taken

    async def _write_some(self) -> None:
        batch, notes = self._samples[:BATCH], self._notes[:]
        if batch:
            try:
                await asyncio.to_thread(self._write, batch)
            except (NotFound, ValueError):
                LOG.exception("flight %s: the store has no place for this", self._flight_id)
                self.lost += len(batch)
            written = batch[-1].seq
            self._samples = [sample for sample in self._samples if sample.seq > written]
        for note in notes:
            try:
                await asyncio.to_thread(note)
            except NotFound:
                LOG.exception("flight %s: the store has no place for this", self._flight_id)
            self._notes.remove(note)

    def _write(self, batch: list[RecordedSample]) -> None:
        said = [sample.said for sample in batch]
        self._store.flights.append(
            self._flight_id,
            batch[0].seq,
            np.array([one.t for one in said]),
            np.array([sample.y for sample in batch]),
            np.array([np.nan if one.p_value is None else one.p_value for one in said]),
            np.array([bool(one.alert) for one in said]),
            np.array([CODES[one.state] for one in said], np.uint8),
            np.array([UNKNOWN if one.y_hat is None else one.y_hat for one in said]),
            [one.reason for one in said],
        )

    def _write_alarm(self, alarm: Alarm) -> None:
        exceedance = alarm.exceedance and alarm.exceedance.model_dump()
        stored = self._store.alarms.add(
            self._flight_id, alarm.seq, alarm.t, alarm.p_value, alarm.kind, alarm.level, exceedance
        )
        self._store_ids[alarm.id] = stored

    def _write_acknowledgement(self, alarm_id: str, by: str) -> None:
        if alarm_id in self._store_ids:
            self._store.alarms.acknowledge(self._store_ids[alarm_id], by)
