"""The near side of the processes that read files: start their server, send an order, wait.

The server is a fresh interpreter: it knows nothing of the program that asks, runs none of its
`__main__`, and ends with it. It is not multiprocessing's, whose children import `__main__` again,
which for the command `forewarn` is all of it.
"""

import atexit
import json
import os
import socket
import subprocess
import sys
from contextlib import suppress
from threading import Lock
from typing import Any

FORKS = hasattr(os, "fork") and hasattr(socket, "send_fds")
PATH = "import sys; path = sys.argv[1:]; sys.path[:] = path[1:]; "
SERVE = (
    f"{PATH}import socket; from app.telemetry.readers.reader_process import serve; "
    "serve(socket.socket(fileno=int(path[0])))"
)
WORK_ALONE = f"{PATH}from app.telemetry.readers.reader_process import work_alone; work_alone()"
GRACE_SECONDS = 10.0
"""A keeper answers this long after its worker's time at the latest."""


def carry_out(order: dict[str, Any]) -> dict[str, Any]:
    """Have an order carried out elsewhere. Safe in any thread; returns when nobody works on it."""
    if FORKS:
        answer = _ask_server(order)
        if answer:
            return json.loads(answer)
        if os.listdir(order["folder"]) or not _server.has_ended(within=1.0):
            return {"end": "crashed"}
    return _carried_out_alone(order)


def warm_up() -> None:
    """Let the server start while there is something else to do."""
    if FORKS:
        _server.start()


class _Server:
    """The process that forks keepers, started again where it has ended."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._control: socket.socket | None = None

    def start(self) -> socket.socket:
        """Return the socket that takes connections; start the process where there is none."""
        with self._lock:
            if self._control and not self.has_ended():
                return self._control
            self._close()
            self._control, theirs = socket.socketpair()
            with theirs:
                self._process = subprocess.Popen(
                    _interpreter(SERVE, str(theirs.fileno())),
                    pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    start_new_session=True,  # an interrupt of the terminal is not for it
                    env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
                )
            return self._control

    def has_ended(self, within: float = 0.0) -> bool:
        """Whether there is no process, or none in so many seconds."""
        with suppress(subprocess.TimeoutExpired):
            return self._process is None or self._process.wait(within) is not None
        return False

    def stop(self) -> None:
        """End the process; workers that are waited for go on."""
        with self._lock:
            self._close()

    def _close(self) -> None:
        if self._control:
            self._control.close()
        if self._process:
            try:
                self._process.wait(timeout=1.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._control = self._process = None


_server = _Server()
atexit.register(_server.stop)


def _ask_server(order: dict[str, Any]) -> bytes:
    """Return the answer; nothing where the keeper or the server ended without one."""
    ours, theirs = socket.socketpair()
    with ours:
        with theirs:
            try:
                socket.send_fds(_server.start(), [b"+"], [theirs.fileno()])
            except OSError:  # it ended just now
                socket.send_fds(_server.start(), [b"+"], [theirs.fileno()])
        try:
            ours.settimeout(order["seconds"] + GRACE_SECONDS)
            ours.sendall(json.dumps(order).encode() + b"\n")
            return _all_of(ours)
        except TimeoutError:
            _hang_up(ours)
            return b'{"end": "slow"}'
        except OSError:
            return b""
        except BaseException:
            _hang_up(ours)
            raise


def _hang_up(connection: socket.socket) -> None:
    """Tell the keeper that nobody waits; return when its worker is gone."""
    with suppress(OSError):
        connection.settimeout(GRACE_SECONDS)
        connection.shutdown(socket.SHUT_WR)
        _all_of(connection)


def _all_of(connection: socket.socket) -> bytes:
    return b"".join(iter(lambda: connection.recv(65536), b""))


def _carried_out_alone(order: dict[str, Any]) -> dict[str, Any]:
    try:
        done = subprocess.run(
            _interpreter(WORK_ALONE, ""),
            input=json.dumps(order).encode() + b"\n",
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=order["seconds"] + GRACE_SECONDS,
        )
        return json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        return {"end": "slow"}
    except ValueError:
        return {"end": "crashed"}


def _interpreter(program: str, argument: str) -> list[str]:
    """Command of a fresh interpreter that imports what this one would."""
    path = [str(place) or os.getcwd() for place in sys.path]
    return [sys.executable, "-W", "ignore", "-c", program, argument, *path]
