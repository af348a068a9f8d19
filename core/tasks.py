"""Independent tasks of one computation, on this machine's threads or another executor.

A task depends on its arguments alone, so every executor gives the same bits.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from itertools import islice
from typing import Any, TypeVar

from core.kernels.compiled import on_this_thread

Result = TypeVar("Result")

_here = threading.local()


class Tasks:
    """The tasks of one computation; leaving the block cancels those that have not begun.

    executor: of processes or a cluster, for functions of modules and arguments that can be
    pickled; it stays open. Default: this machine's threads.
    """

    def __init__(self, executor: Executor | None = None) -> None:
        self._cancelled = threading.Event() if executor is None else None
        self._executor = executor or ThreadPoolExecutor(os.cpu_count() or 1)
        self._submitted: deque[Future[Any]] = deque()

    def __enter__(self) -> "Tasks":
        return self

    def __exit__(self, *_: object) -> None:
        for future in self._submitted:
            future.cancel()
        if self._cancelled is not None:
            self._cancelled.set()
            self._executor.shutdown()

    def submit(self, task: Callable[..., Result], *arguments: Any) -> Future[Result]:
        if self._cancelled is None:
            future = self._executor.submit(_alone, task, *arguments)
        else:
            future = self._executor.submit(_cancellable, self._cancelled, task, *arguments)
        self._submitted.append(future)
        return future

    def results(
        self,
        task: Callable[..., Result],
        arguments: Iterable[tuple[Any, ...]],
        ahead: int | None = None,
    ) -> Iterator[Result]:
        """Results of a task in the order of its arguments.

        ahead: tasks submitted before the first result is read; all if None.
        """
        following = iter(arguments)
        pending = deque([self.submit(task, *each) for each in islice(following, ahead)])
        while pending:
            future = pending.popleft()
            self._submitted.remove(future)
            result = future.result()
            pending.extend([self.submit(task, *each) for each in islice(following, 1)])
            yield result


def stop_if_cancelled() -> None:
    """InterruptedError in a task whose computation was cancelled, on this machine's threads."""
    cancelled: threading.Event | None = getattr(_here, "cancelled", None)
    if cancelled is not None and cancelled.is_set():
        raise InterruptedError("the computation was cancelled")


def _alone(task: Callable[..., Result], *arguments: Any) -> Result:
    with on_this_thread():
        return task(*arguments)


def _cancellable(
    cancelled: threading.Event, task: Callable[..., Result], *arguments: Any
) -> Result:
    _here.cancelled = cancelled
    return _alone(task, *arguments)
