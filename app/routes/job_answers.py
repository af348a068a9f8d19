"""How jobs are sent; the answer to an order for long work: 202, and where its job is."""

import asyncio
from typing import Any

from fastapi import Response
from pydantic import BaseModel, ConfigDict, Field

from app.jobs.jobs import STOPPED, Jobs, QueueFull, Work
from app.jobs.kinds import without_figures
from app.problems import Problem, problem_responses
from app.store.jobs import JobInfo, JobStatus

ACCEPTED: dict[int | str, dict[str, Any]] = problem_responses(404, 413, 415, 422, 429) | {
    202: {
        "description": "queued; the job is at `Location`",
        "headers": {
            "Location": {
                "description": "the job",
                "schema": {"type": "string", "examples": ["/api/v1/jobs/3f9a1c20b7de"]},
            }
        },
    }
}


class Job(BaseModel):
    """Long work under way or ended."""

    model_config = ConfigDict(from_attributes=True)

    id: str
    kind: str = Field(description="`dataset`, `monitor` or `study`", examples=["monitor"])
    status: JobStatus = Field(
        description="`interrupted`: the server stopped while it was under way"
    )
    progress: float | None = Field(description="done, of `total`, of what `message` says")
    total: float | None = Field(description="in all; null or 0 while unknown")
    message: str = Field(examples=["simulating: 12 unsafe of 640 rollouts"])
    error: str | None = Field(description="why it failed or was interrupted")
    result: dict[str, Any] | None = Field(
        description="what it made: ids of the dataset and monitor, or a study's curves"
    )
    request: dict[str, Any] = Field(description="what was asked for")
    created: str = Field(description="UTC, ISO 8601")
    started: str | None = Field(description="UTC, ISO 8601")
    ended: str | None = Field(description="UTC, ISO 8601")


def job_model(info: JobInfo) -> Job:
    """The job as it is sent: figures as links, and why it was interrupted."""
    job = Job.model_validate(info)
    error = job.error or (STOPPED if job.status == "interrupted" else None)
    return job.model_copy(update={"result": without_figures(job.result, job.id), "error": error})


async def accepted(jobs: Jobs, kind: str, request: dict[str, Any], work: Work) -> Response:
    """Queue the work; 429 where too much waits already."""
    try:
        job_id = await asyncio.to_thread(jobs.submit, kind, request, work)
    except QueueFull as error:
        raise Problem(429, str(error), "urn:forewarn:queue-full") from None
    job = job_model(await asyncio.to_thread(jobs.info, job_id))
    location = {"Location": f"/api/v1/jobs/{job_id}"}
    return Response(job.model_dump_json(), 202, location, "application/json")
