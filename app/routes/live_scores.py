"""Rescoring of ended live flights from their journals."""

from typing import Annotated, Any

import numpy as np
from fastapi import Body, Response
from pydantic import BaseModel, ConfigDict, Field

from app.flights.flights import Flights
from app.http.head_requests import Router
from app.http.problems import Problem, problem_responses
from app.messages import Frame, plain_frame
from app.routes.dependencies import RecordingsDep, json_response
from app.routes.flights import MOST_FRAMES, First, FlightsDep, Last

router = Router(prefix="/api/v1/flights", tags=["flights"])


class LiveScoreRequest(BaseModel):
    """Monitor and accepted miss rate; those of the flight if absent."""

    model_config = ConfigDict(
        extra="forbid", strict=True, json_schema_extra={"examples": [{"epsilon": 0.1}]}
    )

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


class AlertInterval(BaseModel):
    """An alert from its first sample to its last."""

    start: float = Field(description="[s]")
    end: float = Field(description="[s]")


class LiveScore(BaseModel):
    """Assessments of a live flight by a monitor, each from the samples received by then."""

    flight: str = Field(description="id")
    monitor: str = Field(description="id")
    epsilon: float
    delay: float = Field(description="longest wait of a sample for others [s]")
    lead: float = Field(description="lead time of a shown alert [s]: the monitor's less the delay")
    as_shown: bool | None = Field(
        description="whether the record of the flight is bit for bit the same; null for another "
        "monitor or epsilon than the flight's own"
    )
    n_samples: int
    alerts: list[AlertInterval]
    exceeded_t: float | None = Field(description="time of the first measured exceedance [s]")
    first: int
    next: int | None = Field(description="number of the next frame to request; null at the end")
    frames: list[ShownFrame]


@router.post(
    "/{flight_id}/score", response_model=LiveScore, responses=problem_responses(404, 422, 429)
)
async def score_live(
    flight_id: str,
    flights: FlightsDep,
    recordings: RecordingsDep,
    request: Annotated[LiveScoreRequest | None, Body()] = None,
    first: First = 0,
    last: Last = None,
) -> Response:
    """Rescore an ended live flight from its journal as in flight, without later samples.

    The journal holds each batch with its time of arrival. The flight's own monitor gives the same
    bits as in flight; another monitor gives what it would have shown. The result is not stored.
    """
    request = request or LiveScoreRequest()
    work = recordings.workers.run
    try:
        answer = await work(_answer, flights, flight_id, request, first, last)
    except ValueError as error:
        raise Problem(422, str(error), "urn:forewarn:source") from error
    return json_response(answer)


def _answer(
    flights: Flights, flight_id: str, request: LiveScoreRequest, first: int, last: int | None
) -> dict[str, Any]:
    shown, opening = flights.rescore(flight_id, request.monitor, request.epsilon)
    info = flights.store.flights.info(flight_id)
    is_own = (opening.monitor_id, opening.epsilon) == (info.monitor_id, info.epsilon)
    samples, n = shown.samples, len(shown.samples)
    requested_end = n if last is None else min(last + 1, n)
    stop = max(first, min(first + MOST_FRAMES, requested_end))
    alert = samples["alert"]
    ends = np.flatnonzero(alert & ~np.append(alert[1:], False))
    exceeded = shown.exceedances[:1]
    return {
        "flight": flight_id,
        "monitor": opening.monitor_id,
        "epsilon": opening.epsilon,
        "delay": shown.delay,
        "lead": opening.monitor.lead - shown.delay,
        "as_shown": shown.is_as(flights.store.flights.assessments(flight_id)) if is_own else None,
        "n_samples": n,
        "alerts": [
            {"start": float(samples["t"][begin]), "end": float(samples["t"][end])}
            for begin, end in zip(shown.alerts, ends, strict=True)
        ],
        "exceeded_t": float(samples["t"][exceeded[0]]) if len(exceeded) else None,
        "first": first,
        "next": stop if first < stop < requested_end else None,
        "frames": [
            plain_frame(k, shown.y(k), shown.assessment(k), None)
            | {"shown": float(samples["shown"][k]), "manoeuvre": int(samples["manoeuvre"][k])}
            for k in range(min(first, n), min(stop, n))
        ],
    }
