"""Run readers in separate processes: start one, send it an order, read its answer.

A server starts a spare process during an upload, and another after each use, so that the next file
does not wait for libraries to load. A command reads one file and starts no spare; one that reads
many files of one owner keeps a process for the next file, until one ends it.
A reader process ends when its parent ends, for whatever reason.
"""

import atexit
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import Any

Worker = subprocess.Popen[bytes]

COMMAND = ("-P", "-W", "ignore", "-m", "app.telemetry.readers.worker")
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",  # others reserve 1 GiB, which would count
}
GRACE_SECONDS = 10.0
"""A process that exceeds its own limit is killed after this additional time."""
ENDS = {"SIGALRM": "slow", "SIGXCPU": "slow", "SIGKILL": "large"}
"""Meaning of a signal from the system, which sends SIGKILL when memory runs out."""

_spares: SimpleQueue[Worker] = SimpleQueue()
_keeping: list[bool] = []


@contextmanager
def kept_readers() -> Iterator[None]:
    """Let a process that has read a file read the next one, while the block runs."""
    _keeping.append(True)
    try:
        yield
    finally:
        _keeping.pop()
        _end_spares()


def carry_out(order: dict[str, Any]) -> dict[str, Any]:
    """Run an order and return the answer. Safe in any thread; the process has ended on return,
    or waits for the next order."""
    if _keeping and sys.platform != "win32":
        return _carry_out_next(order)
    had_spare = not _spares.empty()
    worker = _spare_or_new()
    try:
        return _answer(worker, order)
    finally:
        _end(worker)
        if had_spare:
            warm_up()


def _carry_out_next(order: dict[str, Any]) -> dict[str, Any]:
    """Run an order in a spare process, which remains one if it has read or refused the file."""
    worker, is_spare = _spare_or_new(), False
    try:
        result = _next_answer(worker, order)
        is_spare = result["end"] in ("read", "refused")
    finally:
        if is_spare:
            _spares.put(worker)
        else:
            _end(worker)
    return result


def _next_answer(worker: Worker, order: dict[str, Any]) -> dict[str, Any]:
    assert worker.stdin
    assert worker.stdout
    with suppress(BrokenPipeError):
        worker.stdin.write(json.dumps(order | {"is_last": False}).encode() + b"\n")
        worker.stdin.flush()
    end, answer = time.monotonic() + order["seconds"] + GRACE_SECONDS, b""
    while not answer.endswith(b"\n"):
        if not select.select([worker.stdout], [], [], max(0.0, end - time.monotonic()))[0]:
            return {"end": "slow"}
        if not (piece := os.read(worker.stdout.fileno(), 65_536)):
            worker.wait(GRACE_SECONDS)
            break
        answer += piece
    return _result(worker, answer)


def warm_up() -> None:
    """Start a spare process in the background, unless there is one or the system refuses."""
    with suppress(OSError):
        if _spares.empty():
            _spares.put(_start())


def _spare_or_new() -> Worker:
    with suppress(Empty):
        worker = _spares.get_nowait()
        if worker.poll() is None:
            return worker
        _end(worker)
    return _start()


def _start() -> Worker:
    """Start an interpreter with the import path of this one."""
    path = os.pathsep.join(place or os.getcwd() for place in sys.path)
    return subprocess.Popen(
        [sys.executable, *COMMAND],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # ignore interrupts from the terminal
        env=os.environ | ENVIRONMENT | {"PYTHONPATH": path},
    )


def _answer(worker: Worker, order: dict[str, Any]) -> dict[str, Any]:
    """Send an order; return the answer, or the reason why the process ended."""
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
    return _result(worker, answer)


def _result(worker: Worker, answer: bytes) -> dict[str, Any]:
    """An answer, or the reason why the process ended without one."""
    try:
        return json.loads(answer)
    except ValueError:
        reason = _exit_reason(worker.returncode)
        return {"end": ENDS.get(reason, "crashed"), "text": reason}


def _exit_reason(code: int) -> str:
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit {code}"


def _end(worker: Worker) -> None:
    """End a process and all its children."""
    with worker:
        if worker.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(worker.pid, signal.SIGKILL) if hasattr(os, "killpg") else worker.kill()


@atexit.register
def _end_spares() -> None:
    with suppress(Empty):
        while True:
            _end(_spares.get_nowait())
