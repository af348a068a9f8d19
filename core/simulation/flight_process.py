"""Flights of native code, in separate processes: a crash or a hang of it is one error.

A process loads a model once and flies one flight after the other. Flights are drawn before, so
they are the same bits for any number of processes.
"""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any, NoReturn, Protocol

import numpy as np

from core.simulation.python_simulator import (
    FlightByFlight,
    ImpossibleError,
    OwnCodeError,
    rollout_in_words,
)
from core.types import Array

Fly = Callable[[Array, Array], Array]
"""One flight, from theta (n_parameters,) and inputs (n_samples, n_inputs) to outputs."""

AT_ONCE = 16
"""Flights that a process gets together."""
GRACE_S = 10.0
"""A process that does not end by its own alarm is killed after this additional time."""
FLIGHT, IMPOSSIBLE, ERROR = b"f", b"i", b"e"
"""First byte of an answer: outputs, or a text."""


class Model(Protocol):
    """Native code, as plain data that can be sent to another process."""

    def load(self) -> Fly:
        """Load the code into this process, in whose folder it may write. ValueError."""
        ...


@dataclass(frozen=True)
class ProcessLimits:
    """Of one process: seconds for a flight, and for loading; memory in MiB."""

    seconds: float = 60.0
    memory: int = 4096


