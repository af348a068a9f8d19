"""Flights over REST: start, steer, end and read."""

import asyncio
from dataclasses import asdict
from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, ConfigDict, Field, StrictBool, model_validator

from app.flights.compared import FlightComparison, compared
from app.flights.display_monitors import flown_monitors
from app.flights.ended import Record, records
from app.flights.flight import Flight
from app.flights.flight_monitors import stored_sets
from app.flights.flight_records import accepts_useless, flight_name, source_of
from app.flights.flights import Flights
from app.flights.recorder import INTERVAL_S
from app.flights.request import FlightRequest
from app.flights.sources.source import mode_of
from app.http.problems import Problem, problem_responses
from app.messages import (
    Decided,
    FlownMonitor,
    Frame,
    LimitsFrom,
    LimitsStatus,
    LiveStatus,
    Mode,
    MonitorSetStatus,
    TransportState,
)
from app.routes.dependencies import (
    PAGED,
    By,
    Described,
    First,
    FlightsDep,
    Last,
    Moment,
    PartDep,
    PersonDep,
    SignedBy,
    json_response,
    last_frame,
    signature,
    strictly,
)
from app.store.flights import FlightFilter, FlightInfo, Progress
from app.store.people import LOCAL
from core.evaluation.certificate import UselessMonitor
from core.flight_events import Alarm, FlightMarker, FlightMarkerKey, TrimChange
from core.limits.exceedance import ChannelExceedances
from core.monitor import State
from core.monitor.assessment import Cause
from core.monitor.status import Facts, Level, headline

router = APIRouter(prefix="/api/v1/flights", tags=["flights"])


class FlightStatus(Decided):
    """A flight in progress or ended. Fields of a flight in progress are null afterwards."""

    model_config = ConfigDict(extra="ignore")

    id: str
    name: str
    progress: str
    """`running`, `ended`, `failed` or `interrupted`; `ending`: the flight is over and its record is
    not stored yet"""
    reason: str = ""
    """why its newest sample was not assessed; empty if it was"""
    cause: Cause | None = Field(default=None, description="cause of that reason, as in a frame")
    age: float | None = None
    """age of the newest sample of a live flight [s]; null for other flights"""
    exceedances: list[ChannelExceedances] = Field(default_factory=list)
    """count, newest and worst exceedance of each channel that exceeded its limit"""
    limits_held: list[LimitsFrom] | None = None
    """limits in force during the flight; empty for the monitor's own limits; null if unknown
    because the flight was cut short"""
    source: dict[str, Any]
    mode: Mode = Field(description="whether its samples are measured, replayed or simulated")
    monitor: str | None
    """id of the alarm authority; of a monitor set, of the one in use, null for none"""
    monitor_set: MonitorSetStatus | None = None
    """the monitor set of the flight, and which monitor is in use; null without one"""
    monitors: list[FlownMonitor]
    """the alarm authority, then those flown for display"""
    warnings: list[str]
    """reasons not to rely on the monitor at this epsilon, from its test flights or because it was
    not tested"""
    epsilon: float
    keep: bool = Field(description="whether it is kept permanently")
    accept_useless: bool
    """whether the request accepted a monitor that alerts on nearly every safe flight"""
    created: str = Field(description="UTC, ISO 8601")
    ended: str | None = Field(description="UTC, ISO 8601")
    head: int = Field(description="newest sample number; -1 before the first sample")
    theta: dict[str, float] | None = None
    """parameters of a simulated aircraft"""
    fail_t: float | None = None
    """time at which the source exceeds a limit [s], if known"""
    state: State | None = None
    transport: TransportState | None = None
    watchers: int | None = None
    open_alarms: int | None = Field(default=None, description="unacknowledged warnings")
    open_cautions: int | None = Field(default=None, description="unacknowledged cautions")
    lost: int | None = Field(
        default=0,
        description="samples that could not be recorded; null if the server was killed during the "
        f"flight: samples flown in the {INTERVAL_S:g} s before that may be missing",
    )
    unwritten: int | None = Field(default=None, description="samples not stored yet")
    end_reason: str = ""
    """why a flight ended, and who ended it; empty where it was not recorded"""
    recording: str | None = None
    """id of the recording made of an ended live flight"""
    limits: LimitsStatus | None = None
    """limits in force now from a limit set; null for the monitor's own limits"""
    live: LiveStatus | None = None
    """state of the source of a live flight, now or at its end; null in lists and if the server was
    killed during the flight"""


