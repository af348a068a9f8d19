"""Direct WebSockets over ASGI, for the test client, which has no connection of the server."""

import asyncio
from collections import deque
from contextlib import suppress
from typing import Any

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.http.direct_websocket import EXTENSION


class DirectSockets:
    """ASGI layer that offers EXTENSION."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            direct = DirectOverAsgi(receive, send)
            extensions = scope.get("extensions", {}) | {EXTENSION: direct}
            scope = {**scope, "extensions": extensions}
            receive, send = direct.receive, direct.send
        await self.app(scope, receive, send)


class DirectOverAsgi:
    """What the application uses of a DirectWebSocket."""

    def __init__(self, receive: Receive, send: Send) -> None:
        self._receive, self._send = receive, send
        self._out, self._sending = deque[str](), asyncio.Lock()
        self._may_read, self._flushing = asyncio.Event(), set[asyncio.Future[None]]()
        self._on_message = self._on_writable = lambda *_: None

    @property
    def is_writable(self) -> bool:
        return not self._out

    def start(self, on_message: Any, on_writable: Any) -> None:
        self._on_message, self._on_writable = on_message, on_writable
        self.resume()

    def send_text(self, text: str) -> None:
        self._out.append(text)
        flushing = asyncio.ensure_future(self._flush())
        self._flushing.add(flushing)
        flushing.add_done_callback(self._flushing.discard)

    def pause(self) -> None:
        self._may_read.clear()

    def resume(self) -> None:
        self._may_read.set()

    async def receive(self) -> Message:
        while (message := await self._receive())["type"] == "websocket.receive":
            await self._may_read.wait()
            self._on_message(message.get("text") or message.get("bytes") or b"")
        return message

    async def send(self, message: Message) -> None:
        await self._flush()
        await self._send(message)

    async def _flush(self) -> None:
        async with self._sending:
            while self._out:
                with suppress(Exception):  # the client has left
                    await self._send({"type": "websocket.send", "text": self._out[0]})
                self._out.popleft()
                if not self._out:
                    self._on_writable()
