"""Two servers that share a database: latency through the one that relays, and the take-over."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from app.client import LiveClient
from tests.benchmarks.test_bench_flight import Server, kept_monitor, launched
from tests.benchmarks.test_bench_live import flown, report, start
from tests.faults.server import answers, reserved_port
from tests.support.patience import until
from tests.support.postgresql import PostgreSQL

pytestmark = [pytest.mark.benchmark, pytest.mark.services]
DT = 0.02
N, EACH = 20, 4
BATCH, N_LAST = 100, 500
"""Samples sent at once, and the newest ones, sent one by one."""
RESTS = 0.1
"""[s] Processor time in a second of a server that has caught up."""


@contextmanager
def sharing(directory: Path, monitor: str, port: int, url: str) -> Iterator[Server]:
    address = f"http://127.0.0.1:{port}"
    options = "--port", str(port), "--shared", address, "--database-url", url
    with launched(directory, *options) as process:
        server = Server(process, address, monitor)
        with server.client:
            until(lambda: answers(server.client))
            yield server


def test_flights_through_the_server_that_relays(tmp_path: Path, postgresql: PostgreSQL) -> None:
    url = postgresql.new_database()
    about = tmp_path, kept_monitor(tmp_path, DT, url)
    with (
        reserved_port() as one,
        reserved_port() as two,
        sharing(*about, one, url) as owner,
        sharing(*about, two, url) as other,
    ):
        for server, way in ((owner, "the owner"), (other, "the one that relays")):
            flights, waiting_cpu, began = start(server, N), other.cpu_s, time.monotonic()
            run = flown(server, flights, EACH, 1.0 / DT)
            share = (other.cpu_s - waiting_cpu) / (time.monotonic() - began)
            report(f"{N} live flights, {EACH} watchers each, by {way}", run)
            print(f"the waiting server {100 * share:.0f} % of a core")
            assert run["sent"] == run["acknowledged"]
            assert run["missing"] == 0
            for flight in flights:
                server.client.post(f"/api/v1/flights/{flight}/end").raise_for_status()


def samples(first: int, n: int) -> dict[str, list[float]]:
    keys = "beta", "p", "r", "Ny", "delta_a", "delta_r"
    return {"t": [DT * k for k in range(first, first + n)]} | {key: n * [0.0] for key in keys}


def rests(server: Server) -> bool:
    """Whether a server has caught up; after a second."""
    before = server.cpu_s
    time.sleep(1.0)
    return server.cpu_s - before < RESTS


@pytest.mark.parametrize(("seconds", "n_taken"), [(10, 5), (120, 3), (600, 1)])
def test_the_time_of_a_take_over(
    tmp_path: Path, postgresql: PostgreSQL, seconds: int, n_taken: int
) -> None:
    """From the kill of the owner to the first sample of each flight that is durable again.

    The flights are sent faster than real time, but for their end.
    """
    url = postgresql.new_database()
    about, times = (tmp_path, kept_monitor(tmp_path, DT, url)), []
    with reserved_port() as one, reserved_port() as two:
        for _ in range(n_taken):
            with sharing(*about, one, url) as owner, sharing(*about, two, url) as other:
                clients = [LiveClient(other.address) for _ in range(N)]
                for client in clients:
                    client.start(other.monitor, trim="none")
                n = round(seconds / DT) - N_LAST
                for first in range(0, n, BATCH):
                    for client in clients:
                        client.send_batch(samples(first, min(BATCH, n - first)))
                    for client in clients:
                        assert client.flush()
                while not rests(other):
                    pass
                for k in range(n, n + N_LAST):
                    for client in clients:
                        client.send_batch(samples(k, 1))
                    time.sleep(DT)
                for client in clients:
                    assert client.flush()
                owner.process.kill()
                killed = time.monotonic()
                for client in clients:
                    client.send_batch(samples(n + N_LAST, 1))
                for client in clients:
                    assert client.flush()
                times.append(time.monotonic() - killed)
                for client in clients:
                    client.end()
                    client.close()
    low, middle, high = np.percentile(times, [0, 50, 100])
    print(
        f"\n{N} flights of {seconds} s, the owner killed {n_taken} times: durable again in all "
        f"after {middle:.2f} s ({low:.2f} to {high:.2f}), load {os.getloadavg()[0]:.1f}"
    )
