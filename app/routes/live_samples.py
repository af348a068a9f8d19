"""Live samples over REST: batches, acknowledged once durable, and manual manoeuvre starts."""

import asyncio
from typing import Annotated

from fastapi import Body, Request, Response
from pydantic import BaseModel, Field

from app.flights.flights import Flights, TooManyFlights
from app.flights.sources.live import LiveFlight, SequenceConflict
from app.flights.transport import NotPossible
from app.http.head_requests import Router
from app.http.problems import Problem, problem_responses
from app.messages import LiveStatus
from app.routes.dependencies import PersonDep, SignedRequest, signature
from app.routes.flights import FlightsDep
from app.telemetry.journal import JournalFull
from app.telemetry.recording import TelemetryError

router = Router(prefix="/api/v1/flights", tags=["flights"])
DURABLE_WITHIN_S = 5.0
EXAMPLE = {
    "sequence": 1,
    "t": [0.0, 0.02],
    "beta": [0.0, 0.001],
    "p": [0.0, 0.0],
    "r": [0.0, 0.002],
    "Ny": [0.0, 0.001],
    "delta_a": [0.0, 0.0],
    "delta_r": [0.0, 0.01],
}


class SamplesTaken(BaseModel):
    """A durable batch; it survives a crash of the server."""

    sequence: int | None
    accepted: int = Field(description="number of accepted samples; 0 for a repeated batch")
    repeated: bool = Field(description="whether the server had this batch already")
    unread: list[str] = Field(
        default_factory=list, description="names in it that are not read, at most 20"
    )


@router.post(
    "/{flight_id}/samples",
    responses=problem_responses(404, 409, 422, 429, 503),
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {
                "application/json": {
                    "schema": {
                        "type": "object",
                        "description": "`sequence` numbers the batch; time and channels are each a "
                        "number, null or a list of them",
                        "properties": {"sequence": {"type": "integer", "minimum": 0}},
                        "additionalProperties": True,
                    },
                    "example": EXAMPLE,
                }
            },
        }
    },
)
async def push_samples(flight_id: str, request: Request, flights: FlightsDep) -> SamplesTaken:
    """Push a batch into a live flight. It is shown at once; the response confirms it is durable.

    A repeated batch with the same number is used once; 409 for a different batch with that number.
    503: the batch is shown but not durable yet; repeat it until the answer is 200.
    """
    flight = await _live(flight_id, flights)
    try:
        received = flight.receive(await request.body(), "rest")
    except NotPossible as error:
        raise Problem(409, str(error), "urn:forewarn:not-live") from error
    except SequenceConflict as error:
        raise Problem(409, str(error), "urn:forewarn:sequence") from error
    except TelemetryError as error:
        raise Problem(422, str(error), "urn:forewarn:telemetry") from error
    except JournalFull as error:
        raise Problem(503, str(error), "urn:forewarn:not-durable") from error
    try:
        await asyncio.wait_for(asyncio.shield(received.stored), DURABLE_WITHIN_S)
    except TimeoutError:
        problem = flight.live.problem or "the disk is slow"
        text = f"the batch is not durable yet ({problem}): repeat it under the same sequence"
        raise Problem(503, text, "urn:forewarn:not-durable") from None
    return SamplesTaken(
        sequence=received.sequence,
        accepted=received.n_samples,
        repeated=received.repeated,
        unread=list(received.unread),
    )


@router.get("/{flight_id}/samples", responses=problem_responses(404, 409, 422, 429))
async def read_live(flight_id: str, flights: FlightsDep) -> LiveStatus:
    """State of the source of a live flight, and the last batch received; continue after it."""
    return (await _live(flight_id, flights)).live


@router.post("/{flight_id}/manoeuvre", status_code=204, responses=problem_responses(404, 409, 422))
async def begin_manoeuvre(
    flight_id: str,
    flights: FlightsDep,
    person: PersonDep,
    who: Annotated[SignedRequest | None, Body()] = None,
) -> Response:
    """Mark the start of a manoeuvre that the control surfaces do not show."""
    flight = await _live(flight_id, flights)
    try:
        written = flight.begin_manoeuvre(signature(person, (who or SignedRequest()).by))
        await asyncio.shield(written)
    except NotPossible as error:
        raise Problem(409, str(error), "urn:forewarn:not-live") from error
    return Response(status_code=204)


async def _live(flight_id: str, flights: Flights) -> LiveFlight:
    try:
        return await flights.live(flight_id)
    except TooManyFlights as error:
        raise Problem(429, str(error), "urn:forewarn:too-many-flights") from error
    except NotPossible as error:
        raise Problem(409, str(error), "urn:forewarn:not-live") from error
