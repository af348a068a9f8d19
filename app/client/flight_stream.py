"""Watch a flight from another program."""

import asyncio
from collections.abc import AsyncGenerator, Mapping
from contextlib import aclosing
from typing import Any

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException

SILENT_S = 3.0
"""Without a message for so long a connection is broken; the server sends one each second."""
CREDIT_AFTER = 4
"""Messages of frames after which credit is returned for them; the server starts with 16."""
FRAMES = b'{"type":"frames"'


class _Frames(msgspec.Struct):
    seq: int
    frames: list[msgspec.Raw]


class FlightStream:
    """The messages of a flight (`app.messages`), over one connection after another.

    newest: number of the last sample whose frame was used; None before the first connection.
    """

    def __init__(self, url: str, headers: Mapping[str, str], flight: str) -> None:
        self._address = f"ws{url.removeprefix('http')}/api/v1/flights/{flight}/stream"
        self._headers = headers
        self.newest: int | None = None

    async def messages(self) -> AsyncGenerator[dict[str, Any], None]:
        """Connect; yield `hello` and what follows until the server closes. ConnectionError.

        `frames` of a message are JSON (bytes). They count as used when the next message is asked
        for. None is skipped that the server still keeps, a minute or more: not for a slow reader,
        and not between two connections.
        """
        about: dict[str, Any] = {"additional_headers": self._headers, "compression": None}
        about |= {"max_size": None, "proxy": None, "close_timeout": 1.0, "open_timeout": SILENT_S}
        try:
            async with (
                connect(self._address, **about) as socket,
                aclosing(self._messages(socket)) as messages,
            ):
                async for message in messages:
                    yield message
        except ConnectionClosed as error:
            raise ConnectionError(f"the server closed the stream ({error})") from None
        except TimeoutError:
            raise ConnectionError(f"the server was silent for {SILENT_S:g} s") from None
        except (OSError, WebSocketException) as error:
            raise ConnectionError(f"the server does not answer ({error})") from None

    async def _messages(self, socket: ClientConnection) -> AsyncGenerator[dict[str, Any], None]:
        is_resuming, may_skip, n_frames = False, False, 0

        async def resume() -> bool:
            await socket.send(f'{{"type":"resume","seq":{self.newest}}}')
            return True

        while True:
            async with asyncio.timeout(SILENT_S):
                text = await socket.recv(decode=False)
            if not text.startswith(FRAMES):
                message = msgspec.json.decode(text)
                if message["type"] == "hello":
                    head = message["head"]
                    self.newest = head if self.newest is None else min(self.newest, head)
                    is_resuming = self.newest < head and await resume()
                elif message["type"] == "reset":
                    is_resuming, may_skip = False, True
                yield message
                if message["type"] == "end":
                    return
                continue
            n_frames += 1
            if n_frames % CREDIT_AFTER == 0:
                await socket.send(f'{{"type":"credit","n":{CREDIT_AFTER}}}')
            message = msgspec.json.decode(text, type=_Frames)
            first = message.seq - len(message.frames) + 1
            newest = -1 if self.newest is None else self.newest
            if first > newest + 1 and not may_skip:  # skipped, or sent before `resume` was read
                is_resuming = is_resuming or await resume()
                continue
            is_resuming = may_skip = False
            if new := message.frames[max(0, newest + 1 - first) :]:
                yield {"type": "frames", "seq": message.seq, "frames": [*map(bytes, new)]}
                self.newest = message.seq
