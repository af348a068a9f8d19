"""Relay connections to another server, byte for byte: HTTP, WebSockets and streams alike."""

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress
from math import inf
from typing import Any
from urllib.parse import urlsplit

from app.http.problems import Problem, problem_response

BUFFER = 32_768
"""Bytes that each link holds for a side that does not read; more would be minutes old."""
ANSWERS_S = 2.0
"""A server that does not accept a connection within this time is not there [s]."""
HELD_S = 5.0
"""Connections wait for the server so long, then they are refused [s]."""
AGAIN_S = 0.1


def _refusal() -> bytes:
    text = "the server that owns the database does not answer: try again"
    answer = problem_response(Problem(503, text, "urn:forewarn:owner"), {"Connection": "close"})
    head = "".join(f"{name}: {value}\r\n" for name, value in answer.headers.items())
    return f"HTTP/1.1 503 Service Unavailable\r\n{head}\r\n".encode() + bytes(answer.body)


class _Side(asyncio.Protocol):
    """One side of a relayed connection: what it receives is sent by the other side."""

    def __init__(self, sides: "set[_Side]") -> None:
        self._sides = sides
        self.transport: Any = None
        self.other: _Side | None = None

    def connection_made(self, transport: Any) -> None:
        connection = transport.get_extra_info("socket")
        for buffer in (socket.SO_SNDBUF, socket.SO_RCVBUF):
            connection.setsockopt(socket.SOL_SOCKET, buffer, BUFFER)
        transport.set_write_buffer_limits(BUFFER)
        self.transport = transport
        self._sides.add(self)

    def _to(self) -> Any:
        assert self.other is not None
        return self.other.transport

    def data_received(self, data: bytes) -> None:
        self._to().write(data)

    def eof_received(self) -> bool:
        with suppress(OSError, RuntimeError):  # the other side has closed
            self._to().write_eof()
        return True  # the answer may still come

    def pause_writing(self) -> None:
        self._to().pause_reading()

    def resume_writing(self) -> None:
        self._to().resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:
        self._sides.discard(self)
        if self.other is not None and self.other.transport is not None:
            self.other.transport.close()


class Relay:
    """Accepts connections of a listening socket while the other server accepts them.

    server: address of the other server; empty while it is unknown. Until then,
    connections wait in the socket's backlog, at most HELD_S.
    """

    def __init__(self, listening: socket.socket, server: Callable[[], str]) -> None:
        self._listening, self._server = listening, server
        self._sides: set[_Side] = set()

    async def run(self) -> None:
        """Until cancelled; the connections end with it."""
        loop, silent_since = asyncio.get_running_loop(), inf
        try:
            while True:
                await _readable(self._listening)
                try:
                    await self._relay_one()
                    silent_since = inf
                except OSError:  # no server answers there
                    silent_since = min(silent_since, loop.time())
                    if loop.time() - silent_since > HELD_S:
                        self._refuse_one()
                    await asyncio.sleep(AGAIN_S)
        finally:
            for side in [*self._sides]:
                side.transport.abort()

    def _refuse_one(self) -> None:
        with suppress(OSError), self._listening.accept()[0] as client:  # unless it has left
            client.setblocking(False)
            client.send(_refusal())
            client.shutdown(socket.SHUT_WR)

    async def _relay_one(self) -> None:
        loop, parts = asyncio.get_running_loop(), urlsplit(self._server())
        if parts.hostname is None:
            raise ConnectionError("the server is not known")
        server, client = _Side(self._sides), _Side(self._sides)
        joining = loop.create_connection(lambda: server, parts.hostname, parts.port or 80)
        await asyncio.wait_for(joining, ANSWERS_S)
        server.transport.pause_reading()
        try:
            accepted, _ = self._listening.accept()
        except BlockingIOError:  # the client has left
            server.transport.close()
            return
        accepted.setblocking(False)
        client.other = server
        await loop.connect_accepted_socket(lambda: client, accepted)
        server.other = client
        server.transport.resume_reading()


async def _readable(listening: socket.socket) -> None:
    loop, ready = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(listening, ready.set)
    try:
        await ready.wait()
    finally:
        loop.remove_reader(listening)
