"""The watchers of a flight benchmark, in a separate process: prints what they saw as JSON.

python -m tests.benchmarks.watching_clients ADDRESS SECONDS WATCHERS FROZEN SINCE FLIGHT...

WATCHERS, FROZEN: of each flight.   SINCE: `sent`, when the server had the sample; `t`, its own
time, where that is the machine's monotonic clock.
"""

import asyncio
import json
import re
import sys
import time

from websockets.asyncio.client import ClientConnection, connect

SETTLE_S = 2.0
EVERY = 4
SINCE = {
    "sent": (re.compile(r'"sent":([0-9.]+)'), 1.0),
    "t": (re.compile(r'"t":([0-9.e+]+)'), 1e3),
}
"""What is found in a message, and what it is in milliseconds."""
CONFLATED = re.compile(r'"conflated":(\d+)')
CREDIT = json.dumps({"type": "credit", "n": EVERY})


class Watching:
    """What all watchers of a run saw."""

    def __init__(self, seconds: float, since: str) -> None:
        self.times, self.factor = SINCE[since]
        self.alarms_ms: list[float] = []
        self.begin = time.monotonic() + SETTLE_S
        self.end = self.begin + seconds
        self.latencies_ms: list[float] = []
        self.conflated = 0

    def ages_ms(self, now: float, text: str) -> list[float]:
        return [1e3 * now - self.factor * float(time) for time in self.times.findall(text)]

    async def watch(self, url: str) -> None:
        async with connect(url, compression=None, max_queue=None, proxy=None) as socket:
            n = 0
            while (now := time.monotonic()) < self.end:
                text = str(await socket.recv())
                now = time.monotonic()
                if text.startswith('{"type":"alarm"') and now > self.begin:
                    self.alarms_ms += self.ages_ms(now, text)
                if not text.startswith('{"type":"frames"'):
                    continue
                n += 1
                if n % EVERY == 0:
                    await socket.send(CREDIT)
                if now > self.begin:
                    self.latencies_ms += self.ages_ms(now, text)
                    found = CONFLATED.search(text)
                    self.conflated += int(found[1]) if found else 0


async def frozen(url: str) -> ClientConnection:
    """A watcher that connects and then reads nothing any more."""
    socket = await connect(url, compression=None, max_queue=1, proxy=None, ping_interval=None)
    socket.transport.pause_reading()
    return socket


async def main(
    address: str, seconds: float, each: int, frozen_each: int, since: str, *flights: str
) -> None:
    urls = [f"ws{address.removeprefix('http')}/api/v1/flights/{f}/stream" for f in flights]
    stuck = [await frozen(url) for url in urls for _ in range(frozen_each)]
    watching = Watching(seconds, since)
    await asyncio.gather(*(watching.watch(url) for url in urls for _ in range(each)))
    spent = time.process_time()
    print(
        json.dumps(
            {
                "latencies_ms": watching.latencies_ms,
                "alarms_ms": watching.alarms_ms,
                "conflated": watching.conflated,
                "client_cpu_s": spent,
            }
        )
    )
    for socket in stuck:
        socket.transport.abort()


if __name__ == "__main__":
    address, seconds, each, frozen_each, since, *flights = sys.argv[1:]
    asyncio.run(main(address, float(seconds), int(each), int(frozen_each), since, *flights))
