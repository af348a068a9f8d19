"""An HTTP connection that takes no more of the server than it may, before anybody is known.

Bounded are the header's size and time, the time between requests, and how slowly a body comes.
Time counts only while the server reads: one that is slow itself gives nobody up.

An address whose requests are refused all the time is read slowly: its refused connections, and new
ones, wait HELD_S before they are read further. What is not refused goes on as before.
"""

import asyncio
from typing import Any, ClassVar

from uvicorn.protocols.http.httptools_impl import (
    STATUS_LINE,
    HttpToolsProtocol,
    RequestResponseCycle,
)

from app.http.problems import Problem, problem_response
from app.http.refusals import Refusals
from app.settings import Settings

SLOWEST_BODY = 4096
"""[bytes/s] A body that comes more slowly on the whole is given up."""

PART = 16_384
"""Bytes that are parsed at once: requests that are asked ahead of their answers take memory."""
HELD_S = 1.0
MOST_HELD = 200
"""New connections that wait; more are dropped."""


class BoundedHttp(HttpToolsProtocol):
    """A connection within the settings' `max_header_bytes`, `header_seconds`, `body_seconds`."""

    _n_held: ClassVar[int] = 0
    """New connections that wait, of the process."""

    def __init__(self, settings: Settings, refusals: Refusals, **parts: Any) -> None:
        super().__init__(**parts)
        self.settings, self._refusals = settings, refusals
        self._behind, self.app = self.app, self._noting
        self._address, self._status = "", 0
        self._unread = b""
        """What came behind requests that wait for their answers."""
        self._is_held = False
        self._in_head = True
        self._begun = False
        self._plain = 0
        """Bytes since the last that were of a body: of a header, a trailer, between requests."""
        self._patience = settings.body_seconds
        self._timer: asyncio.TimerHandle | None = None
        self._answered: RequestResponseCycle | None = None
        """The request that is being answered; `cycle` is the newest that came."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin to wait for the first header."""
        super().connection_made(transport)  # pyright: ignore[reportArgumentType]
        self._address = self.client[0] if self.client else ""
        if not self._refusals.are_many(self._address):
            self._expect_head()
        elif BoundedHttp._n_held < MOST_HELD:
            BoundedHttp._n_held += 1
            self._is_held = True
            self.loop.call_later(HELD_S, self._let_in)
        else:
            self.transport.abort()

    def _let_in(self) -> None:
        """Read a connection that waited."""
        BoundedHttp._n_held -= 1
        self._is_held = False
        if not self.transport.is_closing():
            self.flow.resume_reading()
            self._expect_head()
            self.data_received(b"")

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait for nothing more, and answer nothing more of what was asked ahead."""
        self._stop_waiting()
        if self._answered is not None:
            self._answered.disconnected = True
            self._answered.message_event.set()
        self.pipeline.clear()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse what came, no more at once than a header may have, nor far ahead of the answers."""
        if self._is_held:  # a loop may read what comes first, paused or not
            self._unread += data
            return self.flow.pause_reading()
        most = self.settings.max_header_bytes
        data, self._unread = self._unread + data, b""
        while data and not self.transport.is_closing():
            if (current := self.transport.get_protocol()) is not self:
                return current.data_received(data)  # pyright: ignore
            if self._plain >= most:
                text = f"the header is too large: {most} bytes at most are read"
                return self._refuse(431, text)
            if self.pipeline:
                self._unread = data
                return self.flow.pause_reading()
            size = min(PART, most - self._plain)
            part, data = data[:size], data[size:]
            self._parse(part)
        return None

    def on_response_complete(self) -> None:
        """Go on with the next request, after a while where most are refused."""
        if 400 <= self._status < 500:
            self._refusals.note(self._address)
            if self._refusals.are_many(self._address):
                self.flow.pause_reading()
                self.loop.call_later(HELD_S, self._go_on)
                return
        self._go_on()

    def _go_on(self) -> None:
        """Answer what was asked ahead, and read what follows."""
        super().on_response_complete()
        if self._unread:
            self.flow.pause_reading()
            if not self.pipeline:
                self.loop.call_soon(self._read_on)

    def _read_on(self) -> None:
        if not self.transport.is_closing():
            self.flow.resume_reading()
            self.data_received(b"")

    def send_400_response(self, msg: str) -> None:
        """Refuse what is no HTTP."""
        self._refusals.note(self._address)
        super().send_400_response(msg)

    async def _noting(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass on; remember the status of the answer."""

        async def noting(message: Any) -> None:
            if message["type"] == "http.response.start":
                self._status = message["status"]
            await send(message)

        await self._behind(scope, receive, noting)

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: Any) -> None:
        self._answered = cycle
        super()._start_asgi_task(cycle, app)

    def _parse(self, data: bytes) -> None:
        if self._in_head and self._timer is None:
            self._expect_head()
        self._begun = self._in_head
        self._plain += len(data)
        super().data_received(data)
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            self._stop_waiting()
        elif self._in_head and self._begun and self._timer is None:
            self._expect_head()
        elif not self._in_head and self._timer is None:
            self._expect_body()

    def on_message_begin(self) -> None:
        """A header begins."""
        self._begun = True
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        """A body begins, of no bytes maybe."""
        self._stop_waiting()
        self._in_head, self._plain = False, 0
        self._patience = self.settings.body_seconds
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """More came of the body."""
        self._plain = 0
        gained = self._patience + len(body) / SLOWEST_BODY
        self._patience = min(gained, self.settings.body_seconds)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """The request is whole."""
        self._stop_waiting()
        self._in_head, self._begun, self._plain = True, False, 0
        super().on_message_complete()

    def handle_websocket_upgrade(self) -> None:
        """Leave the connection to its WebSocket."""
        self._stop_waiting()
        super().handle_websocket_upgrade()

    def _expect_head(self) -> None:
        seconds = self.settings.header_seconds
        text = f"the header did not come within {seconds:g} s: send the request again"
        self._timer = self.loop.call_later(seconds, self._refuse, 408, text)

    def _expect_body(self) -> None:
        tick = min(1.0, self.settings.body_seconds / 4)
        self._timer = self.loop.call_later(tick, self._look_at_body, tick)

    def _look_at_body(self, passed: float) -> None:
        if not self.flow.read_paused:
            self._patience -= passed
        if self._patience > 0:
            return self._expect_body()
        return self._refuse(
            408,
            f"the body came more slowly than {SLOWEST_BODY} bytes/s for "
            f"{self.settings.body_seconds:g} s: send the request again",
        )

    def _stop_waiting(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _refuse(self, status: int, detail: str) -> None:
        """Say why, where nothing else is being said, and close."""
        self._stop_waiting()
        if self.transport.is_closing():
            return
        answered = self._answered
        if answered is None or answered.response_complete or not answered.response_started:
            response = problem_response(Problem(status, detail), {"Connection": "close"})
            lines = [name + b": " + value + b"\r\n" for name, value in response.raw_headers]
            content = STATUS_LINE[status], *lines, b"\r\n", bytes(response.body)
            self.transport.write(b"".join(content))
        self.transport.close()
