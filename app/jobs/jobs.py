"""The queue of long work: worker threads, progress, cancellation and failures."""

import asyncio
import logging
import threading
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from app.jobs.cluster import executor_at
from app.recordings.files import NoSpace
from app.store.jobs import ENDED, JobInfo
from app.store.store import NotFound, Store
from core.kernels.compiled import announce_compilation

LOG = logging.getLogger("forewarn")
SAVE_INTERVAL = 0.5
"""[s] Progress reaches watchers at once; it is stored at most this often."""
STOPPED = "the server stopped before this job ended: submit it again"


class Cancelled(Exception):
    """Raised inside the work of a cancelled job."""


class QueueFull(Exception):
    """The queue of waiting jobs is full."""


class NotRunning(Exception):
    """The job has ended and cannot be cancelled."""


@dataclass(eq=False)
class Task:
    """A waiting or running job, as its work sees it."""

    id: str
    work: "Work"
    notify: Callable[["Task"], None]
    done: int = 0
    total: int = 0
    message: str = "waiting"
    stop: threading.Event = field(default_factory=threading.Event)
    watchers: set[Callable[[], object]] = field(default_factory=set)
    ended: bool = False
    executor: Executor | None = None
    """Runs its computations; None for this machine."""
    release: Callable[[], object] = lambda: None
    """Called when it has ended, whether it ran or not."""
    next_save: float = 0.0
    run: Future[None] = field(default_factory=Future[None])
    is_started: bool = False

    def progress(self, message: str, done: int, total: int) -> None:
        """Publish the progress. Cancelled if the job was cancelled."""
        if self.stop.is_set():
            raise Cancelled
        self.message, self.done, self.total = message, done, total
        self.notify(self)

    def show(self, message: str) -> None:
        self.message = message
        self.notify(self)


Result = dict[str, Any]
Work = Callable[[Task], Result]
"""Runs in a worker thread and returns the job's result."""


class Jobs:
    """The server's long work.

    workers: most running jobs, 0: all wait.   queue: most waiting jobs.
    scheduler: see `executor_at`.
    """

    def __init__(
        self, store: Store, workers: int = 1, queue: int = 20, scheduler: str | None = None
    ) -> None:
        self.store, self._scheduler = store, scheduler
        self.limit = queue
        self._live: dict[str, Task] = {}
        self._lock = threading.Lock()
        self._closing = False
        self._pool = ThreadPoolExecutor(workers, "job") if workers else None

    @property
    def n_waiting(self) -> int:
        return sum(not task.is_started for task in [*self._live.values()])

    @property
    def n_running(self) -> int:
        return len(self._live) - self.n_waiting

    def submit(
        self,
        kind: str,
        request: dict[str, Any],
        work: Work,
        release: Callable[[], object] = lambda: None,
    ) -> str:
        """Queue a job and return its id. QueueFull.

        release: called when the job has ended, whether it ran or not, and if it is not queued.
        """
        try:
            with self._lock:
                return self._queue(kind, request, work, release)
        except BaseException:
            release()
            raise

    def _queue(
        self, kind: str, request: dict[str, Any], work: Work, release: Callable[[], object]
    ) -> str:
        if self._closing or self.n_waiting >= self.limit:
            raise QueueFull(
                f"{self.n_waiting} jobs are waiting, the maximum: wait until one ends, or "
                "cancel one"
            )
        task = Task(self.store.jobs.add(kind, request), work, self._on_progress, release=release)
        self._live[task.id] = task
        if self._pool:
            task.run = self._pool.submit(self._run, task)
        return task.id

    def info(self, job_id: str) -> JobInfo:
        """The job with its current progress. NotFound for an unknown id."""
        return self.fresh(self.store.jobs.info(job_id))

    def fresh(self, info: JobInfo) -> JobInfo:
        """A stored job with its current progress."""
        task = self._live.get(info.id)
        if task is None or info.status != "running":
            return info
        message = f"cancelling: {task.message}" if task.stop.is_set() else task.message
        return replace(info, progress=task.done, total=task.total, message=message)

    def cancel(self, job_id: str) -> None:
        """Cancel a job; it ends at its next step. NotRunning if it has ended."""
        with self._lock:
            task = self._live.get(job_id)
            if task is None:
                status = self.store.jobs.info(job_id).status
                raise NotRunning(f"the job is already {status}: nothing to cancel")
            task.stop.set()
            if task.run.cancel():
                self._end(task, status="cancelled", message="cancelled before it started")

    async def watch(self, job_id: str, interval: float) -> AsyncIterator[JobInfo | None]:
        """Yield the job now and at each change to its end; None after a silent `interval` [s]."""
        loop, changed = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            with suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(changed.set)

        task = self._live.get(job_id)
        if task is not None:
            task.watchers.add(wake)
        try:
            while True:
                changed.clear()
                ended = task is None or task.ended
                info = await asyncio.to_thread(self.info, job_id)
                yield info
                if ended or info.status in ENDED:
                    return
                while not changed.is_set():
                    try:
                        await asyncio.wait_for(changed.wait(), interval)
                    except TimeoutError:
                        yield None
        finally:
            if task is not None:
                task.watchers.discard(wake)

    def close(self) -> None:
        """Stop the workers; waiting and running jobs become `interrupted`."""
        with self._lock:
            self._closing = True
            for task in [*self._live.values()]:
                task.stop.set()
                if task.run.cancel():
                    self._end(task, status="interrupted", error=STOPPED)
        if self._pool:
            self._pool.shutdown()

    def _run(self, task: Task) -> None:
        task.is_started = True
        try:
            self.store.jobs.update(task.id, status="running", message="starting")
            task.progress("starting", 0, 0)
            with announce_compilation(task.show), executor_at(self._scheduler) as task.executor:
                result = task.work(task)
            self._end(
                task,
                status="done",
                progress=task.done,
                total=task.total,
                message="done",
                result=result,
            )
        except Cancelled:
            if self._closing:
                self._end(task, status="interrupted", error=STOPPED)
            else:
                self._end(task, status="cancelled", message=f"cancelled while {task.message}")
        except (ValueError, NotFound, NoSpace) as error:
            # the messages of core, the store and the disk are for people
            self._fail(task, str(error.args[0]) if error.args else type(error).__name__, error)
        except MemoryError as error:
            self._fail(task, "out of memory: ask for fewer rollouts", error)
        except Exception as error:
            self._fail(task, f"internal error: see the server's log, job {task.id}", error)

    def _fail(self, task: Task, text: str, error: Exception) -> None:
        is_foreseen = isinstance(error, (ValueError, NotFound, NoSpace))
        LOG.warning("job %s failed: %s", task.id, error, exc_info=not is_foreseen)
        self._end(task, status="failed", message=f"failed while {task.message}", error=text)

    def _end(self, task: Task, **fields: Any) -> None:
        try:
            self.store.jobs.update(task.id, **fields)
        except Exception:
            LOG.exception("the end of job %s could not be stored: %s", task.id, fields)
        try:
            task.release()
        except Exception:
            LOG.exception("the files of job %s could not be removed", task.id)
        task.ended = True
        self._live.pop(task.id, None)
        self._wake(task)

    def _on_progress(self, task: Task) -> None:
        now = time.monotonic()
        if now >= task.next_save:
            task.next_save = now + SAVE_INTERVAL
            self.store.jobs.update(
                task.id, progress=task.done, total=task.total, message=task.message
            )
        self._wake(task)

    def _wake(self, task: Task) -> None:
        for wake in list(task.watchers):
            wake()
