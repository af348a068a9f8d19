"""The demonstration: a small monitor, trained where it is missing, and a flight that fails.

`forewarn demo` starts it with the server; a page may start it on any server.
"""

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from fastapi import FastAPI
from httpx2 import ASGITransport, AsyncClient, Response
from pydantic import ConfigDict

from app.access.login import COOKIE
from app.recipes.recipes import USUAL_MONITOR, limits_named, to_plain
from core import __version__
from core.kernels.compiled import cache_directory
from core.planned_test.collection import DatasetRecipe

LOG = logging.getLogger("forewarn")
NAME = "demonstration"
DATASET = DatasetRecipe(n_unsafe=100).as_flown()
MONITOR = USUAL_MONITOR
N_TEST = 1000
SEED = 2
LOOK_EVERY_S = 0.25
KERNELS = 84
"""Kernels that training and flying the monitor compile; only the estimate depends on it."""
FEW_KERNELS = 5
LEAST_SHARE = 0.08
"""Of the work done; below it the remaining time is not estimated."""
STEPS = {"simulating": 0.0, "training": 0.25, "calibrating": 0.5, "flying": 0.75, "storing": 0.95}
"""First word of the job's message -> share of the work done when that step begins."""

Phase = Literal["preparing", "compiling", "training", "ready", "failed"]


@dataclass(frozen=True)
class DemonstrationProgress:
    """Progress of the live demonstration."""

    __pydantic_config__ = ConfigDict(use_attribute_docstrings=True)

    phase: Phase
    step: str
    """current step, in words"""
    share: float
    """share of the work done, 0 to 1"""
    elapsed: float
    """[s]"""
    remaining: float | None
    """[s], estimated from the work done; null while too little is done"""
    flight: str | None
    """id of its flight; null before `ready`"""
    problem: str
    """why it failed; empty otherwise"""


class Demonstration:
    """The demonstration of one server. `start` may be called again; `stop` ends it."""

    def __init__(self, app: FastAPI) -> None:
        self._app = app
        self._task: asyncio.Task[str] | None = None
        self._step, self._step_share, self._is_compiling = "looking for its monitor", 0.0, False
        self._began = self._took = 0.0
        self._kernels = 0
        self.monitor: dict[str, Any] | None = None

    def start(self) -> "asyncio.Task[str]":
        """Begin, or begin again where it failed; the task's result is the flight's id."""
        if self._task is None or (self._task.done() and self._failure):
            self._began, self._took = time.monotonic(), 0.0
            self._kernels = n_kernels()
            self._task = asyncio.create_task(self._run())
            self._task.add_done_callback(self._note_end)
        return self._task

    def stop(self) -> None:
        """Stop it. A flight that it started continues."""
        if self._task is not None:
            self._task.cancel()

    @property
    def progress(self) -> DemonstrationProgress | None:
        """None before it is started."""
        task = self._task
        if task is None:
            return None
        elapsed = self._took or time.monotonic() - self._began
        share, remaining, flight = self._share, None, None
        phase: Phase = "training" if self._step_share else "preparing"
        if self._failure:
            phase, share = "failed", 0.0
        elif task.done():
            phase, share, remaining, flight = "ready", 1.0, 0.0, task.result()
        elif self._is_compiling:
            phase = "compiling"
        if not task.done() and share >= LEAST_SHARE:
            remaining = elapsed * (1 - share) / share
        step = "flying" if phase == "ready" else self._step
        return DemonstrationProgress(phase, step, share, elapsed, remaining, flight, self._failure)

    @property
    def _share(self) -> float:
        """By the kernels compiled where some are missing, else by the steps of the training."""
        missing = KERNELS - self._kernels
        if missing <= FEW_KERNELS:
            return self._step_share
        compiled = (n_kernels() - self._kernels) / missing
        return min(max(compiled, self._step_share * compiled), 0.98)

    @property
    def _failure(self) -> str:
        task = self._task
        if task is None or not task.done():
            return ""
        return "it was stopped" if task.cancelled() else str(task.exception() or "")

    def _note_end(self, task: "asyncio.Task[str]") -> None:
        self._took = time.monotonic() - self._began
        if not task.cancelled() and (error := task.exception()):
            LOG.warning("the demonstration stopped: %s", error)

    async def _run(self) -> str:
        """Find or train the monitor and start a flight through it. ValueError."""
        sessions = self._app.state.sessions
        session = sessions.start(self._app.state.people.server)
        headers = {"Cookie": f"{COOKIE}={session}"}
        transport = ASGITransport(self._app)
        base = "http://127.0.0.1/api/v1"
        try:
            async with AsyncClient(
                transport=transport, base_url=base, headers=headers, timeout=None
            ) as client:
                self.monitor = await known_monitor(client)
                if self.monitor is None:
                    job = await begin_training(client)
                    self.monitor = await trained_monitor(client, job, self._on_job)
                self._step = "starting the flight"
                return await fly(client, self.monitor["id"])
        finally:
            sessions.end(session)

    def _on_job(self, job: dict[str, Any]) -> None:
        message, done, total = job["message"], job["progress"] or 0, job["total"] or 0
        self._step = message
        word = message.split()[0].rstrip(":") if message else ""
        self._is_compiling = word == "compiling"
        if word in STEPS:
            within = 0.25 * done / total if word == "simulating" and total else 0.0
            self._step_share = STEPS[word] + within


def n_kernels() -> int:
    """Kernels that this installation has compiled."""
    return sum(1 for _ in Path(cache_directory()).rglob("*.nbi"))


async def known_monitor(client: AsyncClient) -> dict[str, Any] | None:
    """The demonstration's monitor, if this version of the program trained it. ValueError."""
    wanted = [NAME, __version__, to_plain(MONITOR), limits_named(to_plain(DATASET))]
    for monitor in _answered(await client.get("/monitors")):
        if [monitor[key] for key in ("name", "version", "recipe", "dataset_recipe")] != wanted:
            continue
        if (await client.get(f"/monitors/{monitor['id']}/calibration")).is_success:
            return monitor
    return None


async def begin_training(client: AsyncClient) -> dict[str, Any]:
    """The job that trains the demonstration's monitor. ValueError."""
    request = {"name": NAME, "dataset": to_plain(DATASET), "n_test": N_TEST} | to_plain(MONITOR)
    return _answered(await client.post("/monitors", json=request))


async def trained_monitor(
    client: AsyncClient, job: dict[str, Any], on_job: Callable[[dict[str, Any]], object]
) -> dict[str, Any]:
    """The monitor that a job makes. ValueError where it makes none."""
    while job["ended"] is None:
        on_job(job)
        await asyncio.sleep(LOOK_EVERY_S)
        job = _answered(await client.get(f"/jobs/{job['id']}"))
    if job["status"] != "done":
        raise ValueError(f"training ended as {job['status']}: {job['error'] or 'on request'}")
    return _answered(await client.get(f"/monitors/{job['result']['monitor']}"))


async def fly(client: AsyncClient, monitor_id: str) -> str:
    """Start a flight that fails, over and over, and return its id. It waits for its viewer."""
    source = {"kind": "simulated", "outcome": "unsafe", "seed": SEED}
    request = {"source": source, "monitor": monitor_id, "wait_for_viewer": True}
    flight = _answered(await client.post("/flights", json=request))
    loop = {"action": "loop", "value": True}
    _answered(await client.post(f"/flights/{flight['id']}/transport", json=loop))
    return flight["id"]


def _answered(answer: Response) -> Any:
    if answer.is_error:
        raise ValueError(f"the demonstration stopped: {answer.json()['detail']}")
    return answer.json()
