"""Limit sets with their versions, limits in force in a flight, and monitor sets."""

import asyncio
from typing import Self

from fastapi import APIRouter
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
from app.store.condition_sets import LimitSetInfo, MonitorSetInfo, StoredLimits
from app.store.people import LOCAL
from core.conditions import ConditionKey, check_declared
from core.flight_events import FlightLimits
from core.limits.limit_sets import LimitSet, limit_set_from_plain
from core.monitor.monitor_set import MonitorCase, MonitorSet

router = APIRouter(prefix="/api/v1")
MOST_CASES, MOST_MONITORS = 100, 50
CASES: list[JsonValue] = [
    {"name": "below M 0.8", "ranges": {"mach": [None, 0.8]}, "limits": {"Ny": 0.5}},
    {"name": "from M 0.8 on", "ranges": {"mach": [0.8, None]}, "limits": {"Ny": 0.4}},
]


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


@router.get("/limit-sets", tags=["limit sets"])
def list_limit_sets(store: StoreDep) -> list[LimitSetInfo]:
    """All limit sets, newest first."""
    return store.limit_sets.all()


@router.post("/limit-sets", tags=["limit sets"], status_code=201)
def add_limit_set(new: NewLimitSet, store: StoreDep, person: PersonDep) -> StoredLimits:
    """Store a limit set with its first version."""
    about = new.limits, signature(person, new.by), new.text
    return store.limit_sets.add(new.name, *about)


@router.get("/limit-sets/{set_id}", tags=["limit sets"])
def read_limit_set(set_id: str, store: StoreDep) -> list[StoredLimits]:
    """All versions of a limit set, newest first."""
    return store.limit_sets.versions(set_id)


@router.post("/limit-sets/{set_id}/versions", tags=["limit sets"], status_code=201)
def add_version(set_id: str, new: LimitsText, store: StoreDep, person: PersonDep) -> StoredLimits:
    """Store the next version of a limit set. Earlier versions do not change."""
    about = new.limits, signature(person, new.by), new.text
    return store.limit_sets.add_version(set_id, *about)


@router.get("/flights/{flight_id}/limits", tags=["limit sets"])
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


@router.put("/flights/{flight_id}/limits", tags=["limit sets"], responses=problem_responses(409))
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


MONITOR_CASES: list[JsonValue] = [
    {"name": "below M 0.8", "ranges": {"mach": [None, 0.8]}, "monitor": "0123456789ab"},
    {"name": "from M 0.8 on", "ranges": {"mach": [0.8, None]}, "monitor": "ba9876543210"},
]


class ConditionMonitor(ConditionRanges):
    """A flight condition and the monitor that is used there, at its own epsilon."""

    monitor: str = Field(description="id")


class NewMonitorSet(BaseModel):
    """A monitor set. Its conditions may overlap at their ends.

    Its monitors have the same channels, sample interval and lead time.
    """

    model_config = strictly({"name": "rudder doublet", "cases": MONITOR_CASES})

    name: str = Field(min_length=1, max_length=200)
    cases: list[ConditionMonitor] = Field(min_length=1, max_length=MOST_MONITORS)
    text: str | None = Field(default=None, min_length=1, max_length=2000, description="reason")
    by: By = LOCAL


@router.get("/monitor-sets", tags=["monitor sets"])
def list_monitor_sets(store: StoreDep) -> list[MonitorSetInfo]:
    """All monitor sets, newest first."""
    return store.monitor_sets.all()


@router.post("/monitor-sets", tags=["monitor sets"], status_code=201)
def add_monitor_set(new: NewMonitorSet, store: StoreDep, person: PersonDep) -> MonitorSetInfo:
    """Store a monitor set, which never changes."""
    monitors = [store.monitors.info(case.monitor) for case in new.cases]
    with refused(422, "monitor-set", ValueError):
        cases = tuple(
            MonitorCase(
                case.name, {key: (low, high) for key, (low, high) in case.ranges.items()}, m
            )
            for case, m in zip(new.cases, monitors, strict=True)
        )
        monitor_set = MonitorSet(cases)
        monitor_set.check()
        return store.monitor_sets.add(new.name, monitor_set, signature(person, new.by), new.text)


@router.get("/monitor-sets/{set_id}", tags=["monitor sets"])
def read_monitor_set(set_id: str, store: StoreDep) -> MonitorSetInfo:
    """One monitor set."""
    return store.monitor_sets.info(set_id)


@router.delete(
    "/monitor-sets/{set_id}",
    tags=["monitor sets"],
    status_code=204,
    responses=problem_responses(409),
)
def delete_monitor_set(set_id: str, store: StoreDep) -> None:
    """Delete a monitor set; 409 if a flight uses it. Its monitors stay."""
    store.monitor_sets.delete(set_id)
