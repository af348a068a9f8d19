"""When new frames are sent: to the watchers of all flights together."""

import logging
from collections.abc import Callable

from app.flights.clock import Clock

LOG = logging.getLogger("forewarn")
TICK_S = 0.004
"""Least time between two rounds of sending [s]: what a frame may wait, where many come."""


class FrameTicks:
    """Sends what is new to everybody in one round: at once, but TICK_S after the last round.

    A write that wakes the machine by itself costs twice what it costs among others, and frames of
    one flight that come between two rounds are one message. The more a server has to do, the more
    of them there are.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._due: dict[Callable[[], object], None] = {}
        self._next = clock.now()
        self._is_planned = False

    def ask(self, send: Callable[[], object]) -> None:
        """Call `send` in the next round, once however often that is asked."""
        self._due[send] = None
        if not self._is_planned:
            self._is_planned = True
            self._clock.call_at(self._next, self._send)

    def _send(self) -> None:
        due, self._due = self._due, {}
        self._is_planned = False
        for send in due:
            try:
                send()
            except Exception:
                LOG.exception("a watcher was not sent what is new")
        self._next = self._clock.now() + TICK_S
