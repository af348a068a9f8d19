"""Run readers in separate processes: start one, send it an order, read its answer.

A server starts a spare process during an upload, and another after each use, so that the next file
does not wait for libraries to load. A command reads one file and starts no spare; one that reads
many files of one owner keeps a process for the next file, until one ends it.
A reader process ends when its parent ends, for whatever reason.
"""

import atexit
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from threading import Timer
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
    or, where it is kept and has read or refused the file, waits for the next order."""
    is_last, is_reusable = not _keeping or sys.platform == "win32", False
    had_spare = not _spares.empty()
    worker = _spare_or_new()
    try:
        result = _answer(worker, order | {"is_last": is_last})
        is_reusable = not is_last and result["end"] in ("read", "refused")
    finally:
        if is_reusable:
            _spares.put(worker)
        else:
            _end(worker)
        if is_last and had_spare:
            warm_up()
    return result


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
    """Send an order; return the answer, or the reason why the process ended without one.

    Its input stays open meanwhile: closing it would end the process.
    """
    assert worker.stdin
    assert worker.stdout
    with suppress(BrokenPipeError):
        os.write(worker.stdin.fileno(), json.dumps(order).encode() + b"\n")
    timer = Timer(order["seconds"] + GRACE_SECONDS, _kill, [worker])
    timer.start()
    try:
        answer = worker.stdout.readline()
        if order["is_last"] or not answer:
            worker.wait()
        is_late = timer.finished.is_set()
    finally:
        timer.cancel()
    with suppress(ValueError):
        return json.loads(answer)
    reason = _exit_reason(worker.returncode)
    return {"end": "slow" if is_late else ENDS.get(reason, "crashed"), "text": reason}


def _exit_reason(code: int) -> str:
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit {code}"


def _end(worker: Worker) -> None:
    """End a process and all its children."""
    with worker:
        if worker.poll() is None:
            _kill(worker)


def _kill(worker: Worker) -> None:
    with suppress(ProcessLookupError):
        os.killpg(worker.pid, signal.SIGKILL) if hasattr(os, "killpg") else worker.kill()


@atexit.register
def _end_spares() -> None:
    with suppress(Empty):
        while True:
            _end(_spares.get_nowait())
