"""Whether the server is alive and ready, and what it measures of itself."""

import asyncio

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from app.metrics import CONTENT_TYPE
from app.problems import Problem, problem_responses
from app.routes.dependencies import StoreDep
from core import __version__

router = APIRouter(tags=["health"])


class Health(BaseModel):
    """The server answers."""

    status: str = Field("ok", examples=["ok"])


class Readiness(BaseModel):
    """The server can work: its store answers."""

    status: str = Field("ready", examples=["ready"])
    version: str = Field(examples=[__version__])


@router.get("/healthz")
async def health() -> Health:
    """Whether the process answers; open without a token."""
    return Health(status="ok")


@router.get("/readyz", responses=problem_responses(503))
async def readiness(store: StoreDep) -> Readiness:
    """Whether the store can be read."""
    try:
        await asyncio.to_thread(store.jobs.all)
    except Exception as error:
        raise Problem(503, "the store cannot be read", "urn:forewarn:store") from error
    return Readiness(status="ready", version=__version__)


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
async def measures(request: Request) -> Response:
    """Counters in Prometheus's text format."""
    body = await asyncio.to_thread(request.app.state.metrics.text)
    return Response(body, media_type=CONTENT_TYPE)
