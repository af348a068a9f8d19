"""A WebSocket as flights use it: messages handed over as they come, sent without waiting."""

import asyncio
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress

from fastapi import WebSocket
from starlette.websockets import WebSocketDisconnect

from app.http.direct_websocket import EXTENSION, DirectWebSocket

Take = Callable[[bytes | str], object]
GONE = WebSocketDisconnect, RuntimeError
"""What is raised where the other side has left."""


def _nothing() -> None:
    """There is room again, and nothing waits for it."""


class Connection(ABC):
    """One WebSocket, accepted by `run`'s caller.

    `take` is called with each message; `on_room` when `has_room` is true again.
    is_closing: whether it was asked to close.
    """

    def __init__(self, websocket: WebSocket) -> None:
        self._websocket = websocket
        self._close: tuple[int, str] | None = None
        self.is_closing = False
        self._is_to_close = asyncio.Event()

    @property
    @abstractmethod
    def has_room(self) -> bool:
        """Whether what is sent leaves soon; more than that is better kept."""

    @abstractmethod
    def send(self, text: str) -> None:
        """Send a message; nothing where the other side is gone."""

    @abstractmethod
    def pause(self) -> None:
        """Take no message until `resume`."""

    @abstractmethod
    def resume(self) -> None:
        """Take messages again."""

    @abstractmethod
    def _pumps(self, take: Take, on_room: Callable[[], object]) -> list[Awaitable[None]]:
        """What runs until one side is gone."""

    def close(self, code: int, reason: str) -> None:
        """Close once all is sent that was to be; the first reason counts."""
        self._close = self._close or (code, reason)
        self.is_closing = True
        self._is_to_close.set()

    async def run(self, take: Take, on_room: Callable[[], object] = _nothing) -> None:
        """Hand over messages until either side closes."""
        pumps = [asyncio.ensure_future(pump) for pump in self._pumps(take, on_room)]
        try:
            done, _ = await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
            for pump in done:
                pump.result()
        finally:
            for pump in pumps:
                pump.cancel()
            # not `gather`: cancelled itself, it would raise a pump's cancellation and not its own
            ended, _ = await asyncio.wait(pumps)
            for pump in ended:
                if not pump.cancelled():
                    pump.exception()

    async def _say_goodbye(self) -> None:
        assert self._close is not None
        with suppress(*GONE):
            await self._websocket.close(*self._close)


class DirectConnection(Connection):
    """A connection of this program's own server."""

    def __init__(self, websocket: WebSocket, direct: DirectWebSocket) -> None:
        super().__init__(websocket)
        self._direct = direct
        direct.reserve()

    @property
    def has_room(self) -> bool:
        """Whether the kernel takes more."""
        return self._direct.has_room

    def send(self, text: str) -> None:
        """Send a message; nothing where the other side is gone."""
        self._direct.send_text(text)

    def pause(self) -> None:
        """Take no message until `resume`."""
        self._direct.pause()

    def resume(self) -> None:
        """Take messages again."""
        self._direct.resume()

    def _pumps(self, take: Take, on_room: Callable[[], object]) -> list[Awaitable[None]]:
        self._direct.begin(take, on_room)
        return [self._until_gone(), self._until_closed()]

    async def _until_gone(self) -> None:
        with suppress(*GONE):
            while (await self._websocket.receive())["type"] != "websocket.disconnect":
                pass

    async def _until_closed(self) -> None:
        await self._is_to_close.wait()
        await self._say_goodbye()
        self.resume()


class AsgiConnection(Connection):
    """A connection of any server: a task reads, another one writes."""

    def __init__(self, websocket: WebSocket) -> None:
        super().__init__(websocket)
        self._out: deque[str] = deque()
        self._news, self._may_take = asyncio.Event(), asyncio.Event()
        self._may_take.set()

    @property
    def has_room(self) -> bool:
        """Whether all was sent."""
        return not self._out

    def send(self, text: str) -> None:
        """Send a message; nothing where the other side is gone."""
        self._out.append(text)
        self._news.set()

    def close(self, code: int, reason: str) -> None:
        """Close once all is sent that was to be; the first reason counts."""
        super().close(code, reason)
        self._news.set()

    def pause(self) -> None:
        """Take no message until `resume`."""
        self._may_take.clear()

    def resume(self) -> None:
        """Take messages again."""
        self._may_take.set()

    def _pumps(self, take: Take, on_room: Callable[[], object]) -> list[Awaitable[None]]:
        return [self._read(take), self._write(on_room)]

    async def _read(self, take: Take) -> None:
        with suppress(RuntimeError):
            while (message := await self._websocket.receive())["type"] != "websocket.disconnect":
                take(message.get("text") or message.get("bytes") or b"")
                await self._may_take.wait()

    async def _write(self, on_room: Callable[[], object]) -> None:
        with suppress(*GONE):
            while not (self.is_closing and not self._out):
                await self._news.wait()
                self._news.clear()
                while self._out:
                    await self._websocket.send({"type": "websocket.send", "text": self._out[0]})
                    self._out.popleft()
                    if not self._out:
                        on_room()
        await self._say_goodbye()


async def accepted(websocket: WebSocket) -> Connection:
    """Accept a WebSocket."""
    direct = websocket.scope.get("extensions", {}).get(EXTENSION)
    connection = DirectConnection(websocket, direct) if direct else AsgiConnection(websocket)
    await websocket.accept()
    return connection
