"""Responses about jobs: a job as sent, and 202 with its address for a new one."""

import asyncio
from dataclasses import replace
from typing import Any

from fastapi import Response

from app.http.problems import Problem, problem_responses
from app.jobs.jobs import STOPPED, Jobs, QueueFull, Work
from app.jobs.kinds import without_figures
from app.recipes.recipes import limits_named
from app.routes.dependencies import json_response
from app.store.jobs import JobInfo

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


def as_sent(info: JobInfo) -> JobInfo:
    """The job with links instead of figures, and the reason of an interruption."""
    error = info.error or (STOPPED if info.status == "interrupted" else None)
    result = without_figures(info.result, info.id)
    return replace(info, request=limits_named(info.request), result=result, error=error)


async def accepted(jobs: Jobs, kind: str, request: dict[str, Any], work: Work) -> Response:
    """Queue the work; 429 if the queue is full."""
    try:
        job_id = await asyncio.to_thread(jobs.submit, kind, request, work)
    except QueueFull as error:
        raise Problem(429, str(error), "urn:forewarn:queue-full") from None
    job = as_sent(await asyncio.to_thread(jobs.info, job_id))
    return json_response(job, 202, {"Location": f"/api/v1/jobs/{job_id}"})