MOST_ID = 40


class TransportRequest(BaseModel):
    """An action: seek to [s], step by samples (backwards if negative), speed 0.1 to 10, loop.

    `lead` lets a screen lead the replay, which others then follow.
    """

    model_config = strictly({"action": "seek", "value": 2.5})

    action: Literal["play", "pause", "seek", "step", "speed", "loop", "next_alert", "lead"]
    value: StrictBool | Annotated[float, Field(allow_inf_nan=False)] | None = None
    """seek [s], step [samples, 1 if absent], speed [factor] or loop [bool]"""
    screen: str = Field(default="", max_length=MOST_ID)
    """of the screen that steers, as in its stream's address; 409 while another connected screen
    leads. A program gives none"""


class FramesPart(Described):
    """Frames in order."""

    first: int
    next: int | None = Field(description="number of the next frame to request; null at the end")
    frames: list[Frame]
    trims: list[TrimChange] | None = None
    """where the trim changed that is subtracted from limited channels, the newest 50, in order;
    before the first, `y` is as recorded. null: the source's samples are from trim, or the server
    was killed during the flight"""


class MarkerRequest(BaseModel):
    """A marker to set in a flight."""

    model_config = strictly({"kind": "abort", "by": "test conductor"})

    kind: FlightMarkerKey
    """`abort`: safety of flight; `knock_it_off`: no useful data; `call_cleared`: the call is in
    force no more; `event`: `text`"""
    by: By = LOCAL
    text: str | None = Field(default=None, min_length=1, max_length=2000)
    t: Annotated[float, Field(allow_inf_nan=False)] | None = None
    """of an event [s]: the time it is about; default: the newest"""

    @model_validator(mode="after")
    def check_event(self) -> Self:
        if self.kind == "event" and not (self.text or "").strip():
            raise ValueError("an event was given without words: give `text`")
        if self.kind != "event" and self.t is not None:
            raise ValueError(f"{self.kind} is set at the newest sample: leave out t")
        return self


@router.post("", status_code=201, responses=problem_responses(429))
async def start_flight(
    request: FlightRequest, flights: FlightsDep, response: Response, person: PersonDep
) -> FlightStatus:
    """Start a flight. It plays at once at the rate of its source.

    A simulated or replayed flight pauses at the end of its source. It ends after 10 minutes without
    steering, unless a watcher is connected while an alarm is unacknowledged.
    """
    try:
        flight = await flights.start(request, signature(person, LOCAL))
    except UselessMonitor as error:
        raise Problem(422, f"{error}: accept_useless", "urn:forewarn:useless-monitor") from error
    except ValueError as error:
        raise Problem(422, str(error), "urn:forewarn:source") from error
    response.headers["Location"] = f"{router.prefix}/{flight.id}"
    return await read_flight(flight.id, flights)


@router.get("", responses=PAGED)
async def list_flights(
    flights: FlightsDep,
    part: PartDep,
    progress: Annotated[list[Progress] | None, Query(description="any of these")] = None,
    monitor: Annotated[str, Query(description="id of the alarm authority")] = "",
    aircraft: Annotated[str, Query(description="of its recording")] = "",
    since: Moment = None,
    until: Moment = None,
    text: Annotated[
        str, Query(description="part of the name of the flight or its monitor, or its id")
    ] = "",
) -> list[FlightStatus]:
    """Flights, in progress or ended, newest first, in parts.

    since, until: of their starts.
    """
    wanted = FlightFilter(tuple(progress or ()), monitor, aircraft, text, since, until)
    page = await asyncio.to_thread(flights.store.flights.listed, part.limit, part.cursor, wanted)
    part.link_to(page.after)
    return await _statuses(flights, page.entries)


