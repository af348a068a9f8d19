"""Live flights through real sockets: sources, server and watchers, each in a process of its own."""

import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.benchmarks.test_bench_flight import Server, serving

pytestmark = pytest.mark.benchmark
SECONDS = float(os.environ.get("FOREWARN_LIVE_SECONDS", "12"))
"""Of a run; half an hour is a soak."""


def start(server: Server, n: int, **source: Any) -> list[str]:
    """Start n live flights; their ids."""
    ids = []
    for _ in range(n):
        body = {"source": {"kind": "live", "trim": "none"} | source, "monitor": server.monitor}
        answer = server.client.post("/api/v1/flights", json=body)
        ids.append(answer.raise_for_status().json()["id"])
    return ids


@contextmanager
def python(*arguments: object) -> Iterator[Callable[[], dict[str, Any]]]:
    """A module in a process of its own; what it prints when it ends."""
    command = [sys.executable, "-m", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield lambda: json.loads(process.communicate(timeout=SECONDS + 120)[0])


def flown(server: Server, flights: list[str], each: int, hz: float) -> dict[str, Any]:
    """Push at hz into every flight and watch each; latencies from when a sample was due."""
    watchers = "tests.benchmarks.watching_clients", server.address, SECONDS, each, 0, "t"
    sources = "tests.benchmarks.live_sources", server.address, SECONDS + 1.0, hz
    with python(*watchers, *flights) as watched, python(*sources, *flights) as pushed:
        time.sleep(SECONDS / 3)
        began, cpu, memory = time.monotonic(), server.cpu_s, server.memory_mb
        time.sleep(SECONDS / 2)
        cores = (server.cpu_s - cpu) / (time.monotonic() - began)
        grown = server.memory_mb - memory
        return pushed() | watched() | {"cores": cores, "grown_mb": grown}


def report(what: str, run: dict[str, Any]) -> None:
    p50, p99 = np.percentile(run["latencies_ms"], [50, 99])
    print(
        f"\n{what}: {run['sent']} sent, {run['acknowledged']} durable, "
        f"{len(run['latencies_ms'])} frames seen, due to watcher p50 {p50:.1f} ms, p99 {p99:.1f} "
        f"ms, {run['conflated']} conflated; server {100 * run['cores']:.0f} % of a core, grown by "
        f"{run['grown_mb']:.1f} MB; the sources themselves late by p99 {run['late_ms']:.1f} ms"
    )
    if run["alarms_ms"]:
        p50, p99 = np.percentile(run["alarms_ms"], [50, 99])
        print(f"{len(run['alarms_ms'])} alarms seen, p50 {p50:.1f} ms, p99 {p99:.1f} ms")


@pytest.mark.parametrize(("n", "each", "hz"), [(1, 4, 1000.0), (10, 4, 50.0), (50, 4, 50.0)])
def test_no_sample_is_lost(
    n: int, each: int, hz: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FOREWARN_MAX_FLIGHTS", str(n))
    with serving(tmp_path, dt=0.02) as server:
        flights = start(server, n)
        run = flown(server, flights, each, hz)
        counts = [
            server.client.get(f"/api/v1/flights/{flight}/samples").json()["counts"]["accepted"]
            for flight in flights
        ]
    report(f"{n} live flights at {hz:g} Hz, {each} watchers each", run)
    assert run["sent"] == run["acknowledged"] == sum(counts)
    assert run["refused"] == 0


def flood(address: str, stop: threading.Event, sent: list[int]) -> None:
    """Ten thousand datagrams a second that are no batch."""
    host, port = address.rsplit(":", 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        began = time.monotonic()
        while not stop.is_set():
            if sent[0] > 1e4 * (time.monotonic() - began):
                time.sleep(0.001)
                continue
            sender.sendto(b'{"sequence": -1, nonsense', (host, int(port)))
            sent[0] += 1


def test_a_flood_of_nonsense_from_one_peer_starves_no_other(tmp_path: Path) -> None:
    with serving(tmp_path, dt=0.02) as server:
        flights = start(server, 2)
        (flooded,) = start(server, 1, udp=0)
        alone = flown(server, flights, 4, 50.0)
        path, stop, sent = f"/api/v1/flights/{flooded}/samples", threading.Event(), [0]
        address = server.client.get(path).json()["udp"]
        thread = threading.Thread(target=flood, args=(address, stop, sent))
        thread.start()
        beside = flown(server, start(server, 2), 4, 50.0)
        stop.set()
        thread.join()
        malformed = server.client.get(path).json()["malformed"]
    report("2 live flights", alone)
    report(f"the same beside {sent[0]} datagrams of nonsense, {malformed} read", beside)
    assert beside["sent"] == beside["acknowledged"]
    assert malformed > 0.5 * sent[0]
