"""WebSockets of flights: each message calls a function, and sending does not wait."""

import asyncio
from collections.abc import Callable
from contextlib import suppress

from fastapi import WebSocket
from starlette.websockets import WebSocketDisconnect

from app.http.direct_websocket import EXTENSION, DirectWebSocket

OnMessage = Callable[[bytes], object]
CLIENT_LEFT = WebSocketDisconnect, RuntimeError
"""Raised where the client has left."""


class Connection:
    """A WebSocket of this program's own server that the caller of `run` has accepted.

    is_closing: `close` was called.
    """

    def __init__(self, websocket: WebSocket, direct: DirectWebSocket) -> None:
        self._websocket, self._direct = websocket, direct
        self._close: tuple[int, str] | None = None
        self.is_closing = False
        self._close_requested = asyncio.Event()
        direct.pause()

    @property
    def is_writable(self) -> bool:
        """Whether a message leaves soon; if not, the sender keeps it for later."""
        return self._direct.is_writable

    def send(self, text: str) -> None:
        """Send a message; does nothing if the client has left."""
        self._direct.send_text(text)

    def pause(self) -> None:
        """Read no message until `resume`."""
        self._direct.pause()

    def resume(self) -> None:
        self._direct.resume()

    def close(self, code: int, reason: str) -> None:
        """Close after the messages already sent; the first reason counts."""
        self._close = self._close or (code, reason)
        self.is_closing = True
        self._close_requested.set()

    async def run(
        self, on_message: OnMessage, on_writable: Callable[[], object] = lambda: None
    ) -> None:
        """Call on_message with each message, on_writable when `is_writable` turns true again.

        Returns once either side closes.
        """
        self._direct.start(on_message, on_writable)
        ends = [asyncio.ensure_future(end) for end in (self._until_left(), self._until_closed())]
        try:
            done, _ = await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
            for end in done:
                end.result()
        finally:
            for end in ends:
                end.cancel()
            # not `gather`: when cancelled, it would raise a task's cancellation instead of its own
            ended, _ = await asyncio.wait(ends)
            for end in ended:
                if not end.cancelled():
                    end.exception()

    async def _until_left(self) -> None:
        with suppress(*CLIENT_LEFT):
            while (await self._websocket.receive())["type"] != "websocket.disconnect":
                pass

    async def _until_closed(self) -> None:
        await self._close_requested.wait()
        assert self._close is not None
        with suppress(*CLIENT_LEFT):
            await self._websocket.close(*self._close)
        self.resume()


async def accept(websocket: WebSocket) -> Connection:
    connection = Connection(websocket, websocket.scope["extensions"][EXTENSION])
    await websocket.accept()
    return connection
