"""The server itself: health, integrity, metrics, storage, and its demonstration."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import StreamingResponse
from fastapi.sse import format_sse_event
from pydantic import BaseModel, Field
from starlette.datastructures import State as AppState

from app.demonstration import Demonstration, DemonstrationProgress
from app.flights.flights import Flights
from app.http.events import Changes, event_stream, events_of
from app.http.metrics import CONTENT_TYPE
from app.http.problems import Problem
from app.routes.dependencies import (
    Described,
    JournalsDep,
    RecordingsDep,
    SettingsDep,
    StoreDep,
    part,
    strictly,
)
from app.upkeep.integrity import Damage, Integrity, State
from app.upkeep.usage import DiskSpace, StorageUsage, space_of, usage_of
from core import __version__
from core.counted import counted

router = APIRouter()
ChangesDep = Annotated[Changes, part("changes")]
MOST_DAMAGED = 20
"""Largest number of damaged items in a readiness response."""


class Health(BaseModel):
    """The server answers."""

    status: str = Field("ok", examples=["ok"])


class Readiness(Described):
    """The store can be read and written, and every flight is recorded."""

    status: str = Field("ready", examples=["ready"])
    version: str = Field(examples=[__version__])
    unwritten: int = Field(description="samples of flights not stored yet; a few are normal")
    lost: int = Field(description="samples that could not be recorded since the server started")
    damaged: list[str]
    """damaged items, which are not served; everything else is"""
    older: str
    """one sentence if the database is older than at its last good stop, else empty"""


class IntegrityReport(Described):
    """Result so far of the integrity check of the stored data."""

    state: State
    """`begun`: starts soon; `checking` everything in the background; `checked`; `stopped` before
    the end"""
    checked: int
    """monitors, datasets, recordings, scorings and flights checked so far"""
    unverified: int
    """flights without a digest of their samples or journal: readable, not verified"""
    damaged: list[Damage]
    elsewhere: int
    """recordings and live flights whose files are in another data directory: listed, not
    readable"""
    unlisted: int
    """recordings and live flights whose files are in the data directory, and which the database
    does not list: it may be an older one, or that of another server"""
    older: str
    """one sentence if the database is older than at its last good stop, else empty"""


@router.get("/healthz", tags=["health"])
@router.head("/healthz", include_in_schema=False)
async def health() -> Health:
    """Whether the process answers. Needs no token."""
    return Health(status="ok")


@router.get("/readyz", tags=["health"])
@router.head("/readyz", include_in_schema=False)
async def readiness(request: Request) -> Readiness:
    """Whether the store can be read and written, and every flight is recorded."""
    state = request.app.state
    flights: Flights = state.flights
    details: dict[str, Any] = {"unwritten": flights.unwritten, "lost": flights.lost}
    details["older"] = state.store.last_stop.older
    detail = await state.store_health.check()
    if not detail and flights.problem:
        detail = f"not stored yet: {counted(flights.unwritten, 'sample')} of flights"
    damaged = await _damaged(state)
    details["damaged"] = [str(damage) for damage in damaged[:MOST_DAMAGED]]
    detail = next((str(damage) for damage in damaged if damage.kind == "database"), detail)
    if detail:
        raise Problem(503, detail, "urn:forewarn:store", **details)
    return Readiness(status="ready", version=__version__, **details)


@router.get("/api/v1/integrity", tags=["health"])
async def integrity(request: Request) -> IntegrityReport:
    """Damaged data, from the check that follows the start of the server."""
    known: Integrity = request.app.state.integrity
    damaged = await _damaged(request.app.state)
    return IntegrityReport(
        state=known.state,
        checked=known.n_checked,
        unverified=len(known.unverified),
        damaged=damaged,
        elsewhere=await asyncio.to_thread(known.n_elsewhere),
        unlisted=await asyncio.to_thread(known.n_unlisted),
        older=request.app.state.store.last_stop.older,
    )


async def _damaged(state: AppState) -> list[Damage]:
    return await asyncio.to_thread(state.integrity.damaged) if state.integrity.n_damaged else []


@router.get(
    "/api/v1/events",
    tags=["health"],
    responses=events_of("an object of numbers", {}),
    response_class=StreamingResponse,
)
async def stream_changes(request: Request, changes: ChangesDep) -> Response:
    """Server-sent events: a number for each list, now, at each change, and at least every 2 s.

    A list changed if its number is another one: `flights_in_progress`, also with a headline or
    state; `flights`, the stored ones; `campaigns`.
    """
    return event_stream(request, _revisions(changes))


async def _revisions(changes: Changes) -> AsyncIterator[bytes]:
    async for revisions in changes.watch():
        yield format_sse_event(data_str=json.dumps(revisions))


@router.get(
    "/metrics",
    tags=["health"],
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
def measures(request: Request) -> Response:
    """Metrics in the text format of Prometheus."""
    body = request.app.state.metrics.text()
    return Response(body, media_type=CONTENT_TYPE)


class Keeping(BaseModel):
    """Whether an item is kept permanently; it can then not be deleted."""

    model_config = strictly({"keep": True})

    keep: bool


@router.get("/api/v1/storage", tags=["storage"])
def read_storage(
    recordings: RecordingsDep, journals: JournalsDep, settings: SettingsDep
) -> StorageUsage:
    """Disk usage of the database, the files and each kind; largest and oldest items; free space.

    Sizes are in bytes. `warning` is not empty if the disk is nearly full.
    """
    return usage_of(recordings, journals, settings.data_dir)


@router.get("/api/v1/storage/space", tags=["storage"])
def read_space(settings: SettingsDep) -> DiskSpace:
    """Free space on the disk of the data [bytes], with a warning if it is nearly full."""
    return space_of(settings.data_dir)


@router.put("/api/v1/flights/{flight_id}/keep", tags=["storage"])
def keep_flight(flight_id: str, keeping: Keeping, store: StoreDep) -> Keeping:
    """Keep a flight permanently, or release it."""
    store.flights.keep(flight_id, keeping.keep)
    return keeping


@router.put("/api/v1/recordings/{recording_id}/keep", tags=["storage"])
def keep_recording(recording_id: str, keeping: Keeping, store: StoreDep) -> Keeping:
    """Keep a recording permanently, or release it."""
    store.recordings.keep(recording_id, keeping.keep)
    return keeping


DemonstrationDep = Annotated[Demonstration, part("demonstration")]


@router.get("/api/v1/demonstration", tags=["demonstration"])
async def read_demonstration(demonstration: DemonstrationDep) -> DemonstrationProgress | None:
    """Progress of the live demonstration; null before it is started."""
    return demonstration.progress


@router.post("/api/v1/demonstration", tags=["demonstration"], status_code=202)
async def start_demonstration(demonstration: DemonstrationDep) -> DemonstrationProgress | None:
    """Start the demonstration: train its small monitor if missing, then fly a failing flight."""
    demonstration.start()
    return demonstration.progress
