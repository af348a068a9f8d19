"""Sources and watchers of live flights, cheap enough to load a server on the machine they share.

python -m tests.benchmarks.live_load ADDRESS SECONDS HZ WATCHERS FLIGHT...

WATCHERS: of each flight. A sample's time is when it is due by the machine's monotonic clock, so
that whoever sees it knows how long it took. Nothing is parsed that is not counted. Prints as JSON
what was sent, what was acknowledged as durable and what the watchers saw; a watcher that was not
sent a sample is counted by it.
"""

import asyncio
import json
import re
import sys
import time
from array import array
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import uvloop

from core.channels import KEYS

SETTLE_S = 2.0
"""The first samples are not timed."""
DRAIN_S = 60.0
EVERY = 4
TICK_S = 0.001
ALARM_S = 4.0
"""Into a run, the first source exceeds a limit; the others follow sample by sample."""
BEYOND = 2.0
"""Ny, far beyond its limit [g]."""
HEAD = re.compile(rb'{"type":"frames","seq":(\d+),"conflated":(\d+),"frames":\[{"seq":(\d+)')
COUNT = re.compile(rb'"count":(\d+)')


def masked(text: bytes) -> bytes:
    """A client's frame of a text below 64 kB, its mask all zero."""
    n = len(text)
    head = bytes((0x81, 0x80 | n)) if n < 126 else b"\x81\xfe" + n.to_bytes(2, "big")
    return head + b"\0\0\0\0" + text


CREDIT = masked(json.dumps({"type": "credit", "n": EVERY}).encode())


class WebSocket(asyncio.Protocol):
    """A client that gives each message to `take`, with the time it came."""

    def __init__(self, path: str, take: Callable[[bytes, float], None]) -> None:
        self.path, self.take = path, take
        self.transport: Any = None
        self.open = asyncio.get_running_loop().create_future()
        self._rest = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        self.transport.write(
            f"GET {self.path} HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n".encode()
        )

    def data_received(self, data: bytes) -> None:
        now = time.monotonic()
        data = self._rest + data if self._rest else data
        if not self.open.done():
            head, found, data = data.partition(b"\r\n\r\n")
            if not found:
                self._rest = head
                return
            assert b" 101 " in head, head
            self.open.set_result(None)
        at, size = 0, len(data)
        while at + 4 <= size:
            n, start = data[at + 1], at + 2
            if n == 126:
                n, start = int.from_bytes(data[at + 2 : at + 4], "big"), at + 4
            elif n == 127:
                n, start = int.from_bytes(data[at + 2 : at + 10], "big"), at + 10
            if start + n > size:
                break
            opcode = data[at] & 0x0F
            if opcode == 1:
                self.take(data[start : start + n], now)
            elif opcode == 9:
                self.transport.write(
                    b"\x8a\x80\0\0\0\0" if not n else _pong(data[start : start + n])
                )
            at = start + n
        self._rest = data[at:]


def _pong(payload: bytes) -> bytes:
    return bytes((0x8A, 0x80 | len(payload))) + b"\0\0\0\0" + payload


class Load:
    """What all sources and watchers of a run sent and saw."""

    def __init__(self, seconds: float, hz: float) -> None:
        self.dt, self.n = 1.0 / hz, round(seconds * hz)
        self.sent = self.acknowledged = self.refused = self.conflated = self.gaps = self.seen = 0
        self.messages = 0
        self.late_ms, self.latencies_ms, self.alarms_ms = array("d"), array("d"), array("d")
        self.timed_from = np.inf

    def stored(self, text: bytes, _: float) -> None:
        """Count what a source is told."""
        if text.startswith(b'{"type":"stored"'):
            found = COUNT.search(text)
            self.acknowledged += int(found[1]) if found else 0
        elif text.startswith(b'{"type":"refused"'):
            self.refused += 1


