"""The far side of app.telemetry.readers.isolation: processes in which a file may do its worst.

A server forks a keeper for each order, and the keeper a worker. The worker reads the file; the
keeper watches its time and memory, ends it where it exceeds them or nobody waits for it any more,
and answers. Orders and answers are JSON, one of each a connection. Where there is no fork, one
worker is started alone, its order on standard input and its answer on standard output.
"""

import errno
import json
import os
import select
import signal
import socket
import sys
import time
import traceback
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from app.telemetry.contents import ColumnWriter
from app.telemetry.recording import TelemetryError

PRELOADED = (
    "app.telemetry.readers.text_reader",
    "pyarrow.csv",
    "app.telemetry.readers.parquet_reader",
    "pyarrow.parquet",
    "app.telemetry.readers.matlab_reader",
    "scipy.io",
    "app.telemetry.readers.hdf5_reader",
    "h5py",
    "pyarrow.compute",
    "pandas",  # where it is installed, pyarrow imports it
)
"""Imported while nobody asks, so that a worker finds them there."""
WATCH_SECONDS = 0.02
NO_ROOM = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))


def serve(control: socket.socket) -> None:
    """Fork a keeper for each connection that arrives on `control`, until it is closed."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # keepers need no burial
    left = list(PRELOADED)
    while True:
        if not select.select([control], [], [], 0 if left else None)[0]:
            with suppress(ImportError):
                import_module(left.pop(0))
            continue
        asked, handles, _, _ = socket.recv_fds(control, 1, 1)
        if not asked:
            return
        if os.fork() == 0:
            try:
                control.close()
                _keep(socket.socket(fileno=handles[0]))
            finally:
                os._exit(0)
        os.close(handles[0])


def work_alone() -> None:
    """Carry out the order on standard input; nothing but the answer goes to standard output."""
    out = os.dup(1)
    _work(json.loads(sys.stdin.buffer.readline()), out)


def carry_out(order: dict[str, Any]) -> dict[str, Any]:
    """Read a file as ordered. Returns how it ended, as app.telemetry.reading words it."""
    writer = ColumnWriter(
        Path(order["folder"]), order["most_bytes"], order["bad_share"], tuple(order["notes"])
    )
    try:
        import_module(order["reader"]).read(Path(order["path"]), writer)
    except TelemetryError as error:
        return {"end": "refused", "text": str(error)[:4000]}
    except MemoryError:
        return {"end": "large"}
    except BaseException as error:
        if isinstance(error, ModuleNotFoundError) and order["extra"]:
            return {"end": "lacking", "text": str(error)[:500]}
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            return {"end": "no room", "errno": error.errno}
        text = f"{type(error).__name__}: {error}"
        return {"end": "failed", "text": text[:500], "trace": traceback.format_exc()[-8000:]}
    return {"end": "read"}


def _keep(connection: socket.socket) -> None:
    """Have the order on a connection carried out, and answer it in any case."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    order = json.loads(connection.makefile("rb").readline())
    answers, out = os.pipe()
    worker = os.fork()
    if worker == 0:
        connection.close()
        os.close(answers)
        _work(order, out)
    os.close(out)
    connection.sendall(json.dumps(_watched(worker, answers, connection, order)).encode())


def _watched(
    worker: int, answers: int, connection: socket.socket, order: dict[str, Any]
) -> dict[str, Any]:
    """Return a worker's answer, or what it ended of. It is gone afterwards."""
    latest = time.monotonic() + order["seconds"]
    answer, open_ends = b"", [answers, connection]
    while True:
        # a worker that has answered ends at once
        pause = WATCH_SECONDS if answers in open_ends else 0.001
        ready, _, _ = select.select(open_ends, [], [], pause)
        if answers in ready:
            answer += (chunk := os.read(answers, 65536))
            if not chunk:
                open_ends.remove(answers)
        ended, status = os.waitpid(worker, os.WNOHANG)
        if ended:
            return _answer(answer, os.waitstatus_to_exitcode(status))
        end = ""
        if connection in ready:
            end = "unwanted"
        elif time.monotonic() > latest:
            end = "slow"
        elif _own_memory(worker) > order["memory"]:
            end = "large"
        if end:
            os.kill(worker, signal.SIGKILL)
            os.waitpid(worker, 0)
            return {"end": end}


def _answer(answer: bytes, code: int) -> dict[str, Any]:
    if code == -signal.SIGXCPU:
        return {"end": "slow"}
    if code == -signal.SIGKILL:  # by the system, which does so for want of memory
        return {"end": "large"}
    try:
        return json.loads(answer)
    except ValueError:
        return {"end": "crashed", "text": f"exit {code}"}


def _work(order: dict[str, Any], out: int) -> None:
    """Carry out an order within its limits, answer, and end the process."""
    try:
        nowhere = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(nowhere, stream)
        _limit(order)
        os.write(out, json.dumps(carry_out(order)).encode())
    finally:
        os._exit(0)


def _limit(order: dict[str, Any]) -> None:
    """What the system itself enforces; it is above what the keeper allows."""
    try:
        import resource
    except ImportError:
        return
    limits = {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_CPU: int(order["seconds"] * (os.cpu_count() or 1)) + 1,
    }
    if reserved := _memory("self", 0):
        # libraries reserve more than they use, and some map the file
        limits[resource.RLIMIT_AS] = reserved + 2 * order["memory"] + order["size"]
    for limit, most in limits.items():
        with suppress(ValueError, OSError):
            resource.setrlimit(limit, (most, most))


def _own_memory(pid: int) -> int:
    """Resident memory of a process that is no file's [bytes]; 0 where the system does not say."""
    return _memory(pid, 1) - _memory(pid, 2)


def _memory(pid: int | str, field: int) -> int:
    try:
        with open(f"/proc/{pid}/statm", "rb") as file:
            return int(file.read().split()[field]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError):
        return 0
