"""Direct WebSockets deliver the same messages as ASGI, however they are cut."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
import uvicorn
from hypothesis import given, settings
from hypothesis import strategies as st
from uvicorn.server import ServerState
from websockets.frames import Frame, Opcode

from app.http.direct_websocket import EXTENSION, TURN, DirectWebSocket
from app.serving import LARGEST_MESSAGE
from tests.support.repetition import examples

HANDSHAKE = (
    b"GET / HTTP/1.1\r\nHost: here\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)
TEXTS = st.text(max_size=20) | st.sampled_from(["x" * 126, "é" * 40_000])


class Wire(asyncio.Transport):
    """A transport that keeps written bytes and whether it is being read."""

    def __init__(self) -> None:
        super().__init__()
        self.written, self.is_closed, self.is_read = b"", False, True

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return self if name == "socket" else default

    def setsockopt(self, *_: int) -> None:
        """Accept any option, as a socket does."""

    def getsockname(self) -> tuple[str, int]:
        return "127.0.0.1", 1

    getpeername = getsockname

    def write(self, data: Any) -> None:
        self.written += data

    def close(self) -> None:
        self.is_closed = True

    def is_closing(self) -> bool:
        return self.is_closed

    def pause_reading(self) -> None:
        self.is_read = False

    def resume_reading(self) -> None:
        self.is_read = True


class Peer:
    """An application that reads messages directly from one connection."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []
        self.gone: dict[str, Any] = {}
        self.n_writable = 0
        config = uvicorn.Config(
            self._app,
            interface="asgi3",
            ws_max_size=LARGEST_MESSAGE,
            ws_ping_interval=None,
            ws_per_message_deflate=False,
            log_level="critical",
        )
        config.load()
        self.socket = DirectWebSocket(config, ServerState(), {})
        self.wire = Wire()
        self.socket.connection_made(self.wire)

    async def _app(self, scope: Any, receive: Callable[[], Awaitable[Any]], send: Any) -> None:
        direct: DirectWebSocket = scope["extensions"][EXTENSION]
        direct.pause()
        assert (await receive())["type"] == "websocket.connect"
        await send({"type": "websocket.accept"})
        direct.start(self.messages.append, self._count_writable)
        self.gone = await receive()

    def _count_writable(self) -> None:
        self.n_writable += 1

    async def open(self) -> None:
        self.socket.data_received(HANDSHAKE)
        await settle()
        self.wire.written = b""


async def settle() -> None:
    for _ in range(20):
        await asyncio.sleep(0)


def frame(opcode: Opcode, content: bytes, fin: bool = True) -> bytes:
    return Frame(opcode, content, fin).serialize(mask=True)


def sent(content: bytes, cuts: int, ping: bool) -> bytes:
    """A message in one or several frames, optionally with a ping in between."""
    if not cuts:
        return frame(Opcode.TEXT, content)
    parts = [*(content[i : i + 1] for i in range(cuts)), content[cuts:]]
    frames = [
        frame(Opcode.CONT if i else Opcode.TEXT, part, fin=i == cuts)
        for i, part in enumerate(parts)
    ]
    return frames[0] + (frame(Opcode.PING, b"here?") if ping else b"") + b"".join(frames[1:])


@settings(max_examples=examples(200))
@given(st.lists(st.tuples(TEXTS, st.integers(0, 2), st.booleans()), max_size=6), st.data())
def test_messages_do_not_depend_on_how_they_are_cut(
    messages: list[tuple[str, int, bool]], data: st.DataObject
) -> None:
    stream = b"".join(sent(text.encode(), cuts, ping) for text, cuts, ping in messages)
    ends = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=5)))

    async def run() -> Peer:
        peer = Peer()
        await peer.open()
        for start, end in zip([0, *ends], [*ends, len(stream)], strict=True):
            peer.socket.data_received(stream[start:end])
            await settle()
        assert not peer.wire.is_closed
        return peer

    peer = asyncio.run(run())
    assert peer.messages == [text.encode() for text, _, _ in messages]
    n_pings = sum(ping for _, cuts, ping in messages if cuts)
    assert peer.wire.written == n_pings * Frame(Opcode.PONG, b"here?").serialize(mask=False)


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (frame(Opcode.TEXT, b"\xff"), 1007),
        (Frame(Opcode.TEXT, b"bare").serialize(mask=False), 1002),
        (frame(Opcode.BINARY, bytes(LARGEST_MESSAGE + 1))[:100], 1009),
        (frame(Opcode.TEXT, b"a", fin=False) + frame(Opcode.TEXT, b"b"), 1002),
        (frame(Opcode.TEXT, b"\xff", fin=False) + frame(Opcode.CONT, b"b"), 1007),
        (frame(Opcode.CLOSE, (1001).to_bytes(2)), 1001),
    ],
    ids=["invalid UTF-8", "unmasked", "too long", "nested", "invalid UTF-8 in parts", "close"],
)
def test_an_invalid_message_closes_the_connection(wrong: bytes, code: int) -> None:
    async def run() -> Peer:
        peer = Peer()
        await peer.open()
        peer.socket.data_received(frame(Opcode.TEXT, b"before") + wrong)
        await settle()
        return peer

    peer = asyncio.run(run())
    assert peer.messages == [b"before"]
    assert peer.gone["type"] == "websocket.disconnect"
    assert peer.wire.written[:1] == bytes((0x80 | Opcode.CLOSE,))
    assert int.from_bytes(peer.wire.written[2:4]) == code


def test_a_busy_connection_leaves_others_their_turn() -> None:
    async def run() -> None:
        peer = Peer()
        await peer.open()
        peer.socket.data_received(3 * TURN * frame(Opcode.BINARY, b"again"))
        assert len(peer.messages) == TURN
        assert not peer.wire.is_read
        await settle()
        assert len(peer.messages) == 3 * TURN
        assert peer.wire.is_read

    asyncio.run(run())


def test_a_pause_delays_messages_and_loses_none() -> None:
    async def run() -> None:
        peer = Peer()
        await peer.open()
        peer.socket.pause()
        peer.socket.data_received(frame(Opcode.TEXT, b"later"))
        await settle()
        assert peer.messages == []
        assert not peer.wire.is_read
        peer.socket.resume()
        await settle()
        assert peer.messages == [b"later"]

    asyncio.run(run())


def test_the_application_learns_when_it_may_write_again() -> None:
    async def run() -> None:
        peer = Peer()
        await peer.open()
        assert peer.socket.is_writable
        peer.socket.pause_writing()
        assert not peer.socket.is_writable
        peer.socket.resume_writing()
        assert peer.socket.is_writable
        assert peer.n_writable == 1

    asyncio.run(run())


def test_messages_before_a_close_are_delivered_over_several_turns() -> None:
    async def run() -> None:
        peer = Peer()
        await peer.open()
        close = frame(Opcode.CLOSE, (1000).to_bytes(2))
        peer.socket.data_received(2 * TURN * frame(Opcode.BINARY, b"again") + close)
        await settle()
        assert len(peer.messages) == 2 * TURN
        assert peer.gone["code"] == 1000

    asyncio.run(run())
