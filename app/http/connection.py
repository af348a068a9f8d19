"""WebSockets of flights: each message calls a function, and sending does not wait."""

import asyncio
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress

from fastapi import WebSocket
from starlette.websockets import WebSocketDisconnect

from app.http.direct_websocket import EXTENSION, DirectWebSocket

OnMessage = Callable[[bytes | str], object]
CLIENT_LEFT = WebSocketDisconnect, RuntimeError
"""Raised where the client has left."""


def _nothing() -> None: ...


class Connection(ABC):
    """A WebSocket that the caller of `run` has accepted.

    is_closing: `close` was called.
    """

    def __init__(self, websocket: WebSocket) -> None:
        self._websocket = websocket
        self._close: tuple[int, str] | None = None
        self.is_closing = False
        self._close_requested = asyncio.Event()

    @property
    @abstractmethod
    def is_writable(self) -> bool:
        """Whether a message leaves soon; if not, the sender keeps it for later."""

    @abstractmethod
    def send(self, text: str) -> None:
        """Send a message; does nothing if the client has left."""

    @abstractmethod
    def pause(self) -> None:
        """Read no message until `resume`."""

    @abstractmethod
    def resume(self) -> None: ...

    @abstractmethod
    def _pumps(
        self, on_message: OnMessage, on_writable: Callable[[], object]
    ) -> list[Awaitable[None]]:
        """Tasks that run until either side closes."""

    def close(self, code: int, reason: str) -> None:
        """Close after the messages already sent; the first reason counts."""
        self._close = self._close or (code, reason)
        self.is_closing = True
        self._close_requested.set()

    async def run(
        self, on_message: OnMessage, on_writable: Callable[[], object] = _nothing
    ) -> None:
        """Call on_message with each message, on_writable when `is_writable` turns true again.

        Returns once either side closes.
        """
        pumps = [asyncio.ensure_future(pump) for pump in self._pumps(on_message, on_writable)]
        try:
            done, _ = await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
            for pump in done:
                pump.result()
        finally:
            for pump in pumps:
                pump.cancel()
            # not `gather`: when cancelled, it would raise a pump's cancellation instead of its own
            ended, _ = await asyncio.wait(pumps)
            for pump in ended:
                if not pump.cancelled():
                    pump.exception()

    async def _close_websocket(self) -> None:
        assert self._close is not None
        with suppress(*CLIENT_LEFT):
            await self._websocket.close(*self._close)


class DirectConnection(Connection):
    """A WebSocket of this program's own server."""

    def __init__(self, websocket: WebSocket, direct: DirectWebSocket) -> None:
        super().__init__(websocket)
        self._direct = direct
        direct.reserve()

    @property
    def is_writable(self) -> bool:
        return self._direct.is_writable

    def send(self, text: str) -> None:
        self._direct.send_text(text)

    def pause(self) -> None:
        self._direct.pause()

    def resume(self) -> None:
        self._direct.resume()

    def _pumps(
        self, on_message: OnMessage, on_writable: Callable[[], object]
    ) -> list[Awaitable[None]]:
        self._direct.start(on_message, on_writable)
        return [self._until_left(), self._close_on_request()]

    async def _until_left(self) -> None:
        with suppress(*CLIENT_LEFT):
            while (await self._websocket.receive())["type"] != "websocket.disconnect":
                pass

    async def _close_on_request(self) -> None:
        await self._close_requested.wait()
        await self._close_websocket()
        self.resume()


class AsgiConnection(Connection):
    """A WebSocket of any ASGI server: one task reads, another writes."""

    def __init__(self, websocket: WebSocket) -> None:
        super().__init__(websocket)
        self._out: deque[str] = deque()
        self._has_output, self._may_read = asyncio.Event(), asyncio.Event()
        self._may_read.set()

    @property
    def is_writable(self) -> bool:
        return not self._out

    def send(self, text: str) -> None:
        self._out.append(text)
        self._has_output.set()

    def close(self, code: int, reason: str) -> None:
        super().close(code, reason)
        self._has_output.set()

    def pause(self) -> None:
        self._may_read.clear()

    def resume(self) -> None:
        self._may_read.set()

    def _pumps(
        self, on_message: OnMessage, on_writable: Callable[[], object]
    ) -> list[Awaitable[None]]:
        return [self._read(on_message), self._write(on_writable)]

    async def _read(self, on_message: OnMessage) -> None:
        with suppress(RuntimeError):
            while (message := await self._websocket.receive())["type"] != "websocket.disconnect":
                on_message(message.get("text") or message.get("bytes") or b"")
                await self._may_read.wait()

    async def _write(self, on_writable: Callable[[], object]) -> None:
        with suppress(*CLIENT_LEFT):
            while not (self.is_closing and not self._out):
                await self._has_output.wait()
                self._has_output.clear()
                while self._out:
                    await self._websocket.send({"type": "websocket.send", "text": self._out[0]})
                    self._out.popleft()
                    if not self._out:
                        on_writable()
        await self._close_websocket()


async def accept(websocket: WebSocket) -> Connection:
    direct = websocket.scope.get("extensions", {}).get(EXTENSION)
    connection = DirectConnection(websocket, direct) if direct else AsgiConnection(websocket)
    await websocket.accept()
    return connection