@router.get("/{flight_id}")
async def read_flight(flight_id: str, flights: FlightsDep) -> FlightStatus:
    """One flight."""
    info = await asyncio.to_thread(flights.store.flights.info, flight_id)
    status = (await _statuses(flights, [info], anew=True))[0]
    records = flights.records
    live, why = await records.live_status(flight_id), await records.end_reason(info)
    return status.model_copy(update={"live": live, "end_reason": why})


@router.post("/{flight_id}/end", responses=problem_responses(409, 429))
async def end_flight(flight_id: str, flights: FlightsDep, by: SignedBy) -> FlightStatus:
    """End a flight in progress and keep its record. An ended flight does not change.

    An interrupted live flight is first completed from its journal. A live flight then becomes a
    recording in the background. 503 if the record could not be completed: the flight is over, and
    the rest of its record is written once the store accepts writes.
    """
    await flights.end(flight_id, by)
    return await read_flight(flight_id, flights)


@router.delete("/{flight_id}", status_code=204, responses=problem_responses(409))
async def delete_flight(flight_id: str, flights: FlightsDep) -> None:
    """Delete the record of an ended flight; 409 if it is in progress or kept permanently."""
    await flights.delete(flight_id)


@router.post("/{flight_id}/transport", responses=problem_responses(409))
async def steer(flight_id: str, request: TransportRequest, flights: FlightsDep) -> TransportState:
    """Steer a flight: play, pause, seek, step, speed, loop, next_alert or lead."""
    flight = flights.flying(flight_id)
    flight.steer(request.action, request.value, request.screen)
    return flight.transport


@router.get("/{flight_id}/assessments")
async def read_assessments(
    flight_id: str, flights: FlightsDep, first: First = 0, last: Last = None
) -> FramesPart:
    """Samples and assessments as `frames` of the stream, up to now for a flight in progress.

    `next` is the number of the next frame to request, null at the end.
    """
    stop = last_frame(first, last)
    trims = await flights.records.trims(flight_id)
    frames = await flights.records.frames(flight_id, first, stop, trims)
    return await _frames_response(frames, first, stop, last, trims)


@router.get("/{flight_id}/source", responses=problem_responses(409))
async def read_source(
    flight_id: str, flights: FlightsDep, first: First = 0, last: Last = None
) -> FramesPart:
    """Samples of the source, flown or not: the strips before a point that the flight jumped to.

    As `assessments`, but `seq` is the number in the source. 409 for a live source.
    """
    flight, stop = flights.flying(flight_id), last_frame(first, last)
    frames = flight.source_frames(first, stop)
    return await _frames_response(frames, first, stop, last, flight.trims)


@router.get("/{flight_id}/comparison")
async def compare_monitors(flight_id: str, flights: FlightsDep) -> FlightComparison:
    """The monitors of a flight compared: alerts, lead, misses and where they differ.

    Of a flight in progress by the samples so far; of a replay that jumps, by its longest pass.
    """
    flight = flights.get(flight_id)
    alarms = await flights.records.alarms(flight_id)
    waiting = flight.recorder.waiting(0, flight.head) if flight else []
    return await asyncio.to_thread(compared, flights.store, flight_id, alarms, waiting)


@router.get("/{flight_id}/alarms")
async def list_alarms(flight_id: str, flights: FlightsDep) -> list[Alarm]:
    """All alarms of a flight, in the order raised."""
    return await flights.records.alarms(flight_id)


@router.post("/{flight_id}/alarms/{alarm_id}/acknowledge")
async def acknowledge(flight_id: str, alarm_id: str, flights: FlightsDep, by: SignedBy) -> Alarm:
    """Acknowledge an alarm. Of several acknowledgements the first one counts.

    The response is sent once the acknowledgement is stored; on 503 it is not, and the alarm stays
    unacknowledged.
    """
    return await flights.records.acknowledge(flight_id, alarm_id, by)


