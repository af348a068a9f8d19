"""The process that reads one file: one order, one answer, then it ends, unless more files follow.

The order is a line of JSON on standard input, which stays open while the parent waits for the
answer, JSON on standard output. The system ends a process that exceeds its limits or whose parent
has gone; app.telemetry.readers.isolation starts the process and reads its exit code.
"""

import json
import os
import select
import signal
import sys
import time
import traceback
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from app.telemetry.contents import ColumnWriter
from app.telemetry.formats import READERS
from app.telemetry.readers.signal_tables import NO_ROOM
from app.telemetry.recording import TelemetryError

PRELOADED = {
    "app.telemetry.readers.text": 0.0,
    "pyarrow.csv": 0.0,
    "pyarrow.parquet": 0.0,
    "h5py": 0.0,
    "scipy.io": 2.0,
    "pandas": 2.0,  # where it is installed, pyarrow imports it
}
"""Imports of a spare process, and how long it must be idle before each [s]."""


def main() -> None:
    """Carry out the order on standard input; output of libraries is dropped."""
    orders, answers = os.dup(0), os.dup(1)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    for module, idle in PRELOADED.items():
        if _is_ready(orders, idle):
            break
        with suppress(ImportError):
            import_module(module)
    with open(orders, "rb", closefd=False) as lines:
        for line in lines:
            order = json.loads(line)
            is_last = order.get("is_last", True)
            _limit(order, orders, is_last)
            answer = json.dumps(read(order)).encode() + b"\n"
            if not is_last:
                _wait_for_more(orders)
            os.write(answers, answer)
            if is_last:
                break
    os._exit(0)


def read(order: dict[str, Any]) -> dict[str, Any]:
    """Read a file as ordered; return how it ended, as app.telemetry.reading expects."""
    writer = ColumnWriter(
        Path(order["folder"]), order["most_bytes"], order["bad_share"], tuple(order["notes"])
    )
    try:
        import_module(order["reader"], READERS).read(Path(order["path"]), writer)
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
        return {"end": "failed", "text": text[:500], "trace": traceback.format_exc()[-4000:]}
    return {"end": "read"}


def _limit(order: dict[str, Any], orders: int, is_last: bool) -> None:
    """Let the system end this process if it exceeds its limits or `orders` is closed.

    Hard limits, which cannot be raised for the next order, are for the last one.
    """
    if sys.platform == "win32":
        return
    import fcntl
    import resource

    cpu = int(time.process_time() + order["seconds"] * (os.cpu_count() or 1)) + 1
    memory = _data_bytes() + order["memory"]
    for limit, soft, hard in (
        (resource.RLIMIT_CORE, 0, 0),
        (resource.RLIMIT_CPU, cpu, cpu + 1),  # a hard limit kills without a reason
        (resource.RLIMIT_DATA, memory, memory),  # mapped files and reservations are not counted
    ):
        with suppress(ValueError, OSError):
            resource.setrlimit(limit, (soft, hard if is_last else resource.getrlimit(limit)[1]))
    signal.setitimer(signal.ITIMER_REAL, order["seconds"])
    fcntl.fcntl(orders, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(orders, fcntl.F_SETFL, os.O_ASYNC)  # SIGIO when it is closed
    if _is_ready(orders, 0.0):
        os._exit(0)


def _wait_for_more(orders: int) -> None:
    """End neither by time nor by input until the next order, or the end of orders, is read."""
    import fcntl

    signal.setitimer(signal.ITIMER_REAL, 0.0)
    fcntl.fcntl(orders, fcntl.F_SETFL, 0)


def _is_ready(orders: int, within: float) -> bool:
    """Whether there is something to read, or the end of input, within so many seconds."""
    return sys.platform != "win32" and bool(select.select([orders], [], [], within)[0])


def _data_bytes() -> int:
    """Memory of this process without mapped files [bytes]; 0 if unknown."""
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[5]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


if __name__ == "__main__":
    main()
