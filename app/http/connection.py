"""WebSockets of flights: each message calls a function, and sending does not wait."""

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from fastapi import WebSocket
from starlette.websockets import WebSocketDisconnect

OnMessage = Callable[[bytes | str], object]
CLIENT_LEFT = WebSocketDisconnect, RuntimeError
"""Raised where the client has left."""


def _nothing() -> None: ...


class Connection:
    """An accepted WebSocket: one task reads, another writes."""

    def __init__(self, websocket: WebSocket) -> None:
        self._websocket = websocket
        self._out: deque[str] = deque()
        self._has_output, self._may_read = asyncio.Event(), asyncio.Event()
        self._may_read.set()
        self._close: tuple[int, str] | None = None

    @property
    def is_writable(self) -> bool:
        """Whether a message leaves soon; if not, the sender keeps it for later."""
        return not self._out

    @property
    def is_closing(self) -> bool:
        """Whether `close` was called."""
        return self._close is not None

    def send(self, text: str) -> None:
        """Send a message; does nothing if the client has left."""
        self._out.append(text)
        self._has_output.set()

    def close(self, code: int, reason: str) -> None:
        """Close after the messages already sent; the first reason counts."""
        self._close = self._close or (code, reason)
        self._has_output.set()
        self.resume()

    def pause(self) -> None:
        """Read no message until `resume`."""
        self._may_read.clear()

    def resume(self) -> None:
        self._may_read.set()

    async def run(
        self, on_message: OnMessage, on_writable: Callable[[], object] = _nothing
    ) -> None:
        """Call on_message with each message, on_writable when `is_writable` turns true again.

        Returns once either side closes.
        """
        async with asyncio.TaskGroup() as tasks:
            reading = tasks.create_task(self._read(on_message))
            writing = tasks.create_task(self._write(on_writable))
            await asyncio.wait((reading, writing), return_when=asyncio.FIRST_COMPLETED)
            reading.cancel()
            writing.cancel()

    async def _read(self, on_message: OnMessage) -> None:
        with suppress(*CLIENT_LEFT):
            while (message := await self._websocket.receive())["type"] != "websocket.disconnect":
                on_message(message.get("text") or message.get("bytes") or b"")
                await asyncio.sleep(0)  # other connections come between two messages
                await self._may_read.wait()

    async def _write(self, on_writable: Callable[[], object]) -> None:
        with suppress(*CLIENT_LEFT):
            while self._out or self._close is None:
                await self._has_output.wait()
                self._has_output.clear()
                while self._out:
                    await self._websocket.send({"type": "websocket.send", "text": self._out[0]})
                    self._out.popleft()
                    if not self._out:
                        on_writable()
            await self._websocket.close(*self._close)


async def accept(websocket: WebSocket) -> Connection:
    await websocket.accept()
    return Connection(websocket)
