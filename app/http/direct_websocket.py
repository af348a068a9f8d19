"""A WebSocket of the server whose messages need no task: handed over as they are read.

Through ASGI each message wakes two tasks on its way in and one on its way out, which costs many
times what is done with it. An application that finds EXTENSION in its scope may `reserve` it before
it accepts, and then gives and takes messages by plain calls. Whatever is no whole message of its
own, control frames and the handshake among it, goes the usual way.
"""

import asyncio
import socket
from collections.abc import Callable
from typing import Any, ClassVar

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Opcode, apply_mask  # pyright: ignore[reportPrivateImportUsage]

EXTENSION = "forewarn.direct"
SEND_BUFFER = 32_768
"""Bytes that the kernel holds for a watcher who does not read; more would be minutes old."""
TURN = 16
"""Messages of one connection that are taken before others have their turn."""
FIN, OPCODE, MASKED, LENGTH = 0x80, 0x0F, 0x80, 0x7F
WHOLE_TEXT, WHOLE_BYTES = FIN | Opcode.TEXT, FIN | Opcode.BINARY

Take = Callable[[bytes], object]


class DirectWebSocket(WebSocketsSansIOProtocol):
    """A WebSocket; its kernel buffer is small, that of an answer, a file maybe, is not.

    has_room: whether what is sent leaves soon.
    """

    _encoded: ClassVar[tuple[str, bytes]] = ("", b"\x81\0")
    """What was sent last, as text and as its frame: the next watcher mostly gets the same."""

    def __init__(self, *parts: Any, **more: Any) -> None:
        super().__init__(*parts, **more)
        self.is_reserved, self.has_room = False, True
        self._take: Take | None = None
        self._on_room: Callable[[], object] | None = None
        self._unread = b""
        self._is_held = self._is_fragmented = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a connection over, once it has asked for a WebSocket."""
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        super().connection_made(transport)

    # --- what an application uses -------------------------------------------------------------

    def reserve(self) -> None:
        """Keep what comes for `begin`, instead of the application's `receive`."""
        self.is_reserved = True

    def begin(self, take: Take, on_room: Callable[[], object]) -> None:
        """Hand over each message, and say when there is room again after there was none."""
        self._take, self._on_room = take, on_room
        self.resume()

    def send_text(self, text: str) -> None:
        """Send; nothing where the connection is closing."""
        if self.close_sent or self.transport.is_closing():
            return
        known, frame = DirectWebSocket._encoded
        if known is not text:
            frame = text_frame(text.encode())
            DirectWebSocket._encoded = text, frame
        self.transport.write(frame)

    def pause(self) -> None:
        """Hand nothing over until `resume`."""
        self._is_held = True
        if not self.transport.is_closing():
            self.transport.pause_reading()

    def resume(self) -> None:
        """Hand over what came and comes, from the loop's next turn on."""
        self.loop.call_soon(self._read)

    # --- what the server calls ----------------------------------------------------------------

    def pause_writing(self) -> None:
        """Note that there is no room."""
        super().pause_writing()
        self.has_room = False

    def resume_writing(self) -> None:
        """Say that there is room again."""
        super().resume_writing()
        self.has_room = True
        if self._on_room is not None:
            self._on_room()

    def data_received(self, data: bytes) -> None:
        """Take what came."""
        if not self.is_reserved:
            super().data_received(data)
            return
        self._unread += data
        if self._take is None:
            self.pause()
        elif not self._is_held:
            self._parse(self._take)

    def handle_connect(self, event: Any) -> None:
        """Offer the application the direct way."""
        super().handle_connect(event)
        if not self.close_sent:
            scope: Any = self.scope
            scope["extensions"][EXTENSION] = self

    def send_receive_event_to_app(self) -> None:
        """Pass a whole message on; a text that is none ends the connection, without a traceback."""
        content = b"".join(self.frames)
        if self.curr_msg_data_type == "text" and not _is_utf8(content):
            self.conn.send_close(1007)
            self.handle_parser_exception()
        elif self._take is None:
            super().send_receive_event_to_app()
        elif not self.close_sent:
            self.frames = []
            self._take(content)

    def _read(self) -> None:
        """Go on after a pause, or another connection's turn."""
        self._is_held = False
        if self._take is None or self.transport.is_closing():
            return
        self._parse(self._take)
        if not (self._is_held or self.transport.is_closing()):
            self.transport.resume_reading()

    def _parse(self, take: Take) -> None:
        """Take every whole frame that came; a connection that sent many waits for its turn."""
        data, at, n_taken = self._unread, 0, 0
        self._unread = b""
        while len(data) - at >= 2 and not (self._is_held or self.transport.is_closing()):
            start, end = _payload(data, at)
            is_odd = not data[at + 1] & MASKED or end - start > self.config.ws_max_size
            if is_odd or self.close_sent:
                super().data_received(data[at:])
                return
            if end > len(data):
                break
            kind, content = data[at], apply_mask(data[start:end], data[start - 4 : start])
            is_message = kind == WHOLE_BYTES or (kind == WHOLE_TEXT and _is_utf8(content))
            if is_message and not self._is_fragmented:
                take(content)
            else:
                super().data_received(data[at:end])
                if kind & OPCODE <= Opcode.BINARY:
                    self._is_fragmented = not kind & FIN
            at, n_taken = end, n_taken + 1
            if n_taken == TURN and at < len(data) and not self._is_held:
                self.pause()
                self.resume()
        self._unread = data[at:]


def text_frame(content: bytes) -> bytes:
    """A server's frame of a whole text."""
    n = len(content)
    if n < 126:
        return bytes((WHOLE_TEXT, n)) + content
    if n < 1 << 16:
        return b"%c\x7e%b%b" % (WHOLE_TEXT, n.to_bytes(2), content)
    return b"%c\x7f%b%b" % (WHOLE_TEXT, n.to_bytes(8), content)


def _payload(data: bytes, at: int) -> tuple[int, int]:
    """Where a client's frame at `at` has its content, mask before it; beyond data if not there."""
    length = data[at + 1] & LENGTH
    if length < 126:
        return at + 6, at + 6 + length
    n = 2 if length == 126 else 8
    start = at + 2 + n
    if start > len(data):
        return start + 4, start + 4
    return start + 4, start + 4 + int.from_bytes(data[at + 2 : start])


def _is_utf8(data: bytes) -> bool:
    if data.isascii():
        return True
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return True
