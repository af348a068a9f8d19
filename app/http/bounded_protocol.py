"""An HTTP connection with limits that hold before a client has logged in.

Limits: the header's size and time, the time between requests, and the slowest rate of a body. Time
counts only while the server reads, so a slow server cuts no client off.
"""

import asyncio
from typing import Any

from uvicorn.protocols.http.httptools_impl import (
    STATUS_LINE,
    HttpToolsProtocol,
    RequestResponseCycle,
)

from app.http.problems import Problem, problem_response
from app.settings import Settings

SLOWEST_BODY = 4096
"""[bytes/s] A body that is slower on average is refused."""


class BoundedHttp(HttpToolsProtocol):
    """A connection within the settings' `max_header_bytes`, `header_seconds`, `body_seconds`."""

    def __init__(self, settings: Settings, **options: Any) -> None:
        super().__init__(**options)
        self.settings = settings
        self._in_header = True
        self._header_started = False
        self._n_outside_body = 0
        """Bytes since the last byte of a body: header, trailer, or between requests."""
        self._seconds_left = settings.body_seconds
        """[s] The delay that the body still has."""
        self._timer: asyncio.TimerHandle | None = None
        self._current: RequestResponseCycle | None = None
        """The request being answered; `cycle` is the newest received."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)  # pyright: ignore[reportArgumentType]
        self._expect_header()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_timer()
        if self._current is not None:
            self._current.disconnected = True
            self._current.message_event.set()
        self.pipeline.clear()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse at most a header's size at once."""
        most = self.settings.max_header_bytes
        while data and not self.transport.is_closing():
            if (protocol := self.transport.get_protocol()) is not self:
                return protocol.data_received(data)  # pyright: ignore
            size = most - self._n_outside_body
            chunk, data = data[:size], data[size:]
            self._parse(chunk)
            if self._n_outside_body >= most:
                self._refuse(431, f"the header is too large: send at most {most} bytes")
        return None

    def on_response_complete(self) -> None:
        """Continue with the next request; read no further ones while some wait for answers."""
        super().on_response_complete()
        if self.pipeline:
            self.flow.pause_reading()

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: Any) -> None:
        self._current = cycle
        super()._start_asgi_task(cycle, app)

    def _parse(self, data: bytes) -> None:
        if self._in_header and self._timer is None:
            self._expect_header()
        self._header_started = self._in_header
        self._n_outside_body += len(data)
        super().data_received(data)
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            self._stop_timer()
        elif self._in_header and self._header_started and self._timer is None:
            self._expect_header()
        elif not self._in_header and self._timer is None:
            self._expect_body()

    def on_message_begin(self) -> None:
        self._header_started = True
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        self._stop_timer()
        self._in_header, self._n_outside_body = False, 0
        self._seconds_left = self.settings.body_seconds
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        self._n_outside_body = 0
        seconds = self._seconds_left + len(body) / SLOWEST_BODY
        self._seconds_left = min(seconds, self.settings.body_seconds)
        super().on_body(body)

    def on_message_complete(self) -> None:
        self._stop_timer()
        self._in_header, self._header_started, self._n_outside_body = True, False, 0
        super().on_message_complete()

    def handle_websocket_upgrade(self) -> None:
        self._stop_timer()
        super().handle_websocket_upgrade()

    def _expect_header(self) -> None:
        seconds = self.settings.header_seconds
        text = f"the header did not arrive within {seconds:g} s: send the request again"
        self._timer = self.loop.call_later(seconds, self._refuse, 408, text)

    def _expect_body(self) -> None:
        tick = min(1.0, self.settings.body_seconds / 4)
        self._timer = self.loop.call_later(tick, self._check_body, tick)

    def _check_body(self, elapsed: float) -> None:
        if not self.flow.read_paused:
            self._seconds_left -= elapsed
        if self._seconds_left > 0:
            return self._expect_body()
        return self._refuse(
            408,
            f"the body was slower than {SLOWEST_BODY} bytes/s for "
            f"{self.settings.body_seconds:g} s: send the request again",
        )

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _refuse(self, status: int, detail: str) -> None:
        """Send the reason unless an answer has started, and close."""
        self._stop_timer()
        if self.transport.is_closing():
            return
        current = self._current
        if current is None or current.response_complete or not current.response_started:
            response = problem_response(Problem(status, detail), {"Connection": "close"})
            lines = [name + b": " + value + b"\r\n" for name, value in response.raw_headers]
            content = STATUS_LINE[status], *lines, b"\r\n", bytes(response.body)
            self.transport.write(b"".join(content))
        self.transport.close()
