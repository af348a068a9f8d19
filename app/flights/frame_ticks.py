"""Rounds of sending: new frames go to the watchers of all flights together."""

import logging
from collections.abc import Callable

from app.flights.clock import Clock

LOG = logging.getLogger("forewarn")
TICK_S = 0.004
"""Least time between two rounds [s], so also the longest that a frame waits for its round."""


class FrameTicks:
    """Sends new frames to all watchers in one round, TICK_S or more after the last round.

    Writes in a group cost half as much as single ones, and frames of one flight between two rounds
    become one message. Both save more the busier the server is.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._due: dict[Callable[[], object], None] = {}
        self._next = clock.now()
        self._is_planned = False

    def ask(self, send: Callable[[], object]) -> None:
        """Call `send` once in the next round."""
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
                LOG.exception("new frames were not sent to a watcher")
        self._next = self._clock.now() + TICK_S
