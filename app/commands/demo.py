"""The demonstration: a small trained monitor, the server, and a flight that is about to fail."""

import argparse
import asyncio
import os
import sys
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from fastapi import FastAPI
from httpx2 import ASGITransport, AsyncClient

from app.commands import serve as serve_command
from app.commands.output.progress import progress_bar
from app.http.login import COOKIE
from app.jobs.requests import dataset_name
from app.jobs.training import simulate, train_and_test
from app.recipes import to_plain
from app.serving import alone, listen, serve
from app.settings import Settings
from app.store.database import StoreError
from app.store.monitors import MonitorInfo
from app.store.store import Store, open_store
from core import __version__
from core.channels import KEYS
from core.collection import DatasetRecipe, Rollouts
from core.dataset import Dataset
from core.evaluation.rates import evaluate
from core.kernels.compiled import cache_directory
from core.monitor import MonitorRecipe, train
from core.monitor.training import with_validity

NAME = "demonstration"
DATASET = DatasetRecipe(n_unsafe=100).as_flown()
MONITOR = MonitorRecipe()
N_TEST = 1000
SEED = 1


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--no-browser", action="store_true", help="print the address only")
    serve_command.add(parser)


def run(options: argparse.Namespace) -> int:
    """Demonstrate, and open the page where there is a display."""
    has_display = sys.platform != "linux" or "DISPLAY" in os.environ
    has_display = has_display or "WAYLAND_DISPLAY" in os.environ
    settings = serve_command.settings_of(options)
    demonstrate(settings, serve_command.say, browser=has_display and not options.no_browser)
    return 0


def demonstrate(settings: Settings, say: Callable[[str], None], *, browser: bool) -> None:
    """Prepare, serve, fly; returns when interrupted.   browser: open the page there.

    SettingsError where the address is taken, before anything is trained.
    """
    listening = listen(settings)
    try:
        with alone(settings):
            store = open_store(settings.url)
            try:
                monitor_id = prepare(store, say)
            finally:
                store.close()
    except BaseException:
        listening.close()
        raise

    async def opened(app: FastAPI, address: str) -> None:
        flight = await fly(app, monitor_id)
        page = f"{address}/#/fly/{flight}"
        say(f"flying at {page} (stop with Ctrl+C)")
        serve_command.say_link(app, address)
        page = serve_command.login_link(app, address) or page
        if browser and not await asyncio.to_thread(webbrowser.open, page):
            say("no browser could be opened: open the address yourself")

    serve(settings, opened, listening)


def prepare(store: Store, say: Callable[[str], None]) -> str:
    """Return the id of the demonstration's monitor, trained unless this version did it before."""
    for info in store.monitors.all():
        same = (info.recipe, info.dataset_recipe) == (to_plain(MONITOR), to_plain(DATASET))
        if info.name == NAME and info.version == __version__ and same:
            try:
                store.monitors.get(info.id)
            except (StoreError, ValueError):
                say(f"the monitor {NAME!r} there is of an older program")
                continue
            say(f"the monitor {NAME!r} is there already")
            _warn(info, say)
            return info.id
    say(f"training a small monitor: {DATASET.n_unsafe} unsafe rollouts")
    with compiling_ahead() as wait:
        with progress_bar("unsafe rollouts") as progress:
            dataset = simulate(DATASET, lambda _, done, total: progress(done, total))
        wait()
    stored = store.datasets.add(dataset, dataset_name(DATASET))
    trained = train_and_test(dataset, MONITOR, N_TEST, lambda *_: None)
    info = store.monitors.add(trained.monitor, NAME, stored.id)
    _warn(info, say)
    return info.id


@contextmanager
def compiling_ahead() -> Iterator[Callable[[], object]]:
    """On a machine without compiled kernels, let another process compile those of training.

    Yields what waits until it has: the first rollouts compile theirs meanwhile, and a cache on the
    disk is shared. That halves the wait for the first page.
    """
    if any(Path(cache_directory()).rglob("*.nbi")):
        yield lambda: None
        return
    process = get_context("spawn").Process(target=train_on_noise, daemon=True)
    process.start()
    try:
        yield process.join
    finally:
        process.kill()
        process.join()


def train_on_noise() -> None:
    """Train a monitor on random numbers and fly some through it: every kernel of that is used."""
    rng = np.random.default_rng(SEED)
    n, n_samples = 400, DATASET.maneuver.n_samples(DATASET.dt)
    y = rng.normal(size=(n, n_samples, len(KEYS))).cumsum(axis=1)
    fail_index = np.where(np.arange(n) % 4 == 0, n_samples // 2, n_samples)
    flights = Rollouts(y, fail_index, np.zeros((n, 1)))
    safe, unsafe = flights.some(~flights.is_unsafe), flights.some(flights.is_unsafe)
    times = np.arange(DATASET.n_obs) + np.zeros((len(safe.y), 1), np.int64)
    unsafe.y[:, n_samples // 2 + 1 :] = np.nan
    dataset = Dataset(
        unsafe.y, unsafe.fail_index, safe.y, times, unsafe.theta, safe.theta, DATASET.dt, ("x",)
    )
    monitor = with_validity(train(dataset, MONITOR), dataset, repeat(flights, 100))
    evaluate(monitor, flights.y, flights.fail_index)
    monitor.stream().update(0.0, y[0, 0])


def _warn(info: MonitorInfo, say: Callable[[str], None]) -> None:
    for warning in info.warnings:
        say(f"WARNING: {warning}")


async def fly(app: FastAPI, monitor_id: str) -> str:
    """Start a flight of a fresh aircraft that will exceed its limit, over and over; its id."""
    session = app.state.sessions.begin(app.state.people.server)
    headers = {"Cookie": f"{COOKIE}={session}"}
    source = {"kind": "simulated", "outcome": "unsafe", "seed": SEED}
    base = "http://127.0.0.1"
    async with AsyncClient(transport=ASGITransport(app), base_url=base, headers=headers) as client:
        answer = await client.post(
            "/api/v1/flights", json={"source": source, "monitor": monitor_id}
        )
        if answer.is_error:
            raise ValueError(f"the demonstration cannot fly: {answer.json()['detail']}")
        flight = answer.json()["id"]
        loop = {"action": "loop", "value": True}
        (await client.post(f"/api/v1/flights/{flight}/transport", json=loop)).raise_for_status()
    app.state.sessions.end(session)
    return flight
