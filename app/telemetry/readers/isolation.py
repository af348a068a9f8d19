"""Have files read in processes of their own: start one, send it an order, read how it ended.

A server starts a spare process while a file comes in, and another after each that was used, so that
the next file need not wait for its libraries. A command reads one file and starts none.
A process ends with the one that asked, however that ends.
"""

import atexit
import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any

Worker = subprocess.Popen[bytes]

COMMAND = ("-P", "-W", "ignore", "-m", "app.telemetry.readers.worker")
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",  # the others reserve a GiB, which would be counted
}
GRACE_SECONDS = 10.0
"""A process that does not end at its own limit is ended this much later."""
ENDS = {"SIGALRM": "slow", "SIGXCPU": "slow", "SIGKILL": "large"}
"""What a signal of the system's means; it kills for want of memory."""

_spares: SimpleQueue[Worker] = SimpleQueue()


def carry_out(order: dict[str, Any]) -> dict[str, Any]:
    """Have an order carried out. Safe in any thread; its process is gone on return."""
    replaces = not _spares.empty()
    worker = _take()
    try:
        return _answer(worker, order)
    finally:
        _end(worker)
        if replaces:
            warm_up()


def warm_up() -> None:
    """Start a spare process in the background, unless there is one or the system has no more."""
    with suppress(OSError):
        if _spares.empty():
            _spares.put(_start())


def _take() -> Worker:
    with suppress(Empty):
        worker = _spares.get_nowait()
        if worker.poll() is None:
            return worker
        _end(worker)
    return _start()


def _start() -> Worker:
    """A fresh interpreter that imports what this one would."""
    path = os.pathsep.join(place or os.getcwd() for place in sys.path)
    return subprocess.Popen(
        [sys.executable, *COMMAND],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # an interrupt of the terminal is not for it
        env=os.environ | ENVIRONMENT | {"PYTHONPATH": path},
    )


def _answer(worker: Worker, order: dict[str, Any]) -> dict[str, Any]:
    """Send an order; return the answer, or what the process ended of."""
    orders, worker.stdin = worker.stdin, None  # communicate would close it, which ends the worker
    assert orders
    with orders:
        try:
            with suppress(BrokenPipeError):
                orders.write(json.dumps(order).encode() + b"\n")
                orders.flush()
            answer, _ = worker.communicate(timeout=order["seconds"] + GRACE_SECONDS)
        except subprocess.TimeoutExpired:
            return {"end": "slow"}
    try:
        return json.loads(answer)
    except ValueError:
        reason = _exit_reason(worker.returncode)
        return {"end": ENDS.get(reason, "crashed"), "text": reason}


def _exit_reason(code: int) -> str:
    """Name of the signal that ended a process, or its exit code."""
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit {code}"


def _end(worker: Worker) -> None:
    """End a process with all that it has started."""
    with worker:
        if worker.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(worker.pid, signal.SIGKILL) if hasattr(os, "killpg") else worker.kill()


@atexit.register
def _end_spares() -> None:
    with suppress(Empty):
        while True:
            _end(_spares.get_nowait())
