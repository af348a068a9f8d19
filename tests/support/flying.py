"""Shared by tests of flights: a scripted clock, and flights of the oscillator."""

import heapq
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from app.flights.clock import Clock
from app.flights.flight import FlightPlan
from app.flights.recorder import PendingEvent, Recorder
from app.flights.sources.playback import AssessedTrack
from app.flights.sources.replay import TrackFlight
from app.flights.sources.simulated import Track, times
from app.flights.watcher import RecentFrames, Watcher
from app.store.store import Store, open_store
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.group import LargestDeflection
from tests.support import oscillator
from tests.support.oscillator import DT, N_SAMPLES, Array

EPSILON = 0.3
BEGAN = datetime(2030, 1, 1, tzinfo=UTC)
T = times(N_SAMPLES, DT)


@cache
def exact_monitor() -> Monitor:
    """A monitor whose p-values remember the flight: its lowest score so far counts."""
    dataset = oscillator.collect(np.random.default_rng(11), n_unsafe=12)
    return train(dataset, MonitorRecipe(p_value="exact", epsilon=EPSILON))


@cache
def grouped_monitor() -> Monitor:
    """A monitor whose p-values depend on how far a surface has moved so far."""
    dataset = oscillator.collect(np.random.default_rng(11), n_unsafe=40)
    return train(dataset, MonitorRecipe(groups=LargestDeflection(), epsilon=EPSILON))


@cache
def failing_flight() -> Array:
    """A flight that is alerted on, not from its first sample."""
    for y in oscillator.fly(np.random.default_rng(12), 200)[1]:
        alert = exact_monitor().assess(T, y, EPSILON).alert
        if alert.any() and 5 < alert.argmax() < 30:
            return y
    raise AssertionError("no flight is alerted on")


class Call:
    """A call that a test's clock will make."""

    def __init__(self, call: Callable[[], object]) -> None:
        self.call: Callable[[], object] | None = call

    def cancel(self) -> None:
        self.call = None


class ScriptedClock(Clock):
    """Time that passes when a test says so; calls are made at their very moment."""

    def __init__(self) -> None:
        self.time = 1000.0
        self._number = count()
        self._calls: list[tuple[float, int, Call]] = []

    def now(self) -> float:
        return self.time

    def call_at(self, when: float, call: Callable[[], object]) -> Call:
        entry = Call(call)
        heapq.heappush(self._calls, (max(when, self.time), next(self._number), entry))
        return entry

    def utc(self) -> str:
        return (BEGAN + timedelta(seconds=self.time - 1000.0)).isoformat()

    def advance(self, seconds: float) -> None:
        """Let time pass, making every call when it is due."""
        end = self.time + seconds
        while self._calls and self._calls[0][0] <= end + 1e-9:
            when, _, entry = heapq.heappop(self._calls)
            self.time = max(self.time, when)
            if entry.call is not None:
                entry.call()
        self.time = end

    def freeze(self, seconds: float) -> None:
        """Let time pass while nothing is called, as on a machine that was suspended."""
        self.time += seconds


class Seen:
    """A watcher's messages, taken as they come."""

    def __init__(self, watcher: Watcher) -> None:
        self.watcher = watcher
        self.messages: list[dict[str, Any]] = []

    def take(self, credit: bool = True) -> list[dict[str, Any]]:
        """Take what can be had now, giving credit back for frames unless told not to."""
        new: list[dict[str, Any]] = []
        while (text := self.watcher.next_message()) is not None:
            new.append(msgspec.json.decode(text))
            if credit and new[-1]["type"] == "frames":
                self.watcher.grant(1)
        self.messages += new
        return new

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [message for message in self.messages if message["type"] == kind]

    @property
    def frames(self) -> list[dict[str, Any]]:
        return [frame for message in self.of("frames") for frame in message["frames"]]


def track(y: Array, dt: float = DT) -> Track:
    return Track(times(len(y), dt), y, dt)


def store_with(monitor: Monitor, directory: Path) -> tuple[Store, str]:
    store = open_store(directory / "store.db")
    return store, store.monitors.add(monitor, "oscillator").id


def plan(
    monitor: Monitor, monitor_id: str = "m", flight_id: str = "f", epsilon: float = EPSILON
) -> FlightPlan:
    return FlightPlan(
        flight_id, "a flight", {"kind": "scripted"}, monitor, monitor_id, "oscillator", epsilon
    )


class NoStore:
    """A store that takes everything and lists it; its own repository of flights and of alarms."""

    def __init__(self) -> None:
        self.flights = self.alarms = self
        self.chunks: list[tuple[Any, ...]] = []
        self.notes: list[tuple[Any, ...]] = []
        self.failures = 0
        self.ownership = None

    def append(self, *chunk: Any) -> None:
        self._fail()
        self.chunks.append(chunk)

    def add(self, *alarm: Any, **more: Any) -> str:
        self._fail()
        self.notes.append((*alarm, *more.values()))
        return f"stored {len(self.notes)}"

    def end(self, *how: Any) -> None:
        self._fail()
        self.notes.append(how)

    def _fail(self) -> None:
        if self.failures:
            self.failures -= 1
            raise OSError("the disk is full")


def as_store(stand_in: NoStore) -> Any:
    """The stand-in where a Store is wanted."""
    return stand_in


class SilentRecorder(Recorder):
    """Takes samples, and writes only when told."""

    def __init__(self, clock: Clock, store: Any = None) -> None:
        super().__init__(store or as_store(NoStore()), "f", clock)

    def _schedule(self, seconds: float) -> None:
        pass

    def _store_alarms_soon(self, raised: PendingEvent) -> None:
        raised.announce_stored()


class Flown:
    """A flight on a scripted clock with one watcher that takes everything."""

    def __init__(
        self,
        monitor: Monitor,
        y: Array,
        epsilon: float = EPSILON,
        scene: Any = None,
        clock: ScriptedClock | None = None,
        wait_for_viewer: bool = False,
    ) -> None:
        """wait_for_viewer: nobody watches yet; else one watcher does before the flight starts."""
        self.clock = clock or ScriptedClock()
        self.over: list[tuple[str, str]] = []
        self.recorder = SilentRecorder(self.clock)
        self.flight = TrackFlight(
            replace(plan(monitor, epsilon=epsilon), wait_for_viewer=wait_for_viewer),
            AssessedTrack(track(y), monitor, epsilon),
            self.recorder,
            self.clock,
            lambda *how: self.over.append(how),
            scene,
        )
        self.seen = Seen(Watcher(RecentFrames()) if wait_for_viewer else self.flight.watch())
        self.seen.take()

    def join(self) -> None:
        """Begin to watch."""
        self.seen = Seen(self.flight.watch())
        self.seen.take()

    def start(self) -> "Flown":
        self.flight.start()
        self.seen.take()
        return self

    def advance(self, seconds: float, tick: float = 0.01) -> None:
        """Let time pass; the watcher takes its messages as they come."""
        for _ in range(round(seconds / tick)):
            self.clock.advance(tick)
            self.seen.take()