@router.get("/{flight_id}/markers")
async def list_flight_markers(flight_id: str, flights: FlightsDep) -> list[FlightMarker]:
    """All markers of a flight, in the order set."""
    return await flights.records.markers(flight_id)


@router.post("/{flight_id}/markers", status_code=201, responses=problem_responses(409))
async def set_flight_marker(
    flight_id: str, marker: MarkerRequest, flights: FlightsDep, person: PersonDep
) -> FlightMarker:
    """Set ABORT or KNOCK IT OFF at the newest sample of a flight in progress, or note an event.

    All watchers see it at once. The response waits half a second for the store; with `stored`
    false, or on 503, it is shown but not stored yet. The flight neither ends nor pauses. 404 for an
    ended flight.
    """
    by = signature(person, marker.by)
    return await flights.mark(flight_id, marker.kind, by, marker.text, marker.t)


async def _frames_response(
    frames: list[dict[str, Any]],
    first: int,
    stop: int,
    last: int | None,
    trims: list[TrimChange] | None,
) -> Any:
    more = bool(frames) and frames[-1]["seq"] == stop and stop != last
    content = {"first": first, "next": stop + 1 if more else None, "frames": frames}
    content["trims"] = None if trims is None else [*map(asdict, trims)]
    return await asyncio.to_thread(json_response, content)


async def _statuses(
    flights: Flights, stored: list[FlightInfo], *, anew: bool = False
) -> list[FlightStatus]:
    """anew: from their samples, not from stored summaries."""
    over = await asyncio.to_thread(records, flights.store, stored, anew=anew)
    monitors = await asyncio.to_thread(flown_monitors, flights.store, stored)
    sets = await asyncio.to_thread(stored_sets, flights.store, stored)
    return [
        _status(info, flights.get(info.id), over.get(info.id), monitors[info.id], sets.get(info.id))
        for info in stored
    ]


NOW = (
    "head",
    "monitors",
    "theta",
    "fail_t",
    "state",
    "reason",
    "cause",
    "age",
    "call",
)
"""Fields that a flight in progress has by the same names."""


def _status(
    info: FlightInfo,
    flight: Flight | None,
    record: Record | None,
    monitors: list[FlownMonitor],
    monitor_set: MonitorSetStatus | None,
) -> FlightStatus:
    """A flight's status; stale if it is neither in progress nor over yet."""
    known: dict[str, Any] = vars(info) | {
        "name": flight_name(info),
        "progress": info.status,
        "exceedances": flight.exceedances.of_channels if flight else [],
        "verdict": flight.verdict if flight else None,
        "source": source_of(info),
        "mode": mode_of(info.source),
        "monitor": None if monitor_set else info.monitor_id,
        "monitors": monitors,
        "monitor_set": monitor_set,
        "warnings": _warnings(monitors[0], monitor_set),
        "accept_useless": accepts_useless(info),
        "head": -1 if info.head is None else info.head,
    }
    if record is not None:
        known |= record._asdict()
    if flight is not None:
        known |= {name: getattr(flight, name) for name in NOW} | {
            "monitor": flight.monitor_id,
            "monitor_set": flight.in_force.monitor_set,
            "limits": flight.in_force.status,
            "limits_held": list(flight.in_force.of_record),
            "transport": flight.transport,
            "watchers": flight.n_watchers,
            "open_alarms": flight.alarms.n_open(Level.WARNING),
            "open_cautions": flight.alarms.n_open(Level.CAUTION),
            "progress": "ending" if flight.is_over else info.status,
            "lost": flight.recorder.lost,
            "unwritten": flight.recorder.unwritten,
        }
    seen = flight or record
    now = seen.headline if seen else headline(Facts(stale=True))
    known["end_reason"] = info.end_reason or ""
    return FlightStatus(**known | now._asdict())


def _warnings(authority: FlownMonitor, monitor_set: MonitorSetStatus | None) -> list[str]:
    """Warnings of the alarm authority; for a monitor set, of each of its monitors."""
    if monitor_set is None:
        return authority.warnings
    warnings = [text for each in monitor_set.conditions for text in each.warnings]
    return list(dict.fromkeys(warnings))
