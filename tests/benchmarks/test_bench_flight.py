"""Flights and their watchers: server, and watchers, each in a separate process."""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest

from app.store.store import open_store
from core.monitor import train
from core.planned_test.collection import DatasetRecipe, collect

pytestmark = pytest.mark.benchmark
SECONDS = 12.0
HZ = os.sysconf("SC_CLK_TCK")


class Server:
    """`forewarn serve` on a fresh data directory with one monitor of the given interval."""

    def __init__(self, process: subprocess.Popen[str], address: str, monitor: str) -> None:
        self.process, self.monitor = process, monitor
        self.client = httpx2.Client(base_url=address, timeout=60, trust_env=False)
        self.address = address

    def fly(self, n: int) -> list[str]:
        """Start n flights that loop; return their ids."""
        ids = []
        for seed in range(n):
            source = {"kind": "simulated", "seed": seed, "outcome": "unsafe"}
            body = {"source": source, "monitor": self.monitor}
            answer = self.client.post("/api/v1/flights", json=body)
            ids.append(answer.raise_for_status().json()["id"])
            loop = {"action": "loop", "value": True}
            self.client.post(f"/api/v1/flights/{ids[-1]}/transport", json=loop).raise_for_status()
        return ids

    @property
    def cpu_s(self) -> float:
        """Processor time spent so far, user and system [s]."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / HZ

    @property
    def memory_mb(self) -> float:
        """Resident memory [MB]."""
        pages = int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return pages * resource.getpagesize() / 1e6


@contextmanager
def serving(directory: Path, dt: float, *options: str) -> Iterator[Server]:
    monitor = kept_monitor(directory, dt)
    with launched(directory, "--port", "0", *options) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        address = next(word for word in line.split() if word.startswith("http"))
        server = Server(process, address, monitor)
        with server.client:
            yield server


def kept_monitor(directory: Path, dt: float, url: str | None = None) -> str:
    """Store a monitor of this interval [s]; its id."""
    recipe = replace(DatasetRecipe(), dt=dt, n_unsafe=30, n_obs=30)
    store = open_store(url or directory / "forewarn.db")
    monitor = store.monitors.add(train(collect(recipe)), "benchmark").id
    store.close()
    return monitor


@contextmanager
def launched(directory: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    code = "import sys; from app.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "serve", "--data-dir", str(directory), *options]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(30)
        if process.stdout:
            process.stdout.close()


def watched(
    server: Server, flights: list[str], each: int, frozen_each: int = 0
) -> tuple[np.ndarray, dict[str, Any]]:
    """Latencies [ms] from when a sample was due to when its watcher had it, and what it cost."""
    command = [sys.executable, "-m", "tests.benchmarks.watching_clients", server.address]
    command += [str(SECONDS), str(each), str(frozen_each), "sent", *flights]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    time.sleep(SECONDS / 4)
    begin, cpu = time.monotonic(), server.cpu_s
    time.sleep(SECONDS / 2)
    share = (server.cpu_s - cpu) / (time.monotonic() - begin)
    memory = server.memory_mb
    out, _ = process.communicate(timeout=120)
    said = json.loads(out)
    return np.array(said.pop("latencies_ms")), said | {"cores": share, "memory_mb": memory}


def report(what: str, latencies: np.ndarray, said: dict[str, Any]) -> None:
    p50, p99 = np.percentile(latencies, [50, 99])
    print(
        f"\n{what}: {len(latencies)} frames, sample to watcher p50 {p50:.1f} ms, p99 {p99:.1f} ms, "
        f"max {latencies.max():.0f} ms, {said['conflated']} conflated; server "
        f"{100 * said['cores']:.0f} % of a core, clients {said['client_cpu_s']:.1f} s in "
        f"{SECONDS:g} s; load {os.getloadavg()[0]:.1f}"
    )


def test_twenty_flights_at_50_hz_with_five_watchers_each(tmp_path: Path) -> None:
    with serving(tmp_path, dt=0.02) as server:
        flights = server.fly(20)
        latencies, said = watched(server, flights, each=5)
    report("20 flights x 5 watchers at 50 Hz", latencies, said)
    assert len(latencies) > 0.5 * 20 * 5 * 50 * SECONDS


def test_one_flight_at_20_hz_with_two_hundred_watchers(tmp_path: Path) -> None:
    with serving(tmp_path, dt=0.05) as server:
        flights = server.fly(1)
        latencies, said = watched(server, flights, each=200)
    report("1 flight x 200 watchers at 20 Hz", latencies, said)
    assert len(latencies) > 0.5 * 200 * 20 * SECONDS


def test_frozen_watchers_cost_little_memory_and_nobody_any_delay(tmp_path: Path) -> None:
    n_frozen = 40
    with serving(tmp_path, dt=0.02) as server:
        flights = server.fly(1)
        warm, _ = watched(server, flights, each=10)
        alone, without = watched(server, flights, each=10)
        together, beside = watched(server, flights, each=10, frozen_each=n_frozen)
    report("1 flight x 10 watchers at 50 Hz", alone, without)
    report(f"the same beside {n_frozen} frozen ones", together, beside)
    each = (beside["memory_mb"] - without["memory_mb"]) / n_frozen
    print(f"a frozen watcher: {1e3 * each:.0f} kB of the server's memory")
    assert len(warm) > 0
    assert len(together) > 0.5 * 10 * 50 * SECONDS
