"""A WebSocket of the server that delivers messages by plain calls, without tasks.

Through ASGI each message wakes two tasks on its way in and one on its way out, which costs many
times what its handler does. An application that finds EXTENSION in its scope may `reserve` it
before it accepts. Handshake, control frames and fragments still pass the library's parser.
"""

import asyncio
import socket
from collections.abc import Callable
from typing import Any, ClassVar

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Opcode, apply_mask  # pyright: ignore[reportPrivateImportUsage]

EXTENSION = "forewarn.direct"
SEND_BUFFER = 32_768
"""Bytes that the kernel holds for a viewer that does not read; more would be minutes old."""
TURN = 16
"""Messages read from one connection before the others have their turn."""
FIN, OPCODE, MASKED, LENGTH = 0x80, 0x0F, 0x80, 0x7F
WHOLE_TEXT, WHOLE_BYTES = FIN | Opcode.TEXT, FIN | Opcode.BINARY

OnMessage = Callable[[bytes], object]


class DirectWebSocket(WebSocketsSansIOProtocol):
    """A WebSocket with a small kernel buffer; HTTP answers, which may be files, keep a large one.

    is_writable: whether a message leaves soon.
    """

    _encoded: ClassVar[tuple[str, bytes]] = ("", b"\x81\0")
    """The last text and its frame: the next viewer mostly gets the same."""

    def __init__(self, *parts: Any, **options: Any) -> None:
        super().__init__(*parts, **options)
        self.is_reserved, self.is_writable = False, True
        self._on_message: OnMessage | None = None
        self._on_writable: Callable[[], object] | None = None
        self._unread = b""
        self._is_paused = self._is_fragmented = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        super().connection_made(transport)

    # --- used by the application --------------------------------------------------------------

    def reserve(self) -> None:
        """Keep messages for `start` instead of the application's `receive`."""
        self.is_reserved = True

    def start(self, on_message: OnMessage, on_writable: Callable[[], object]) -> None:
        """Call on_message with each message, on_writable when `is_writable` turns true again."""
        self._on_message, self._on_writable = on_message, on_writable
        self.resume()

    def send_text(self, text: str) -> None:
        """Send a message; does nothing on a closing connection."""
        if self.close_sent or self.transport.is_closing():
            return
        last_text, frame = DirectWebSocket._encoded
        if last_text is not text:
            frame = text_frame(text.encode())
            DirectWebSocket._encoded = text, frame
        self.transport.write(frame)

    def pause(self) -> None:
        """Deliver no message until `resume`."""
        self._is_paused = True
        if not self.transport.is_closing():
            self.transport.pause_reading()

    def resume(self) -> None:
        """Deliver messages again, from the loop's next turn on."""
        self.loop.call_soon(self._read)

    # --- called by the server -----------------------------------------------------------------

    def pause_writing(self) -> None:
        super().pause_writing()
        self.is_writable = False

    def resume_writing(self) -> None:
        super().resume_writing()
        self.is_writable = True
        if self._on_writable is not None:
            self._on_writable()

    def data_received(self, data: bytes) -> None:
        if not self.is_reserved:
            super().data_received(data)
            return
        self._unread += data
        if self._on_message is None:
            self.pause()
        elif not self._is_paused:
            self._parse(self._on_message)

    def handle_connect(self, event: Any) -> None:
        super().handle_connect(event)
        if not self.close_sent:
            scope: Any = self.scope
            scope["extensions"][EXTENSION] = self

    def send_receive_event_to_app(self) -> None:
        """Deliver a whole message. Invalid UTF-8 closes the connection, without a traceback."""
        content = b"".join(self.frames)
        if self.curr_msg_data_type == "text" and not _is_utf8(content):
            self.conn.send_close(1007)
            self.handle_parser_exception()
        elif self._on_message is None:
            super().send_receive_event_to_app()
        elif not self.close_sent:
            self.frames = []
            self._on_message(content)

    def _read(self) -> None:
        """Continue after a pause, or after another connection's turn."""
        self._is_paused = False
        if self._on_message is None or self.transport.is_closing():
            return
        self._parse(self._on_message)
        if not (self._is_paused or self.transport.is_closing()):
            self.transport.resume_reading()

    def _parse(self, on_message: OnMessage) -> None:
        """Deliver all whole frames received; after TURN of them, other connections come first."""
        data, at, n_messages = self._unread, 0, 0
        self._unread = b""
        while len(data) - at >= 2 and not (self._is_paused or self.transport.is_closing()):
            start, end = _payload(data, at)
            is_irregular = not data[at + 1] & MASKED or end - start > self.config.ws_max_size
            if is_irregular or self.close_sent:
                super().data_received(data[at:])
                return
            if end > len(data):
                break
            kind, content = data[at], apply_mask(data[start:end], data[start - 4 : start])
            is_message = kind == WHOLE_BYTES or (kind == WHOLE_TEXT and _is_utf8(content))
            if is_message and not self._is_fragmented:
                on_message(content)
            else:
                super().data_received(data[at:end])
                if kind & OPCODE <= Opcode.BINARY:
                    self._is_fragmented = not kind & FIN
            at, n_messages = end, n_messages + 1
            if n_messages == TURN and at < len(data) and not self._is_paused:
                self.pause()
                self.resume()
        self._unread = data[at:]


def text_frame(content: bytes) -> bytes:
    """A server's unfragmented, unmasked text frame."""
    n = len(content)
    if n < 126:
        return bytes((WHOLE_TEXT, n)) + content
    if n < 1 << 16:
        return b"%c\x7e%b%b" % (WHOLE_TEXT, n.to_bytes(2), content)
    return b"%c\x7f%b%b" % (WHOLE_TEXT, n.to_bytes(8), content)


def _payload(data: bytes, at: int) -> tuple[int, int]:
    """Start and end of a client frame's content, after its mask; past the data if incomplete."""
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
