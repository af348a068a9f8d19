"""Networks that delay, cut, drop, double and reorder, reproducible by seed."""

import asyncio
import random
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from urllib.parse import urlsplit

from tests.support.patience import PATIENCE


class BadLine:
    """A line to a server in another thread: slow, and cut after so many bytes, so many times.

    url: to connect to.   cuts: that are left; each closes a connection between two bytes.
    """

    def __init__(self, target: str, seed: int, cuts: int, after: int) -> None:
        parts = urlsplit(target)
        self._to = parts.hostname, parts.port
        self._chance, self.cuts, self._after = random.Random(seed), cuts, after
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        self._stop = asyncio.Event()
        self._up = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()))

    @contextmanager
    def open(self) -> Iterator["BadLine"]:
        self._thread.start()
        assert self._up.wait(PATIENCE)
        try:
            yield self
        finally:
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(PATIENCE)

    async def _serve(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        async with await asyncio.start_server(self._join, sock=self._listening):
            self._up.set()
            await self._stop.wait()

    async def _join(self, near: asyncio.StreamReader, near_out: asyncio.StreamWriter) -> None:
        far, far_out = await asyncio.open_connection(*self._to)
        left = self._chance.randint(self._after // 2, self._after) if self.cuts > 0 else None
        both = [
            asyncio.create_task(self._carry(near, far_out, left)),
            asyncio.create_task(self._carry(far, near_out, None)),
        ]
        try:
            await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
        finally:  # also where the line is taken away under it
            for task in both:
                task.cancel()
            for writer in (near_out, far_out):
                writer.transport.abort()

    async def _carry(
        self, come: asyncio.StreamReader, go: asyncio.StreamWriter, left: int | None
    ) -> None:
        with suppress(OSError):
            while content := await come.read(4096):
                await asyncio.sleep(self._chance.uniform(0.0, 0.004))
                if left is not None and (left := left - len(content)) <= 0:
                    go.write(content[:left])
                    await go.drain()
                    self.cuts -= 1
                    return
                go.write(content)
                await go.drain()


def badly_delivered(datagrams: list[bytes], seed: int) -> list[bytes]:
    """Datagrams as they come: a tenth lost, a tenth doubled, some up to three places late."""
    chance = random.Random(seed)
    places = [
        (k + chance.choice((0.0, 0.0, 0.0, 3.5)), datagram)
        for k, datagram in enumerate(datagrams)
        for _ in range(chance.choice((0, *[1] * 8, 2)))
    ]
    return [datagram for _, datagram in sorted(places, key=lambda place: place[0])]
