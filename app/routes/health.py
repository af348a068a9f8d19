"""Health, readiness, integrity of the stored data, and metrics."""

import asyncio
from dataclasses import asdict
from typing import Any

from fastapi import Request, Response
from pydantic import BaseModel, Field
from starlette.datastructures import State as AppState

from app.flights.flights import Flights
from app.http.head_requests import Router
from app.http.metrics import CONTENT_TYPE
from app.http.problems import Problem, problem_responses
from app.upkeep.integrity import Damage, Integrity, Kind, State
from core import __version__

router = Router(tags=["health"])
MOST_DAMAGED = 20
"""Largest number of damaged items in a readiness response."""


class Health(BaseModel):
    """The server answers."""

    status: str = Field("ok", examples=["ok"])


class Readiness(BaseModel):
    """The store can be read and written, and every flight is recorded."""

    status: str = Field("ready", examples=["ready"])
    version: str = Field(examples=[__version__])
    unwritten: int = Field(description="samples of flights not stored yet; a few are normal")
    lost: int = Field(description="samples that could not be recorded since the server started")
    damaged: list[str] = Field(
        description="damaged items, which are not served; everything else is"
    )


class DamagedItem(BaseModel):
    """A damaged item of the store; it is not served."""

    kind: Kind
    id: str = Field(description="empty for the database itself")
    name: str
    detail: str = Field(description="what is wrong and what to do")


class IntegrityReport(BaseModel):
    """Result so far of the integrity check of the stored data."""

    state: State = Field(
        description="`begun`: quick check at the start; `checking` everything in the background; "
        "`checked`; `stopped` before the end"
    )
    checked: int = Field(description="monitors, datasets, recordings and scorings checked so far")
    damaged: list[DamagedItem]


@router.get("/healthz")
async def health() -> Health:
    """Whether the process answers. Needs no token."""
    return Health(status="ok")


@router.get("/readyz", responses=problem_responses(503))
async def readiness(request: Request) -> Readiness:
    """Whether the store can be read and written, and every flight is recorded."""
    state = request.app.state
    flights: Flights = state.flights
    details: dict[str, Any] = {"unwritten": flights.unwritten, "lost": flights.lost}
    detail = await state.store_health.check()
    if not detail and flights.problem:
        detail = f"{flights.unwritten} samples of flights are not stored yet"
    damaged = await _damaged(state)
    details["damaged"] = [str(damage) for damage in damaged[:MOST_DAMAGED]]
    detail = next((str(damage) for damage in damaged if damage.kind == "database"), detail)
    if detail:
        raise Problem(503, detail, "urn:forewarn:store", **details)
    return Readiness(status="ready", version=__version__, **details)


@router.get("/api/v1/integrity")
async def integrity(request: Request) -> IntegrityReport:
    """Damaged data, from the quick check at the start and the complete check after it."""
    state = request.app.state
    known: Integrity = state.integrity
    items = [DamagedItem(**asdict(damage)) for damage in await _damaged(state)]
    return IntegrityReport(state=known.state, checked=known.n_checked, damaged=items)


async def _damaged(state: AppState) -> list[Damage]:
    return await asyncio.to_thread(state.integrity.damaged) if state.integrity.n_damaged else []


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
async def measures(request: Request) -> Response:
    """Metrics in the text format of Prometheus."""
    body = await asyncio.to_thread(request.app.state.metrics.text)
    return Response(body, media_type=CONTENT_TYPE)
