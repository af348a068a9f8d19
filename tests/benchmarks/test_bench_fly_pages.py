"""Fly pages open in Chromium beside a live flight, in turns with none."""

import os
import secrets
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import insert

from app.store.store import open_store
from app.store.tables import flights
from tests.benchmarks.test_bench_flight import Server, serving
from tests.benchmarks.test_bench_live import flown, start
from tests.browser.chromium import open_chromium

pytestmark = pytest.mark.benchmark
N_PAGES, N_ENDED, PAIRS, HZ = 3, 3_000, 5, 50.0


def copy_ended(directory: Path, flight: str) -> None:
    """Years of ended flights: copies of the row of one, which a list is made of."""
    store = open_store(directory / "forewarn.db", recover=False)
    with store.engine.begin() as connection:
        row = connection.execute(flights.select().where(flights.c.id == flight)).one()._asdict()
        connection.execute(
            insert(flights), [row | {"id": secrets.token_hex(6)} for _ in range(N_ENDED)]
        )
    store.close()


def p99_ms(run: dict[str, Any]) -> float:
    assert run["missing"] == run["refused"] == 0
    return float(np.percentile(run["latencies_ms"], 99))


def end(server: Server, flight: str) -> None:
    server.client.post(f"/api/v1/flights/{flight}/end").raise_for_status()


def test_open_fly_pages_beside_a_live_flight(tmp_path: Path) -> None:
    """The flight exceeds a limit in each run, so that the lists change."""
    with serving(tmp_path, dt=1.0 / HZ) as server:
        (first,) = server.fly(1)  # a live flight would have a journal, which its copies have not
        end(server, first)
    copy_ended(tmp_path, first)
    rises, cpu = [], []
    with serving(tmp_path, dt=1.0 / HZ) as server, open_chromium() as browser:
        while (health := server.client.get("/api/v1/integrity").json())["state"] != "checked":
            time.sleep(0.5)
        assert health["damaged"] == []
        for pair in range(PAIRS):
            p99 = {}
            for n_pages in (0, N_PAGES) if pair % 2 else (N_PAGES, 0):
                (flight,) = start(server, 1)
                pages = [browser.new_page() for _ in range(n_pages)]
                for page in pages:
                    page.goto(f"{server.address}/#/fly")
                    page.locator(f'[data-flight="{flight}"]').wait_for()
                run = flown(server, [flight], 1, HZ)
                p99[n_pages] = p99_ms(run)
                cpu.append((n_pages, run["cores"]))
                for page in pages:
                    page.close()
                end(server, flight)
            rises.append(p99[N_PAGES] - p99[0])
            print(
                f"\np99 from due to watcher {p99[0]:.2f} ms without a Fly page, "
                f"{p99[N_PAGES]:.2f} ms with {N_PAGES}; load {os.getloadavg()[0]:.1f}"
            )
    used = {n: 100 * np.median([cores for pages, cores in cpu if pages == n]) for n in (0, N_PAGES)}
    print(
        f"\n{N_PAGES} open Fly pages of {N_ENDED} ended flights: the live p99 rises by "
        f"{np.median(rises):.2f} ms, the median of {PAIRS} pairs ({min(rises):.2f} to "
        f"{max(rises):.2f}); server {used[0]:.1f} and {used[N_PAGES]:.1f} % of a core"
    )
