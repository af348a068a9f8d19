"""A WebSocket of the server that delivers messages by plain calls, without tasks.

Through ASGI each message wakes two tasks on its way in and one on its way out, which costs many
times what its handler does. An application that finds EXTENSION in its scope may `pause` it before
it accepts, and `start` it.
"""

import asyncio
import socket
from collections import deque
from collections.abc import Callable
from typing import Any, ClassVar

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame, Opcode

EXTENSION = "forewarn.direct"
SEND_BUFFER = 32_768
"""Bytes that the kernel holds for a viewer that does not read; more would be minutes old."""
TURN = 16
"""Frames handled of one connection before the others have their turn."""

OnMessage = Callable[[bytes], object]


class DirectWebSocket(WebSocketsSansIOProtocol):
    """A WebSocket with a small kernel buffer; HTTP answers, which may be files, keep a large one.

    is_writable: whether a message leaves soon.
    """

    _encoded: ClassVar[tuple[str, bytes]] = ("", b"\x81\0")
    """The last text and its frame: the next viewer mostly gets the same."""

    def __init__(self, *parts: Any, **options: Any) -> None:
        super().__init__(*parts, **options)
        self.is_writable = True
        self._on_message: OnMessage | None = None
        self._on_writable: Callable[[], object] | None = None
        self._waiting: deque[Any] = deque()
        """The handshake and frames that are not handled yet."""
        self._is_paused = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        super().connection_made(transport)

    # --- used by the application --------------------------------------------------------------

    def start(self, on_message: OnMessage, on_writable: Callable[[], object]) -> None:
        """Call on_message with each message instead of passing them to `receive`.

        on_writable: called when `is_writable` turns true again.
        """
        self._on_message, self._on_writable = on_message, on_writable
        self.resume()

    def send_text(self, text: str) -> None:
        """Send a message; does nothing on a closing connection."""
        if self.close_sent or self.transport.is_closing():
            return
        last_text, frame = DirectWebSocket._encoded
        if last_text is not text:
            frame = Frame(Opcode.TEXT, text.encode()).serialize(mask=False)
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
        self.conn.receive_data(data)
        self._waiting += self.conn.events_received()
        self._handle_waiting()

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
        """Continue after a pause, or after other connections' turn."""
        if self._on_message is None or self.transport.is_closing():
            return
        self._is_paused = False
        self._handle_waiting()
        if not (self._is_paused or self.transport.is_closing()):
            self.transport.resume_reading()

    def _handle_waiting(self) -> None:
        """Handle what was received, in order; after TURN frames, other connections come first."""
        for _ in range(TURN):
            if not self._waiting or self._is_paused or self.transport.is_closing():
                break
            self.conn.events = [self._waiting.popleft()]
            self.handle_events()
        if self._waiting and not (self._is_paused or self.transport.is_closing()):
            self.pause()
            self.resume()
        elif not self._waiting and self.conn.parser_exc is not None and not self.close_sent:
            self.handle_parser_exception()


def _is_utf8(data: bytes) -> bool:
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return True
