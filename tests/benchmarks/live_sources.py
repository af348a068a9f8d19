"""The sources of a live benchmark, in a process of their own: a WebSocket a flight.

python -m tests.benchmarks.live_sources ADDRESS SECONDS HZ FLIGHT...

A sample's time is when it is due by the machine's monotonic clock, so that whoever sees it knows
how long it took. Prints as JSON what was sent and what was acknowledged as durable.
"""

import asyncio
import json
import sys
import time

import numpy as np
from websockets.asyncio.client import connect

from core.channels import KEYS


class Sources:
    """What all sources of a run sent, and what came back."""

    def __init__(self, seconds: float, hz: float) -> None:
        self.dt, self.n = 1.0 / hz, round(seconds * hz)
        self.sent = self.acknowledged = self.refused = 0
        self.late_ms: list[float] = []

    async def send(self, url: str, start: float) -> None:
        async with connect(url, compression=None, proxy=None) as socket:
            acknowledging = asyncio.create_task(self.acknowledge(socket))
            values = np.random.default_rng(0).normal(0.0, 1e-4, (self.n, len(KEYS)))
            for k, row in enumerate(values.tolist()):
                due = start + k * self.dt
                await asyncio.sleep(max(0.0, due - time.monotonic()))
                self.late_ms.append(1e3 * (time.monotonic() - due))
                batch = {"sequence": k, "t": due, **dict(zip(KEYS, row, strict=True))}
                await socket.send(json.dumps(batch))
                self.sent += 1
            async with asyncio.timeout(120):
                await acknowledging

    async def acknowledge(self, socket: object) -> None:
        n = 0
        async for text in socket:  # type: ignore[attr-defined]
            message = json.loads(text)
            if message["type"] == "stored":
                n += message["count"]
                self.acknowledged += message["count"]
            self.refused += message["type"] == "refused"
            if n == self.n:
                return


async def main(address: str, seconds: float, hz: float, *flights: str) -> None:
    sources = Sources(seconds, hz)
    urls = [f"ws{address.removeprefix('http')}/api/v1/flights/{f}/uplink" for f in flights]
    start = time.monotonic() + 1.0
    shift = sources.dt / len(urls)
    await asyncio.gather(*(sources.send(url, start + i * shift) for i, url in enumerate(urls)))
    said = {name: getattr(sources, name) for name in ("sent", "acknowledged", "refused")}
    said["late_ms"] = float(np.percentile(sources.late_ms, 99))
    said["cpu_s"] = time.process_time()
    print(json.dumps(said))


if __name__ == "__main__":
    address, seconds, hz, *flights = sys.argv[1:]
    asyncio.run(main(address, float(seconds), float(hz), *flights))