@dataclass(frozen=True, eq=False)
class ModelSimulator(FlightByFlight):
    """Native code as a simulator.

    model_name: for messages.   about: provenance, as plain data.
    processes: at most; the result does not depend on it.
    """

    model: Model
    model_name: str
    limits: ProcessLimits = ProcessLimits()
    about: Mapping[str, Any] = field(default_factory=dict)
    processes: int = field(default_factory=lambda: os.cpu_count() or 1)

    @property
    def name(self) -> str:
        return self.model_name

    @cached_property
    def _started(self) -> "_Processes":
        return _Processes(self.model, self.name, self.limits)

    def __getstate__(self) -> dict[str, Any]:
        """Without processes: a copy starts its own."""
        return {name: value for name, value in vars(self).items() if name != "_started"}

    def end(self) -> None:
        """End the processes; the next flight starts new ones."""
        self._started.end()

    def flown(self, theta: Array, inputs: list[Array]) -> tuple[Array, dict[int, str]]:
        impossible: dict[int, str] = {}
        if not inputs:
            return np.empty((0, 0, 0)), impossible
        y = np.empty((len(theta), len(inputs[0]), len(self.measured)))
        parts = iter([slice(k, k + AT_ONCE) for k in range(0, len(theta), AT_ONCE)])
        names, lock, errors = list(self.parameters), Lock(), dict[int, str]()

        def fly(process: _Process) -> None:
            while not errors:
                with lock:
                    part = next(parts, None)
                if part is None:
                    return
                k = part.start
                try:
                    for outputs in process.fly(theta[part], inputs[part], y.shape[1:]):
                        if isinstance(outputs, str):
                            impossible[k] = outputs
                        else:
                            y[k] = outputs
                        k += 1
                        with lock:
                            self.counts["flown"] += 1
                except _FlightError as error:
                    process.end()
                    values = dict(zip(names, theta[k].tolist(), strict=True))
                    errors[k] = f"{self.name}, {rollout_in_words(k, len(theta), values)}, {error}"

        from core.kernels.compiled import is_alone  # slow to import in each process of a model

        most = 1 if is_alone() else self.processes
        self._started.run(fly, min(most, -(-len(theta) // AT_ONCE)))
        if errors:
            raise OwnCodeError(errors[min(errors)])
        return y, impossible


class _FlightError(Exception):
    """Why there is no flight, and what to do."""


class _Process:
    """A process that has loaded a model."""

    def __init__(self, model: Model, limits: ProcessLimits, folder: str) -> None:
        self._limits = limits
        self._connection, theirs = Pipe()
        paths = (os.path.abspath(place) for place in sys.path)
        threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self.popen = subprocess.Popen(
            [sys.executable, "-P", "-W", "ignore", "-m", __name__, str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            cwd=folder,
            start_new_session=True,  # ignore interrupts from the terminal
            env=os.environ | threads | {"PYTHONPATH": os.pathsep.join(paths), "TMPDIR": folder},
        )
        theirs.close()
        self._send((model, limits))

    def loaded(self) -> None:
        """Wait until the model is loaded. _FlightError."""
        self._answer()

    def fly(
        self, theta: Array, inputs: Sequence[Array], shape: tuple[int, ...]
    ) -> Iterator[Array | str]:
        """The outputs of each flight, or why it is impossible."""
        self._send((theta, inputs))
        for _ in theta:
            answer = self._answer()
            if answer[:1] == IMPOSSIBLE:
                yield answer[1:].decode()
                continue
            outputs = np.frombuffer(answer, np.float64, offset=1)
            if outputs.size != np.prod(shape):
                raise _FlightError(f"returned {outputs.size} numbers instead of {np.prod(shape)}")
            yield outputs.reshape(shape)

    def end(self) -> None:
        self._connection.close()
        if self.popen.poll() is None:
            self.popen.kill()
        self.popen.wait()

    def _send(self, plain: object) -> None:
        try:
            self._connection.send_bytes(pickle.dumps(plain))
        except OSError:
            self._ended()

    def _answer(self) -> bytes:
        try:
            if not self._connection.poll(self._limits.seconds + GRACE_S):
                self.popen.kill()
            answer = self._connection.recv_bytes()
        except (EOFError, OSError):
            self._ended()
        if answer[:1] == ERROR:
            raise _FlightError(answer[1:].decode())
        return answer

    def _ended(self) -> NoReturn:
        code = self.popen.wait()
        seconds, memory = self._limits.seconds, self._limits.memory
        try:
            reason = signal.Signals(-code).name
        except ValueError:
            reason = f"exit {code}"
        if reason in ("SIGALRM", "SIGKILL"):
            raise _FlightError(
                f"took more than {seconds:g} s or was stopped by the system: correct the model, or "
                "give the test point more `seconds`"
            )
        raise _FlightError(
            f"crashed ({reason}) within {memory} MiB of memory: correct the model, or give the "
            "test point more `memory`"
        )


class _Processes:
    """Processes of one model, started when they are needed, ended with this object.

    Several threads may fly at once, each with processes of its own.
    """

    def __init__(self, model: Model, name: str, limits: ProcessLimits) -> None:
        self._model, self._name, self._limits = model, name, limits
        self._folder = tempfile.TemporaryDirectory(prefix="forewarn-", ignore_cleanup_errors=True)
        self._all: list[_Process] = []
        self._idle: list[_Process] = []
        self._lock = Lock()
        weakref.finalize(self, _end, self._all, self._folder)

    def run(self, work: Callable[[_Process], None], n: int) -> None:
        """Run `work` with each of n processes at the same time. OwnCodeError.

        A process that `work` ends is not used again.
        """
        with self._lock:
            taken, self._idle = self._idle[:n], self._idle[n:]
        try:
            new = [self._start() for _ in range(n - len(taken))]
            taken += new
            for process in new:
                process.loaded()
            with ThreadPoolExecutor(n) as pool:
                try:
                    list(pool.map(work, taken))
                except BaseException:  # an interrupt, which must not wait for flights
                    for process in taken:
                        process.popen.kill()
                    raise
        except BaseException as error:
            _end(taken)
            if isinstance(error, _FlightError):
                raise OwnCodeError(f"{self._name} {error}") from None
            raise
        with self._lock:
            self._idle += [process for process in taken if process.popen.poll() is None]

    def end(self) -> None:
        self._idle.clear()
        _end(self._all)

    def _start(self) -> _Process:
        process = _Process(self._model, self._limits, self._folder.name)
        self._all.append(process)
        return process


def _end(
    processes: list[_Process], folder: "tempfile.TemporaryDirectory[str] | None" = None
) -> None:
    while processes:
        processes.pop().end()
    if folder is not None:
        folder.cleanup()


def _limited(megabytes: int) -> None:
    import resource  # of POSIX alone

    memory = megabytes * 2**20
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main(connection: Connection) -> None:
    """Load the model that is sent, then fly what is sent, until the other side closes."""
    model, limits = pickle.loads(connection.recv_bytes())
    _limited(limits.memory)

    fly, repeated = list[Fly](), list[bool]()

    def answered(work: Callable[[], bytes]) -> bool:
        signal.setitimer(signal.ITIMER_REAL, limits.seconds)
        try:
            answer = FLIGHT + work()
        except MemoryError:
            needed = f"needs more than {limits.memory} MiB: give the test point more `memory`"
            answer = ERROR + needed.encode()
        except Exception as error:
            kind = IMPOSSIBLE if fly and isinstance(error, ImpossibleError) else ERROR
            answer = kind + f"failed: {error or type(error).__name__}".encode()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        connection.send_bytes(answer)
        return answer[:1] != ERROR

    def load() -> bytes:
        fly.append(model.load())
        return b""

    def flown(theta: Array, inputs: Array) -> bytes:
        outputs = fly[0](theta, inputs).tobytes()
        if not repeated:
            repeated.append(fly[0](theta, inputs).tobytes() == outputs)
            if not repeated[0]:
                raise ValueError("it does not repeat a flight after its reset: correct its reset")
        return outputs

    if not answered(load):
        return
    while True:
        try:
            theta, inputs = pickle.loads(connection.recv_bytes())
        except EOFError:
            return
        for values, each in zip(theta, inputs, strict=True):
            if not answered(lambda values=values, each=each: flown(values, each)):
                return


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])))
