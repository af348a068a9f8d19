"""Live flights over REST: samples, manual manoeuvre starts, and rescoring from the journal."""

import asyncio
from typing import Annotated, Any

from fastapi import APIRouter, Body, Request
from pydantic import BaseModel, Field
from starlette.requests import HTTPConnection

from app.assessment.outcome import alert_times
from app.flights.flights import Flights
from app.http.problems import Problem, problem_responses
from app.messages import Frame, LiveStatus, plain_frame
from app.routes.dependencies import (
    First,
    FlightsDep,
    Last,
    PersonDep,
    RecordingsDep,
    SignedBy,
    SignedRequest,
    TimeInterval,
    body_of,
    frame_range,
    json_response,
    refused,
    signature,
    strictly,
)
from app.routes.flights import FramesPart

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


class LiveScoreRequest(BaseModel):
    """Monitor and accepted miss rate; those of the flight, or its monitor set, if absent."""

    model_config = strictly({"epsilon": 0.1})

    monitor: str | None = Field(default=None, description="id")
    epsilon: float | None = Field(
        default=None,
        gt=0,
        lt=1,
        description="if absent, that of the flight, or of another monitor its own",
    )


class ShownFrame(Frame):
    """A frame of the flight with the time at which it was, or would have been, shown."""

    shown: float = Field(description="[s] since the flight began")
    manoeuvre: int = Field(description="1, 2 ...; 0 between manoeuvres")


class LiveScore(FramesPart):
    """Assessments of a live flight by a monitor, each from the samples received by then."""

    flight: str = Field(description="id")
    monitor: str | None = Field(description="id; null for the monitor set of the flight")
    epsilon: float
    delay: float = Field(description="longest wait of a sample for others [s]")
    lead: float = Field(description="lead time of a shown alert [s]: the monitor's less the delay")
    as_shown: bool | None = Field(
        description="whether the record of the flight is bit for bit the same; null for another "
        "monitor or epsilon than the flight's own"
    )
    n_samples: int
    alerts: list[TimeInterval] = Field(description="each from its first sample to its last")
    exceeded_t: float | None = Field(description="time of the first measured exceedance [s]")
    frames: list[ShownFrame]  # pyright: ignore[reportIncompatibleVariableOverride]


@router.post("/{flight_id}/score", responses=problem_responses(429))
async def score_live(
    flight_id: str,
    flights: FlightsDep,
    recordings: RecordingsDep,
    request: Annotated[LiveScoreRequest | None, Body()] = None,
    first: First = 0,
    last: Last = None,
) -> LiveScore:
    """Rescore an ended live flight from its journal as in flight, without later samples.

    The journal holds each batch with its time of arrival. The flight's own monitor gives the same
    bits as in flight; another monitor gives what it would have shown. The result is not stored.
    """
    arguments = flight_id, request or LiveScoreRequest(), first, last
    with refused(422, "source", ValueError):
        return json_response(await recordings.workers.run(_answer, flights, *arguments))


def _answer(
    flights: Flights, flight_id: str, request: LiveScoreRequest, first: int, last: int | None
) -> dict[str, Any]:
    shown, opening = flights.preparation.rescored(flight_id, request.monitor, request.epsilon)
    info = flights.store.flights.info(flight_id)
    has_set = flight_id in flights.store.monitor_sets.of_flights([flight_id])
    is_own = (opening.monitor_id, opening.epsilon) == (info.monitor_id, info.epsilon)
    is_own = is_own and has_set == (opening.monitors is not None)
    samples, n = shown.samples, len(shown.samples)
    stop, following = frame_range(first, last, n)
    return {
        "flight": flight_id,
        "monitor": opening.monitor_id if opening.monitors is None else None,
        "epsilon": opening.epsilon,
        "delay": shown.delay,
        "lead": opening.monitor.lead - shown.delay,
        "as_shown": shown.is_as(flights.store.flights.assessments(flight_id)) if is_own else None,
        "n_samples": n,
        "alerts": [
            {"start": start, "end": end}
            for start, end in alert_times(samples["t"], samples["alert"])
        ],
        "exceeded_t": shown.exceeded_t,
        "first": first,
        "next": following,
        "frames": [
            plain_frame(k, shown.y(k), shown.assessment(k), None)
            | {"shown": float(samples["shown"][k]), "manoeuvre": int(samples["manoeuvre"][k])}
            for k in range(min(first, n), min(stop, n))
        ],
    }


def sender_of(way: str, connection: HTTPConnection) -> str:
    """The way and address of a source, for people."""
    client = connection.client
    return f"{way} {client.host}:{client.port}" if client else way
