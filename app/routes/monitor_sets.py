"""Monitor sets: monitors of one test by flight condition."""

from fastapi import APIRouter
from pydantic import BaseModel, Field, JsonValue

from app.http.problems import problem_responses
from app.routes.dependencies import (
    By,
    ConditionRanges,
    PersonDep,
    StoreDep,
    refused,
    signature,
    strictly,
)
from app.store.condition_sets import MonitorSetInfo
from app.store.people import LOCAL
from core.monitor.monitor_set import MonitorCase, MonitorSet

router = APIRouter(prefix="/api/v1/monitor-sets", tags=["monitor sets"])
MOST_CASES = 50
CASES: list[JsonValue] = [
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

    model_config = strictly({"name": "rudder doublet", "cases": CASES})

    name: str = Field(min_length=1, max_length=200)
    cases: list[ConditionMonitor] = Field(min_length=1, max_length=MOST_CASES)
    text: str | None = Field(default=None, min_length=1, max_length=2000, description="reason")
    by: By = LOCAL


@router.get("")
def list_monitor_sets(store: StoreDep) -> list[MonitorSetInfo]:
    """All monitor sets, newest first."""
    return store.monitor_sets.all()


@router.post("", status_code=201)
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


@router.get("/{set_id}")
def read_monitor_set(set_id: str, store: StoreDep) -> MonitorSetInfo:
    """One monitor set."""
    return store.monitor_sets.info(set_id)


@router.delete("/{set_id}", status_code=204, responses=problem_responses(409))
def delete_monitor_set(set_id: str, store: StoreDep) -> None:
    """Delete a monitor set; 409 if a flight uses it. Its monitors stay."""
    store.monitor_sets.delete(set_id)
