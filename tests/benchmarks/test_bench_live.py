"""Live flights through real sockets: sources and watchers in one process, the server in another."""

import json
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.benchmarks.test_bench_flight import Server, serving

pytestmark = pytest.mark.benchmark
SECONDS = float(os.environ.get("LIVE_SECONDS", "12"))
"""Of a run; half an hour is a soak."""
LOOK_S = 1.0


def start(server: Server, n: int, **source: Any) -> list[str]:
    """Start n live flights; their ids."""
    ids = []
    for _ in range(n):
        body = {"source": {"kind": "live", "trim": "none"} | source, "monitor": server.monitor}
        answer = server.client.post("/api/v1/flights", json=body)
        ids.append(answer.raise_for_status().json()["id"])
    return ids


def flown(
    server: Server, flights: list[str], each: int, hz: float, *wrapped: str
) -> dict[str, Any]:
    """Push at hz into every flight and watch each; latencies from when a sample was due.

    wrapped: a command that runs the sources and screens.

    cpu_us: of the server for a sample and all its frames.   cores: that it used meanwhile.
    memory_mb: second by second.
    """
    load = [*wrapped, sys.executable, "-m", "tests.benchmarks.live_load", server.address]
    load += [*map(str, (SECONDS, hz, each)), *flights]
    began, began_cpu, memory_mb = time.monotonic(), server.cpu_s, []
    with subprocess.Popen(load, stdout=subprocess.PIPE, text=True) as process:
        reading = threading.Thread(target=_look, args=(server, process, memory_mb))
        reading.start()
        run = json.loads(process.communicate(timeout=SECONDS + 120)[0])
        reading.join()
    cpu_s = server.cpu_s - began_cpu
    cores = cpu_s / (time.monotonic() - began)
    return run | {"cpu_us": 1e6 * cpu_s / run["sent"], "cores": cores, "memory_mb": memory_mb}


def _look(server: Server, process: subprocess.Popen[str], memory_mb: list[float]) -> None:
    while process.poll() is None:
        time.sleep(LOOK_S)
        memory_mb.append(server.memory_mb)


def report(what: str, run: dict[str, Any]) -> None:
    p50, p99 = np.percentile(run["latencies_ms"], [50, 99])
    settled = np.array(run["memory_mb"])[len(run["memory_mb"]) // 3 :]
    slope = 60.0 * np.polyfit(LOOK_S * np.arange(len(settled)), settled, 1)[0]
    print(
        f"\n{what}: {run['sent']} sent, {run['acknowledged']} durable, {run['seen']} frames seen, "
        f"{run['conflated']} conflated, {run['missing']} missing; due to watcher p50 {p50:.1f} ms, "
        f"p99 {p99:.1f} ms; server {100 * run['cores']:.0f} % of a core, {run['cpu_us']:.0f} us a "
        f"sample of {run['messages'] / run['sent']:.1f} messages, {settled[-1]:.0f} MB, growing "
        f"by {slope:.1f} MB/min; the sources late by p99 {run['late_ms']:.1f} ms; load "
        f"{os.getloadavg()[0]:.1f}"
    )
    if run["alarms_ms"]:
        p50, p99 = np.percentile(run["alarms_ms"], [50, 99])
        print(f"{len(run['alarms_ms'])} alarms seen, p50 {p50:.1f} ms, p99 {p99:.1f} ms")


@pytest.mark.parametrize(("n", "each", "hz"), [(1, 4, 1000.0), (10, 4, 50.0), (50, 4, 50.0)])
def test_no_sample_is_lost(
    n: int, each: int, hz: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FOREWARN_MAX_FLIGHTS", str(n))
    with serving(tmp_path, dt=1.0 / hz) as server:
        flights = start(server, n)
        run = flown(server, flights, each, hz)
        counts = [
            server.client.get(f"/api/v1/flights/{flight}/samples").json()["counts"]["accepted"]
            for flight in flights
        ]
    report(f"{n} live flights at {hz:g} Hz, {each} watchers each", run)
    assert run["sent"] == run["acknowledged"] == sum(counts)
    assert run["refused"] == run["missing"] == 0


@contextmanager
def busy(n: int) -> Iterator[None]:
    """Beside n programs that use all the processor time they get."""
    programs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(n)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


@pytest.mark.parametrize("options", [(), ("--real-time",)], ids=["usual", "real time"])
def test_fifty_flights_on_a_busy_machine(
    options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sources and screens are other machines': they run before all else, as the server may."""
    if shutil.which("chrt") is None:
        pytest.skip("chrt is not installed")
    monkeypatch.setenv("FOREWARN_MAX_FLIGHTS", "50")
    with serving(tmp_path, 0.02, *options) as server:
        flights = start(server, 50)
        with busy(4 * (os.cpu_count() or 1)):
            run = flown(server, flights, 4, 50.0, "chrt", "-r", "1")
    report(f"50 live flights beside four programs for each core, options {options}", run)
    assert run["sent"] == run["acknowledged"]
    assert run["missing"] == 0


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


def flood_http(address: str, path: str, stop: threading.Event, sent: list[int]) -> None:
    """Requests that are no batch, as fast as one connection takes them, answers unread but away."""
    body = b"nonsense"
    request = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(body)}\r\n\r\n"
    ahead = 100 * (request.encode() + body)
    host, port = address.removeprefix("http://").rsplit(":", 1)
    with socket.create_connection((host, int(port))) as sender:
        sender.settimeout(0.05)
        while not stop.is_set():
            with suppress(TimeoutError):
                sent[0] += sender.send(ahead) // (len(ahead) // 100)
                sender.recv(1 << 20)


def test_a_flood_of_malformed_requests_from_one_peer_starves_no_other(tmp_path: Path) -> None:
    with serving(tmp_path, dt=0.02) as server:
        (flooded,) = start(server, 1)
        alone = flown(server, start(server, 2), 4, 50.0)
        path, stop, sent = f"/api/v1/flights/{flooded}/samples", threading.Event(), [0]
        about = server.address, path, stop, sent
        threads = [threading.Thread(target=flood_http, args=about) for _ in range(4)]
        flights = start(server, 2)
        for thread in threads:
            thread.start()
        beside = flown(server, flights, 4, 50.0)
        stop.set()
        for thread in threads:
            thread.join()
        malformed = server.client.get(path, timeout=30).json()["malformed"]
    report("2 live flights", alone)
    report(f"the same beside {sent[0]} malformed requests, {malformed} read", beside)
    assert beside["sent"] == beside["acknowledged"]
    assert beside["missing"] == 0
