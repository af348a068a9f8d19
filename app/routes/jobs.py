"""Jobs: progress, results, cancelling; studies and sweeps."""

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import replace
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import StreamingResponse
from fastapi.sse import format_sse_event

from app import json_codec
from app.catalog import study_request_schema, sweep_request_schema
from app.http.events import event_stream, events_of
from app.http.problems import Problem, problem_responses
from app.jobs.jobs import STOPPED, Jobs, Result
from app.jobs.kinds import compare_methods as run_study
from app.jobs.kinds import sweep_leads as run_sweep
from app.jobs.kinds import without_figures
from app.jobs.requests import study_request, sweep_request
from app.recipes.recipes import limits_named, to_plain
from app.recordings.workers import run_to_end
from app.routes.dependencies import (
    PAGED,
    JobsDep,
    PartDep,
    PlainBody,
    SettingsDep,
    StoreDep,
    body_of,
    file_of,
    json_response,
)
from app.store.jobs import ENDED, JobInfo, JobKind

router = APIRouter(prefix="/api/v1", tags=["jobs"])
KEEP_ALIVE = 15.0
"""[s] between comments on a quiet event stream, so that no proxy closes it."""
LAST_EVENT = "end"


ACCEPTED: dict[int | str, dict[str, Any]] = problem_responses(429) | {
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


def queued(*problems: int) -> Any:
    """Arguments of a route that queues long work and returns `accepted`."""
    return {"status_code": 202, "responses": ACCEPTED | problem_responses(*problems)}


def as_sent(info: JobInfo) -> JobInfo:
    """The job with links instead of figures, and the reason of an interruption."""
    error = info.error or (STOPPED if info.status == "interrupted" else None)
    result = without_figures(info.result, info.id)
    return replace(info, request=limits_named(info.request), result=result, error=error)


async def accepted(
    jobs: Jobs,
    kind: str,
    request: dict[str, Any],
    work: Callable[..., Result],
    *arguments: Any,
    release: Callable[[], object] = lambda: None,
) -> Any:
    """Queue `work(task, *arguments)`; 429 if the queue is full. release: see `Jobs.submit`."""
    job_id = await run_to_end(
        jobs.submit, kind, request, lambda task: work(task, *arguments), release
    )
    job = as_sent(await asyncio.to_thread(jobs.info, job_id))
    return json_response(job, 202, {"Location": f"/api/v1/jobs/{job_id}"})


@router.get("/jobs", responses=PAGED)
def list_jobs(
    store: StoreDep,
    jobs: JobsDep,
    part: PartDep,
    kind: Annotated[list[JobKind] | None, Query(description="any of these")] = None,
) -> list[JobInfo]:
    """Jobs, newest first, without the curves of studies and sweeps, in parts."""
    page = store.jobs.listed(part.limit, part.cursor, kind or ())
    part.link_to(page.after)
    return [_short(as_sent(jobs.fresh(info))) for info in page.entries]


def _short(info: JobInfo) -> JobInfo:
    return replace(info, result=None) if info.kind in ("study", "sweep") else info


@router.get("/jobs/{job_id}")
def read_job(job_id: str, jobs: JobsDep) -> JobInfo:
    """One job, with its result when done."""
    return as_sent(jobs.info(job_id))


@router.get(
    "/jobs/{job_id}/figures/{name}",
    responses=file_of("image/svg+xml", "the figure"),
    response_class=Response,
)
def read_figure(job_id: str, name: str, jobs: JobsDep) -> Response:
    """A figure of a study or sweep as SVG; `result.figures` of the job has the links."""
    info = jobs.info(job_id)
    figures = (info.result or {}).get("figures", {})
    if name not in figures:
        raise Problem(404, f"the job has no figure {name}: choose {', '.join(figures) or 'none'}")
    return Response(figures[name], media_type="image/svg+xml")


@router.post("/jobs/{job_id}/cancel", status_code=202, responses=problem_responses(409))
def cancel_job(job_id: str, jobs: JobsDep) -> JobInfo:
    """Cancel a job: it ends at its next step as `cancelled`."""
    jobs.cancel(job_id)
    return as_sent(jobs.info(job_id))


EVENTS = events_of("a Job", {204: {"description": "the stream has ended: do not reconnect"}})


@router.get("/jobs/{job_id}/events", responses=EVENTS, response_class=StreamingResponse)
def stream_job(
    job_id: str,
    request: Request,
    jobs: JobsDep,
    last_event_id: Annotated[str | None, Header()] = None,
) -> Response:
    """Server-sent events: the job now, then at each change. The last one has `id: end`.

    The data of each event is a Job. An EventSource that reconnects after the last event gets 204
    and stops.
    """
    if last_event_id == LAST_EVENT:
        return Response(status_code=204)
    jobs.info(job_id)
    return event_stream(request, _events(job_id, jobs))


async def _events(job_id: str, jobs: JobsDep) -> AsyncIterator[bytes]:
    async for info in jobs.watch(job_id, KEEP_ALIVE):
        if info is None:
            yield format_sse_event(comment="in progress")
            continue
        data = json_codec.encode(as_sent(info)).decode()
        ended = info.status in ENDED
        yield format_sse_event(data_str=data, id=LAST_EVENT if ended else None)


@router.post(
    "/studies",
    tags=["studies"],
    **queued(),
    openapi_extra=body_of(
        study_request_schema(), {"dataset": {"n_unsafe": 50}, "n_monitors": 10, "n_test": 500}
    ),
)
async def compare_methods(plain: PlainBody, store: StoreDep, jobs: JobsDep, settings: SettingsDep):
    """Compare the paper's five methods and the rules of others on one dataset recipe; starts a job.

    The result holds the miss rate and the share of safe flights without a false alarm (power) over
    epsilon with 95 % intervals, a table, and links to the figures.
    """
    recipe = await asyncio.to_thread(study_request, plain, store, settings.max_array_bytes)
    return await accepted(jobs, "study", to_plain(recipe), run_study, recipe)


@router.post(
    "/sweeps",
    tags=["studies"],
    **queued(),
    openapi_extra=body_of(
        sweep_request_schema(),
        {"tests": ["F-16"], "leads_s": [0.25, 0.5], "n_monitors": 1, "n_test": 500},
    ),
)
async def sweep_leads(plain: PlainBody, store: StoreDep, jobs: JobsDep, settings: SettingsDep):
    """Lead-time study of planned tests: the results of each method at each lead; starts a job.

    It covers the planned tests in `tests`, or the test of a `dataset`. For each method and lead the
    result holds the miss rate, the share of safe flights without a false alarm (power) and the
    share of failures that an alert prevents; also a table and a link to the figure.
    """
    recipe, tests = await asyncio.to_thread(sweep_request, plain, store, settings.max_array_bytes)
    details = {"dataset": plain["dataset"], "tests": list(tests)} if "dataset" in plain else {}
    return await accepted(jobs, "sweep", to_plain(recipe) | details, run_sweep, recipe, tests)
