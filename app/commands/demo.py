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
from typing import Any

import numpy as np
from fastapi import FastAPI
from httpx2 import ASGITransport, AsyncClient, Response

from app.commands import serve as serve_command
from app.commands.output.progress import progress_bar
from app.http.login import COOKIE
from app.recipes import limits_named, to_plain
from app.serving import listen, serve
from app.settings import Settings
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
LOOK_EVERY_S = 0.25
"""How often it is asked how far the training is [s]."""


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--no-browser", action="store_true", help="print the address only")
    serve_command.add(parser)


def run(options: argparse.Namespace) -> int:
    """Demonstrate, and open the page where there is a display."""
    has_display = sys.platform != "linux" or "DISPLAY" in os.environ
    has_display = has_display or "WAYLAND_DISPLAY" in os.environ
    settings = serve_command.settings_of(options)
    return demonstrate(settings, serve_command.say, browser=has_display and not options.no_browser)


def demonstrate(settings: Settings, say: Callable[[str], None], *, browser: bool) -> int:
    """Serve the page, train there and fly; returns when interrupted, 1 where something failed.

    browser: open the page.   SettingsError where the address is taken, before anything is trained.
    """
    listening = listen(settings)
    under_way: list[asyncio.Task[None]] = []

    async def opened(app: FastAPI, address: str) -> None:
        under_way.append(asyncio.create_task(show(app, address, say, browser=browser)))

    with compiling_ahead():
        serve(settings, opened, listening)
    return int(any(task.done() and not task.cancelled() and task.exception() for task in under_way))


async def show(app: FastAPI, address: str, say: Callable[[str], None], *, browser: bool) -> None:
    """Say where the page is, have a monitor and fly through it. What fails is said, and raised."""
    session = app.state.sessions.begin(app.state.people.server)
    headers = {"Cookie": f"{COOKIE}={session}"}
    base = "http://127.0.0.1/api/v1"
    try:
        async with AsyncClient(
            transport=ASGITransport(app), base_url=base, headers=headers, timeout=None
        ) as client:
            monitor = await known_monitor(client, say)
            if is_new := monitor is None:
                job = await begun_training(client)
                say(f"training a small monitor: {DATASET.n_unsafe} unsafe rollouts, at {address}")
                await _welcome(app, address, "", say, browser)
                monitor = await trained_monitor(client, job)
            _warn(monitor, say)
            page = f"/#/fly/{await fly(client, monitor['id'])}"
    except ValueError as error:
        say(f"ERROR: {error}")
        raise
    finally:
        app.state.sessions.end(session)
    say(f"flying at {address}{page} (stop with Ctrl+C)")
    if not is_new:
        await _welcome(app, address, page, say, browser)


async def _welcome(
    app: FastAPI, address: str, page: str, say: Callable[[str], None], browser: bool
) -> None:
    """Say how to log in, where that is asked, and open a page."""
    serve_command.say_link(app, address)
    there = serve_command.login_link(app, address) or address + page
    if browser and not await asyncio.to_thread(webbrowser.open, there):
        say("no browser could be opened: open the address yourself")


async def known_monitor(client: AsyncClient, say: Callable[[str], None]) -> dict[str, Any] | None:
    """The demonstration's monitor, where this version trained it before. ValueError."""
    wanted = [NAME, __version__, to_plain(MONITOR), limits_named(to_plain(DATASET))]
    for monitor in _answered(await client.get("/monitors")):
        if [monitor[key] for key in ("name", "version", "recipe", "dataset_recipe")] != wanted:
            continue
        if (await client.get(f"/monitors/{monitor['id']}/calibration")).is_success:
            say(f"the monitor {NAME!r} is there already")
            return monitor
        say(f"the monitor {NAME!r} there is of an older program")
    return None


async def begun_training(client: AsyncClient) -> dict[str, Any]:
    """The job that trains the demonstration's monitor, as one asked for on the page. ValueError."""
    order = {"name": NAME, "dataset": to_plain(DATASET), "n_test": N_TEST} | to_plain(MONITOR)
    return _answered(await client.post("/monitors", json=order))


async def trained_monitor(client: AsyncClient, job: dict[str, Any]) -> dict[str, Any]:
    """The monitor that a job makes. ValueError where it makes none."""
    with progress_bar("training") as progress:
        while job["ended"] is None:
            await asyncio.sleep(LOOK_EVERY_S)
            job = _answered(await client.get(f"/jobs/{job['id']}"))
            progress(job["progress"] or 0, job["total"] or 0)
    if job["status"] != "done":
        raise ValueError(f"no monitor was trained, {job['status']}: {job['error'] or 'as asked'}")
    return _answered(await client.get(f"/monitors/{job['result']['monitor']}"))


def _answered(answer: Response) -> Any:
    """What was answered. ValueError."""
    if answer.is_error:
        raise ValueError(f"the demonstration goes no further: {answer.json()['detail']}")
    return answer.json()


@contextmanager
def compiling_ahead() -> Iterator[None]:
    """On a machine without compiled kernels, let another process compile those of training.

    The first rollouts compile theirs meanwhile, and a cache on the disk is shared: that halves the
    wait for the first flight.
    """
    if any(Path(cache_directory()).rglob("*.nbi")):
        yield
        return
    process = get_context("spawn").Process(target=train_on_noise, daemon=True)
    process.start()
    try:
        yield
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


def _warn(monitor: dict[str, Any], say: Callable[[str], None]) -> None:
    for warning in monitor["warnings"]:
        say(f"WARNING: {warning}")


async def fly(client: AsyncClient, monitor_id: str) -> str:
    """Start a flight of a fresh aircraft that will exceed its limit, over and over; its id."""
    source = {"kind": "simulated", "outcome": "unsafe", "seed": SEED}
    flight = _answered(
        await client.post(
            "/flights", json={"source": source, "monitor": monitor_id, "wait_for_viewer": True}
        )
    )
    loop = {"action": "loop", "value": True}
    _answered(await client.post(f"/flights/{flight['id']}/transport", json=loop))
    return flight["id"]