class Watcher:
    """One screen: times each sample it is shown, and counts those it is not."""

    def __init__(self, load: Load, path: str) -> None:
        self.load, self.socket = load, WebSocket(path, self.take)
        self._messages, self.newest = 0, -1
        self.alarmed: set[float] = set()

    def take(self, text: bytes, now: float) -> None:
        load = self.load
        if text.startswith(b'{"type":"frames"'):
            at = text.find(b'"t":')
            while at >= 0:
                t, end = float(text[at + 4 : text.index(b",", at)]), at + 4
                if t >= load.timed_from:
                    load.latencies_ms.append(1e3 * (now - t))
                load.seen += 1
                at = text.find(b'"t":', end)
            self._messages += 1
            load.messages += 1
            if self._messages % EVERY == 0:
                self.socket.transport.write(CREDIT)
            head = HEAD.match(text)
            assert head, text[:200]
            newest, conflated, first = map(int, head.groups())
            load.gaps += first - self.newest - 1
            self.newest = newest
            load.conflated += conflated
        elif text.startswith(b'{"type":"alarm"'):
            at = text.index(b'"t":') + 4
            t = float(text[at : text.index(b",", at)])
            if b'"kind":"limit"' in text and t not in self.alarmed:
                self.alarmed.add(t)
                load.alarms_ms.append(1e3 * (now - t))


async def push(load: Load, sources: list[WebSocket], rows: list[str]) -> None:
    """Send every source its samples as they are due, the sources evenly apart."""
    alarming = json.dumps(dict.fromkeys(KEYS, 0.0) | {"Ny": BEYOND})[1:-1]
    start = time.monotonic() + 0.2
    load.timed_from = start + SETTLE_S
    shift, total = load.dt / len(sources), load.n * len(sources)
    k = 0
    while k < total:
        now = time.monotonic()
        while k < total:
            n, i = divmod(k, len(sources))
            due = start + n * load.dt + i * shift
            if due > now:
                break
            row = alarming if n == round(ALARM_S / load.dt) + i else rows[n % len(rows)]
            text = f'{{"sequence":{n},"t":{due!r},{row}}}'
            sources[i].transport.write(masked(text.encode()))
            load.late_ms.append(1e3 * (now - due))
            load.sent += 1
            k += 1
        await asyncio.sleep(TICK_S)


def values(n: int) -> list[str]:
    """Quiet samples, in JSON without their times."""
    rows = np.random.default_rng(0).normal(0.0, 1e-4, (n, len(KEYS)))
    return [json.dumps(dict(zip(KEYS, row, strict=True)))[1:-1] for row in rows.tolist()]


async def main(address: str, seconds: float, hz: float, each: int, *flights: str) -> None:
    load, loop = Load(seconds, hz), asyncio.get_running_loop()
    host, port = urlsplit(address).hostname, urlsplit(address).port
    paths = [f"/api/v1/flights/{flight}" for flight in flights]
    watchers = [Watcher(load, f"{path}/stream") for path in paths for _ in range(each)]
    sources = [WebSocket(f"{path}/uplink", load.stored) for path in paths]
    for socket in (*(watcher.socket for watcher in watchers), *sources):
        await loop.create_connection(lambda socket=socket: socket, host or "", port or 0)
        await socket.open
    await push(load, sources, values(round(10 * hz)))
    cpu_s, expected = time.process_time(), load.sent * each
    end = time.monotonic() + DRAIN_S
    while time.monotonic() < end and (
        load.acknowledged < load.sent or load.seen + load.gaps < expected
    ):
        await asyncio.sleep(0.05)
    names = "sent", "acknowledged", "refused", "seen", "messages", "gaps", "conflated"
    said = {name: getattr(load, name) for name in names}
    said |= {name: getattr(load, name).tolist() for name in ("latencies_ms", "alarms_ms")}
    said["missing"] = expected - load.seen - load.gaps
    print(json.dumps(said | {"late_ms": float(np.percentile(load.late_ms, 99)), "cpu_s": cpu_s}))


if __name__ == "__main__":
    address, seconds, hz, each, *flights = sys.argv[1:]
    uvloop.run(main(address, float(seconds), float(hz), int(each), *flights))
