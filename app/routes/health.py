"""Whether the server is alive and ready, and what it measures of itself."""

import asyncio
from dataclasses import asdict
from typing import Any

from fastapi import Request, Response
from pydantic import BaseModel, Field
from starlette.datastructures import State as AppState

from app.flights.flights import Flights
from app.http.head_requests import Router
from app.http.problems import Problem, problem_responses
from app.integrity import Damage, Integrity, Kind, State
from app.metrics import CONTENT_TYPE
from core import __version__

router = Router(tags=["health"])
MOST_DAMAGED = 20
"""Damaged things that readiness names."""


class Health(BaseModel):
    """The server answers."""

    status: str = Field("ok", examples=["ok"])


class Readiness(BaseModel):
    """The server can work: its store answers and takes what is to be kept."""

    status: str = Field("ready", examples=["ready"])
    version: str = Field(examples=[__version__])
    unwritten: int = Field(description="samples of flights that wait for the store; a few do")
    lost: int = Field(description="samples that could not be recorded since the server started")
    damaged: list[str] = Field(
        description="what is stored and was found damaged: it is not served; all else is"
    )


class DamagedItem(BaseModel):
    """Something stored that is not as it was stored; it is not served."""

    kind: Kind
    id: str = Field(description="empty of the database itself")
    name: str
    detail: str = Field(description="what is wrong and what to do")


class IntegrityReport(BaseModel):
    """What is known of the integrity of what is stored."""

    state: State = Field(
        description="`begun`: looked at, for a moment; `checking` all of it in the background; "
        "`checked`; `stopped` before its end"
    )
    checked: int = Field(description="monitors, datasets, recordings and scorings checked so far")
    damaged: list[DamagedItem]


@router.get("/healthz")
async def health() -> Health:
    """Whether the process answers; open without a token."""
    return Health(status="ok")


@router.get("/readyz", responses=problem_responses(503))
async def readiness(request: Request) -> Readiness:
    """Whether the store can be read, can be written, and every flight is recorded."""
    state = request.app.state
    flights: Flights = state.flights
    told: dict[str, Any] = {"unwritten": flights.unwritten, "lost": flights.lost}
    detail = await state.store_health.check()
    if not detail and flights.problem:
        detail = f"{flights.unwritten} samples of flights wait for the store"
    damaged = await _damaged(state)
    told["damaged"] = [str(damage) for damage in damaged[:MOST_DAMAGED]]
    detail = next((str(damage) for damage in damaged if damage.kind == "database"), detail)
    if detail:
        raise Problem(503, detail, "urn:forewarn:store", **told)
    return Readiness(status="ready", version=__version__, **told)


@router.get("/api/v1/integrity")
async def integrity(request: Request) -> IntegrityReport:
    """What of the data was found damaged: looked at when the server started, then checked whole."""
    state = request.app.state
    known: Integrity = state.integrity
    items = [DamagedItem(**asdict(damage)) for damage in await _damaged(state)]
    return IntegrityReport(state=known.state, checked=known.n_checked, damaged=items)


async def _damaged(state: AppState) -> list[Damage]:
    """What was found damaged and is still there."""
    return await asyncio.to_thread(state.integrity.damaged) if state.integrity.n_damaged else []


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
async def measures(request: Request) -> Response:
    """Counters in Prometheus's text format."""
    body = await asyncio.to_thread(request.app.state.metrics.text)
    return Response(body, media_type=CONTENT_TYPE)
