"""Server-sent events, and the changes of lists that they tell pages of."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Any

from fastapi import Request, Response
from fastapi.responses import StreamingResponse

EVENT_STREAM = "text/event-stream"
BEAT_S = 2.0
"""[s] A quiet stream repeats its revisions, so that a page notices a lost connection."""
AT_MOST_EVERY_S = 0.25
"""[s] Between two events of one stream."""


LISTS = ("flights_in_progress", "flights", "campaigns")
"""The first also changes with a headline or state; the second with stored flights only."""


class Changes:
    """A revision number for each of LISTS, and those who wait for changes.

    The numbers begin with the time, so that those of a restarted server differ.
    """

    def __init__(self) -> None:
        self.revisions: dict[str, int] = dict.fromkeys(LISTS, time.time_ns() // 1_000_000)
        self._watchers: set[asyncio.Event] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closing = False

    def note(self, name: str) -> None:
        """A list changed. May be called from any thread."""
        self.revisions[name] += 1
        self._wake()

    def close(self) -> None:
        """End all streams."""
        self._closing = True
        self._wake()

    def _wake(self) -> None:
        if self._watchers and self._loop is not None:
            with suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._set_all)

    def _set_all(self) -> None:
        for changed in self._watchers:
            changed.set()

    async def watch(self) -> AsyncIterator[dict[str, int]]:
        """Yield the revisions now, at each change and every BEAT_S, until `close`."""
        changed, self._loop = asyncio.Event(), asyncio.get_running_loop()
        self._watchers.add(changed)
        try:
            while not self._closing:
                changed.clear()
                yield dict(self.revisions)
                await asyncio.sleep(AT_MOST_EVERY_S)
                with suppress(TimeoutError):
                    await asyncio.wait_for(changed.wait(), BEAT_S - AT_MOST_EVERY_S)
        finally:
            self._watchers.discard(changed)


def events_of(data: str, responses: dict[int | str, dict[str, Any]]) -> dict[int | str, Any]:
    """Documentation of a route of events. data: description of the data of each event."""
    properties = {
        "data": {"type": "string", "contentMediaType": "application/json"},
        "id": {"type": "string", "description": "`end` for the last event"},
    }
    event = {"type": "object", "description": "a server-sent event", "properties": properties}
    schema = {"schema": event | {"required": ["data"]}}
    about = {"description": f"events; the data of each is {data}"}
    return {200: about | {"content": {EVENT_STREAM: schema}}} | responses


def event_stream(request: Request, events: AsyncIterator[bytes]) -> Response:
    headers = {"X-Accel-Buffering": "no"}
    if request.method == "HEAD":
        return Response(None, 200, headers, EVENT_STREAM)
    return StreamingResponse(events, 200, headers, EVENT_STREAM)
