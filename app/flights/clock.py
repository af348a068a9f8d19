"""The clock of a flight: monotonic seconds, timers, and the date for people."""

import asyncio
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Protocol


class Timer(Protocol):
    """A planned call."""

    def cancel(self) -> None: ...


class Clock(ABC):
    """All timing of flights goes through it; tests use a clock that they advance."""

    @abstractmethod
    def now(self) -> float:
        """Monotonic seconds."""

    @abstractmethod
    def call_at(self, when: float, call: Callable[[], object]) -> Timer:
        """Call from the event loop at time `when` of this clock; at once if that has passed."""

    @abstractmethod
    def utc(self) -> str:
        """The date and time, UTC in ISO 8601."""


class MonotonicClock(Clock):
    """The machine's clock and the running event loop."""

    def now(self) -> float:
        return time.monotonic()

    def call_at(self, when: float, call: Callable[[], object]) -> Timer:
        delay = max(0.0, when - time.monotonic())
        return asyncio.get_running_loop().call_later(delay, call)

    def utc(self) -> str:
        return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
