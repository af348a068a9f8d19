"""Processes that read a file, forked from one with the imports done.

They are begun in a few milliseconds, where an interpreter that imports its libraries takes half a
second of processor time: for the many files of a campaign, each of which has a separate process.
"""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from select import select

from app.telemetry.formats import FORMATS, READERS
from app.telemetry.readers import isolation, worker
from tests.support.places import ROOT

COMMAND = ("-P", "-W", "ignore", "-m", __name__)


class Forked:
    """What `app.telemetry.readers.isolation` uses of a Popen, of a process that was forked."""

    def __init__(self, parent: socket.socket) -> None:
        orders, answers, ends = os.pipe(), os.pipe(), os.pipe()
        theirs = [orders[0], answers[1], ends[1]]
        socket.send_fds(parent, [b"1"], theirs)
        for descriptor in theirs:
            os.close(descriptor)
        self.stdin = os.fdopen(orders[1], "wb")
        self.stdout, self._end = os.fdopen(answers[0], "rb"), os.fdopen(ends[0], "rb")
        self.pid = int(self._end.readline())
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Its exit code; None while it goes on."""
        return self.wait() if select([self._end], [], [], 0.0)[0] else None

    def wait(self) -> int:
        """Its exit code, once it has ended."""
        if self.returncode is None:
            self.returncode = int(self._end.read())
        return self.returncode

    def communicate(self, timeout: float) -> tuple[bytes, None]:
        """What it answers before it ends. subprocess.TimeoutExpired after so many seconds."""
        if not select([self._end], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired(COMMAND, timeout)
        self.wait()
        return self.stdout.read(), None

    def __enter__(self) -> "Forked":
        return self

    def __exit__(self, *_: object) -> None:
        if self.stdin:
            self.stdin.close()
        self.wait()
        self.stdout.close()
        self._end.close()


@contextmanager
def forking() -> Iterator[socket.socket]:
    """The process that they are forked of; what `Forked` asks for one."""
    ours, its = socket.socketpair()
    with ours, its:
        call = [sys.executable, *COMMAND, str(its.fileno())]
        environment = os.environ | isolation.ENVIRONMENT | {"PYTHONPATH": str(ROOT)}
        with subprocess.Popen(call, pass_fds=[its.fileno()], env=environment) as process:
            its.close()
            try:
                yield ours
            finally:
                ours.close()
                process.wait()


def main(asked: socket.socket) -> None:
    """Fork a process for each request, until nobody asks any more."""
    modules = [(each.reader, READERS) for each in FORMATS.values()]
    for name, package in [*((name, None) for name in worker.PRELOADED), *modules]:
        with suppress(ImportError):
            import_module(name, package)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while (received := socket.recv_fds(asked, 1, 3))[0]:
        if not os.fork():
            asked.close()
            _begin(*received[1])
        for descriptor in received[1]:
            os.close(descriptor)


def _begin(orders: int, answers: int, ends: int) -> None:
    """Fork the process that reads a file; tell its number, and how it ended. Does not return."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    if not (pid := os.fork()):
        os.close(ends)
        os.setsid()
        os.dup2(orders, 0)
        os.dup2(answers, 1)
        os.close(orders)
        os.close(answers)
        worker.main()
    os.close(orders)
    os.close(answers)
    os.write(ends, b"%d\n" % pid)
    _, status = os.waitpid(pid, 0)
    os.write(ends, b"%d" % os.waitstatus_to_exitcode(status))
    os._exit(0)


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
