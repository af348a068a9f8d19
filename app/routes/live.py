"""Live flights over REST: samples, manual manoeuvre starts, and senders of datagrams."""

import asyncio

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field
from starlette.requests import HTTPConnection

from app.http.problems import Problem, problem_responses
from app.messages import LiveStatus
from app.routes.dependencies import (
    FlightsDep,
    PersonDep,
    SignedBy,
    SignedRequest,
    body_of,
    signature,
    strictly,
)

router = APIRouter(prefix="/api/v1/flights", tags=["flights"])
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


class SenderRequest(SignedRequest):
    """The source of a flight's datagrams from now on."""

    model_config = strictly({"sender": "10.0.0.7:4000", "by": "Ann"})

    sender: str = Field(description="host:port, as in `other_sender`", max_length=60)


@router.post(
    "/{flight_id}/samples",
    responses=problem_responses(409, 429),
    openapi_extra=body_of(
        {
            "type": "object",
            "description": "`sequence` numbers the batch; time and channels are each a "
            "number, null or a list of them",
            "properties": {"sequence": {"type": "integer", "minimum": 0}},
            "additionalProperties": True,
        },
        EXAMPLE,
    ),
)
async def push_samples(flight_id: str, request: Request, flights: FlightsDep) -> SamplesTaken:
    """Push a batch into a live flight. It is shown at once; the response confirms it is durable.

    A repeated batch with the same number is used once; 409 for a different batch with that number.
    503: the batch is shown but not durable yet; repeat it until the answer is 200.
    """
    flight = await flights.live(flight_id)
    received = flight.receive(await request.body(), sender_of("REST", request))
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


@router.get("/{flight_id}/samples", responses=problem_responses(409, 429))
async def read_live(flight_id: str, flights: FlightsDep) -> LiveStatus:
    """State of the source of a live flight, and the last batch received; continue after it."""
    return (await flights.live(flight_id)).live


@router.post("/{flight_id}/manoeuvre", status_code=204, responses=problem_responses(409))
async def begin_manoeuvre(flight_id: str, flights: FlightsDep, by: SignedBy) -> None:
    """Mark the start of a manoeuvre that the control surfaces do not show."""
    flight = await flights.live(flight_id)
    await asyncio.shield(flight.begin_manoeuvre(by))


@router.post("/{flight_id}/sender", status_code=204, responses=problem_responses(409))
async def change_sender(
    flight_id: str, flights: FlightsDep, person: PersonDep, request: SenderRequest
) -> None:
    """Accept datagrams of another sender as the source, instead of the present one."""
    flight = await flights.live(flight_id)
    by = signature(person, request.by)
    await asyncio.shield(flight.change_sender(request.sender, by))


def sender_of(way: str, connection: HTTPConnection) -> str:
    """The way and address of a source, for people."""
    client = connection.client
    return f"{way} {client.host}:{client.port}" if client else way
