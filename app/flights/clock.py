"""Time as a flight sees it: monotonic seconds, a call at a time, and the date for people."""

import asyncio
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Protocol


class Timer(Protocol):
    """A call that is due later."""

    def cancel(self) -> None:
        """Do not make the call."""
        ...


class Clock(ABC):
    """The one way to time and waiting; a test's own clock moves when it is told."""

    @abstractmethod
    def now(self) -> float:
        """Seconds that never run backwards, of no date."""

    @abstractmethod
    def call_at(self, when: float, call: Callable[[], object]) -> Timer:
        """Call from the event loop at `when`, in seconds of `now`; at once if that has passed."""

    @abstractmethod
    def utc(self) -> str:
        """The date and time, UTC in ISO 8601."""


class MonotonicClock(Clock):
    """The machine's clock and the running event loop."""

    def now(self) -> float:
        """Seconds since some start, the same for every process of the machine."""
        return time.monotonic()

    def call_at(self, when: float, call: Callable[[], object]) -> Timer:
        """Call at `when`, by the running loop's timers."""
        delay = max(0.0, when - time.monotonic())
        return asyncio.get_running_loop().call_later(delay, call)

    def utc(self) -> str:
        """Return the machine's date and time to the millisecond."""
        return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
