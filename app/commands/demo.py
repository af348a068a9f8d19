"""The demonstration: the page opens at once, and a small monitor is trained and flown meanwhile."""

import argparse
import asyncio
import os
import sys
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import repeat
from multiprocessing import get_context

import numpy as np
from fastapi import FastAPI

from app.commands import serve as serve_command
from app.commands.options.option import option
from app.commands.output.results import progress_bar
from app.demonstration import (
    DATASET,
    LOOK_EVERY_S,
    MONITOR,
    SEED,
    Demonstration,
    n_kernels,
)
from app.serving import listen, serve
from app.settings import Settings
from core.channels import KEYS
from core.dataset import Dataset
from core.evaluation.rates import evaluate
from core.monitor import train
from core.monitor.training import with_validity
from core.planned_test.collection import Rollouts

PAGE = "/#/demonstration"
BAR_STEPS = 100


def add(parser: argparse.ArgumentParser) -> None:
    option(parser, "--no-browser", "print the address only")
    serve_command.add_server(parser)


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
    tasks: list[asyncio.Task[None]] = []

    with ExitStack() as stack:

        async def opened(app: FastAPI, address: str) -> None:
            stack.enter_context(compiling_ahead())
            tasks.append(asyncio.create_task(show(app, address, say, browser=browser)))

        serve(settings, opened, listening)
    return int(any(task.done() and not task.cancelled() and task.exception() for task in tasks))


async def show(app: FastAPI, address: str, say: Callable[[str], None], *, browser: bool) -> None:
    """Open the page, prepare the live flight and print its address. ValueError where that fails."""
    say(f"open {address}{PAGE} (stop with Ctrl+C)")
    demonstration: Demonstration = app.state.demonstration
    flight = demonstration.start()
    if browser and not await asyncio.to_thread(webbrowser.open, address + PAGE):
        say("no browser could be opened: open the address yourself")
    try:
        await _show_progress(demonstration, flight, say)
        for warning in (demonstration.monitor or {}).get("warnings", ()):
            say(f"WARNING: {warning}")
        say(f"flying at {address}/#/fly/{await flight}")
    except ValueError as error:
        say(f"ERROR: {error}")
        raise


async def _show_progress(
    demonstration: Demonstration, flight: "asyncio.Task[str]", say: Callable[[str], None]
) -> None:
    """Draw a bar until the flight has started; nothing where that takes no time."""
    await asyncio.wait([flight], timeout=LOOK_EVERY_S)
    if flight.done():
        return
    say("a recorded demonstration plays meanwhile; the live one compiles and trains, once")
    with progress_bar("preparing the live demonstration") as progress:
        while not flight.done():
            now = demonstration.progress
            progress(round(BAR_STEPS * now.share) if now else 0, BAR_STEPS)
            await asyncio.wait([flight], timeout=LOOK_EVERY_S)
        progress(BAR_STEPS, BAR_STEPS)


@contextmanager
def compiling_ahead() -> Iterator[None]:
    """On a machine without compiled kernels, let another process compile those of training.

    The first rollouts compile theirs meanwhile, and the processes share a cache on the disk: that
    halves the wait for the first flight.
    """
    if n_kernels():
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
    """Train a monitor on random numbers and fly some through it: this uses every kernel of both."""
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
    failures = unsafe.y, unsafe.fail_index
    trained = train(dataset, MONITOR, failures=failures, near=[failures])
    monitor = with_validity(trained, dataset, repeat(flights, 100))
    evaluate(monitor, flights.y, flights.fail_index)
    monitor.stream().update(0.0, y[0, 0])
