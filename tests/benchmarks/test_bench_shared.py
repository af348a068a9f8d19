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
N_TAKEN = 5


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
            flights = start(server, N)
            run = flown(server, flights, EACH, 1.0 / DT)
            report(f"{N} live flights, {EACH} watchers each, by {way}", run)
            assert run["sent"] == run["acknowledged"]
            assert run["missing"] == 0
            for flight in flights:
                server.client.post(f"/api/v1/flights/{flight}/end").raise_for_status()


def test_the_time_of_a_take_over(tmp_path: Path, postgresql: PostgreSQL) -> None:
    """From the kill of the owner to the first sample of each flight that is durable again."""
    url = postgresql.new_database()
    about, times = (tmp_path, kept_monitor(tmp_path, DT, url)), []
    with reserved_port() as one, reserved_port() as two:
        for _ in range(N_TAKEN):
            with sharing(*about, one, url) as owner, sharing(*about, two, url) as other:
                clients = [LiveClient(other.address) for _ in range(N)]
                for client in clients:
                    client.start(other.monitor, trim="none")
                samples = (
                    {"t": DT * k}
                    | dict.fromkeys(("beta", "p", "r", "Ny", "delta_a", "delta_r"), 0.0)
                    for k in range(1_000_000)
                )
                for _ in range(500):
                    for client, sample in zip(clients, N * [next(samples)], strict=True):
                        client.send(sample)
                    time.sleep(DT / 4)
                for client in clients:
                    assert client.flush()
                owner.process.kill()
                killed = time.monotonic()
                for client in clients:
                    client.send(next(samples))
                for client in clients:
                    assert client.flush()
                times.append(time.monotonic() - killed)
                for client in clients:
                    client.end()
                    client.close()
    low, middle, high = np.percentile(times, [0, 50, 100])
    print(
        f"\n{N} flights, the owner killed {N_TAKEN} times: durable again in all after "
        f"{middle:.2f} s ({low:.2f} to {high:.2f}), load {os.getloadavg()[0]:.1f}"
    )
