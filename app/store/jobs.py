"""Stored jobs: request, progress and result of long work."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import insert, update

from app.store.repository import Entries, Entry, Page, Time
from app.store.tables import jobs, new_id, now

JobKind = Literal["dataset", "monitor", "clearance", "study", "sweep", "epsilon"]
JobStatus = Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
ENDED: tuple[JobStatus, ...] = ("done", "failed", "cancelled", "interrupted")
STATUSES: tuple[JobStatus, ...] = ("queued", "running", *ENDED)


@dataclass(frozen=True)
class JobInfo(Entry):
    """Long work, in progress or ended."""

    id: str
    kind: str
    """`dataset`, `monitor`, `clearance`, `study`, `sweep` or `epsilon`"""
    request: dict[str, Any]
    """request as given"""
    status: JobStatus
    """`interrupted`: the server stopped while it was running"""
    progress: float | None
    """amount done, out of `total`; `message` names the unit"""
    total: float | None
    """total amount; null or 0 while unknown"""
    message: str
    result: dict[str, Any] | None
    """ids of the dataset and monitor it made, or a study's curves"""
    error: str | None
    """why it failed or was interrupted"""
    created: Time
    started: Time | None
    ended: Time | None


class JobRepository(Entries[JobInfo]):
    """Jobs by id."""

    table, entry = jobs, JobInfo

    def add(self, kind: str, request: dict[str, Any]) -> str:
        """Store a queued job and return its id."""
        job_id = new_id()
        row = {"id": job_id, "kind": kind, "request": request, "status": "queued", "message": ""}
        with self._writing() as connection:
            connection.execute(insert(jobs).values(**row, created=now()))
        return job_id

    def listed(self, limit: int, after: str, kinds: Collection[JobKind] = ()) -> Page[JobInfo]:
        """Jobs of some kinds, or of all; arguments as in `page`."""
        conditions = [jobs.c.kind.in_(kinds)] if kinds else []
        return self.page(limit, after, *conditions)

    def update(
        self,
        job_id: str,
        status: JobStatus | None = None,
        **changes: Any,
    ) -> JobInfo:
        """Store the fields given and return the job. A job that has ended does not change."""
        if status is not None and status not in STATUSES:
            raise ValueError(f"job status {status!r} is unknown: choose {', '.join(STATUSES)}")
        changes["status"] = status
        changes["started"] = now() if status == "running" else None
        changes["ended"] = now() if status in ENDED else None
        changes = {key: value for key, value in changes.items() if value is not None}
        with self._writing() as connection:
            job = self._fetch(connection, job_id)
            if not changes or job.status in ENDED:
                return job
            if job.started is not None:
                changes.pop("started", None)
            connection.execute(update(jobs).where(jobs.c.id == job_id).values(**changes))
            return self._fetch(connection, job_id)

    def recover(self) -> None:
        """Mark unfinished jobs as interrupted: the process that ran them died."""
        unfinished = jobs.c.status.in_(("queued", "running"))
        interrupted = {"status": "interrupted", "ended": now()}
        with self._writing() as connection:
            connection.execute(update(jobs).where(unfinished).values(**interrupted))
