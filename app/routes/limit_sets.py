"""Limit sets, their versions, and the version in force in a flight."""

import asyncio
from typing import Annotated, Self

from fastapi import APIRouter, Path
from pydantic import BaseModel, Field, JsonValue, model_validator

from app.assessment.rulings import check_plausible
from app.flights.flight_limits import to_store
from app.http.problems import problem_responses
from app.json_codec import Whole
from app.messages import LimitsFrom, LimitsStatus
from app.routes.dependencies import (
    By,
    ConditionRanges,
    Finite,
    FlightsDep,
    PersonDep,
    StoreDep,
    refused,
    signature,
    strictly,
)
from app.store.condition_sets import LimitSetInfo, StoredLimits
from app.store.people import LOCAL
from core.conditions import ConditionKey, check_declared
from core.flight_events import FlightLimits
from core.limits.limit_sets import LimitSet, limit_set_from_plain

router = APIRouter(prefix="/api/v1", tags=["limit sets"])
MOST_CASES = 100
CASES: list[JsonValue] = [
    {"name": "below M 0.8", "ranges": {"mach": [None, 0.8]}, "limits": {"Ny": 0.5}},
    {"name": "from M 0.8 on", "ranges": {"mach": [0.8, None]}, "limits": {"Ny": 0.4}},
]
Version = Annotated[int, Path(ge=1, le=2**31)]


class ConditionLimits(ConditionRanges):
    """A flight condition and the limits that hold there."""

    limits: dict[str, Finite | None] = Field(
        description="smallest unsafe magnitude by channel, in SI units, Ny in g"
    )


class LimitsText(BaseModel):
    """A version of a limit set. Its conditions must not overlap."""

    model_config = strictly({"cases": CASES})

    cases: list[ConditionLimits] = Field(min_length=1, max_length=MOST_CASES)
    text: str | None = Field(default=None, min_length=1, max_length=2000, description="reason")
    by: By = LOCAL

    @property
    def limits(self) -> LimitSet:
        """The limits; Problem 422 if they contradict each other."""
        with refused(422, "limit-set", ValueError):
            limits = limit_set_from_plain([case.model_dump() for case in self.cases])
            check_plausible(limits)
            return limits


class NewLimitSet(LimitsText):
    """A limit set with its first version."""

    model_config = strictly({"name": "envelope", "cases": CASES})

    name: str = Field(min_length=1, max_length=200)


class LimitsRequest(BaseModel):
    """A version of a limit set to put in force in a flight."""

    model_config = strictly({"limit_set": "0123456789ab", "fixed": {"mach": 0.6}})

    limit_set: str = Field(description="id")
    version: Whole | None = Field(default=None, ge=1, description="newest version if absent")
    fixed: dict[ConditionKey, Finite] = Field(
        default_factory=dict,
        description="declared flight conditions in SI units; earlier declarations stay in force",
    )
    by: By = LOCAL

    @model_validator(mode="after")
    def check(self) -> Self:
        check_declared(self.fixed)
        return self


@router.get("/limit-sets")
def list_limit_sets(store: StoreDep) -> list[LimitSetInfo]:
    """All limit sets, newest first."""
    return store.limit_sets.all()


@router.post("/limit-sets", status_code=201)
def add_limit_set(new: NewLimitSet, store: StoreDep, person: PersonDep) -> StoredLimits:
    """Store a limit set with its first version."""
    about = new.limits, signature(person, new.by), new.text
    return store.limit_sets.add(new.name, *about)


@router.get("/limit-sets/{set_id}")
def read_limit_set(set_id: str, store: StoreDep) -> list[StoredLimits]:
    """All versions of a limit set, newest first."""
    return store.limit_sets.versions(set_id)


@router.post("/limit-sets/{set_id}/versions", status_code=201)
def add_version(set_id: str, new: LimitsText, store: StoreDep, person: PersonDep) -> StoredLimits:
    """Store the next version of a limit set. Earlier versions do not change."""
    about = new.limits, signature(person, new.by), new.text
    return store.limit_sets.add_version(set_id, *about)


@router.get("/limit-sets/{set_id}/versions/{version}")
def read_version(set_id: str, version: Version, store: StoreDep) -> StoredLimits:
    """One version of a limit set."""
    return store.limit_sets.version(set_id, version)


@router.get("/flights/{flight_id}/limits")
async def list_flight_limits(
    flight_id: str, flights: FlightsDep
) -> list[FlightLimits] | list[LimitsFrom]:
    """Limits in force during a flight, in order; empty for its monitor's own.

    All versions of limit sets put in force; of a flight on a monitor set the limits of its monitors
    in turn, one entry of unknown ones if the flight was cut short.
    """
    info = await asyncio.to_thread(flights.store.flights.info, flight_id)
    if await asyncio.to_thread(flights.store.monitor_sets.of_flights, [flight_id]):
        flown = flights.get(flight_id)
        unknown = [LimitsFrom(t=None, limits=None)]
        held = unknown if info.limits_held is None else info.limits_held
        if flown is not None:
            return list(flown.in_force.of_record)
        return [LimitsFrom.model_validate(each) for each in held]
    stored = await asyncio.to_thread(flights.store.limit_sets.of_flights, [flight_id])
    in_store = {change.number: change for change in stored.get(flight_id, [])}
    flight = flights.get(flight_id)
    in_flight = [to_store(change) for change in flight.limits_at_hand] if flight else []
    return list((in_store | {change.number: change for change in in_flight}).values())


@router.put("/flights/{flight_id}/limits", responses=problem_responses(409))
async def put_in_force(
    flight_id: str, request: LimitsRequest, flights: FlightsDep, person: PersonDep
) -> LimitsStatus:
    """Put a limit set in force in a flight in progress, from its next sample on.

    All watchers see the change. From then on, monitors with other limits are not applicable. 503:
    the limits are in force but not stored yet; 409: this flight cannot take other limits.
    """
    by = signature(person, request.by)
    about = request.limit_set, request.version, request.fixed, by
    await flights.put_in_force(flight_id, *about)
    limits = flights.flying(flight_id).in_force.status
    assert limits is not None
    return limits
