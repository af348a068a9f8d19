"""Requests and long work of campaigns: clear the next point, train a monitor for it."""

from dataclasses import replace
from itertools import chain
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from app.campaigns.campaign import (
    LONGEST_CRITERIA,
    LONGEST_NAME,
    USUAL_STEPS,
    Campaign,
    points_at,
)
from app.campaigns.clearing import clear_next, updated
from app.campaigns.point import CampaignError, Condition
from app.campaigns.stored import Campaigns, check_next
from app.jobs.jobs import Result, Task
from app.jobs.kinds import train_monitor
from app.jobs.requests import MonitorRequest, dataset_request, monitor_request
from app.recipes.recipes import RecipeError, from_plain, to_plain
from app.store.store import Store
from core.clearance.clearance import ClearanceRecipe
from core.planned_test.collection import CollectionError

_TEST: JsonValue = {"aircraft": {"kind": "attas_id_16kft"}}
PLAN: JsonValue = {
    "name": "Rudder build-up",
    "conditions": [{"dataset": _TEST, "steps": [0.4, 0.7, 1.0]}],
}


class ConditionRequest(BaseModel):
    """A flight condition of a campaign."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        json_schema_extra={"examples": [{"name": "Mach 0.6", "steps": [0.5, 1.0]}]},
    )

    name: str = Field(default="", max_length=LONGEST_NAME, description="name of the condition")
    dataset: dict[str, Any] = Field(default={}, description="recipe of its last point")
    steps: list[float] = Field(
        default=[*USUAL_STEPS], description="shares of the planned amplitude, increasing"
    )
    passes_below: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="share of the limit that every point must stay below",
    )
    criteria: str = Field(
        default="",
        max_length=LONGEST_CRITERIA,
        description="other pass criteria of every point, judged by a person",
    )

    def read(self, max_bytes: int) -> tuple[Condition, list[float], float, str]:
        """The flight condition, its steps and their pass criteria. RecipeError."""
        _, test = dataset_request(self.dataset, max_bytes)
        try:
            condition = Condition(self.name.strip(), test)
        except ValueError as error:
            raise RecipeError(f"{error}") from None
        return condition, self.steps, self.passes_below, self.criteria


class CampaignRequest(BaseModel):
    """A campaign to plan."""

    model_config = ConfigDict(extra="forbid", strict=True, json_schema_extra={"examples": [PLAN]})

    name: str = Field(min_length=1, max_length=LONGEST_NAME)
    conditions: list[ConditionRequest] = Field(min_length=1)
    clearance: dict[str, Any] = Field(default={}, description="how clearances are calibrated")

    def read(self, max_bytes: int) -> Campaign:
        """The campaign. RecipeError, CampaignError."""
        recipe = from_plain(ClearanceRecipe(), self.clearance, "clearance")
        planned = [each.read(max_bytes) for each in self.conditions]
        points = chain.from_iterable(points_at(*each) for each in planned)
        return Campaign(self.name, tuple(each[0] for each in planned), tuple(points), recipe)


def clear(
    task: Task, campaigns: Campaigns, campaign_id: str, point: str, by: str, monitored: bool
) -> Result:
    """Compute and store whether the next point may be flown; the result has its state."""
    stored, campaign = campaigns.get(campaign_id)
    check_next(campaign, point)

    def flown(done: int, total: int) -> None:
        task.progress(f"{done} of {total} simulated aircraft flown", done, total)

    cleared = clear_next(campaign, by, flown, task.executor, monitored=monitored)
    task.progress("storing", task.done, task.total)
    campaigns.put(stored, cleared)
    return {"campaign": campaign_id, "point": point, "state": cleared.next.point.state}


def next_monitor_request(
    campaign: Campaign, point: str, plain: dict[str, Any], store: Store, max_bytes: int
) -> MonitorRequest:
    """A monitor for the next point, for the aircraft identified from the complete points.

    It is calibrated for aircraft near the identified one only if the request asks for it. Where a
    monitor is a part of the clearance it is that one.
    plain: the monitor's request without its dataset.   CampaignError, RecipeError.
    """
    check_next(campaign, point)
    following = campaign.next.point
    planned = campaign.test_of(following) if campaign.is_first else updated(campaign, following)
    request = {"name": f"{campaign.name}, {following.name}"} | plain
    if following.clearing and (monitor := following.clearing.monitor):
        determined = to_plain(monitor)
        if given := sorted(determined.keys() & plain.keys()):
            raise CampaignError(
                f"{', '.join(given)} was given: the clearance of {point!r} determines the recipe "
                "of its monitor, omit it, or compute the clearance without a monitor"
            )
        request |= determined
    read = monitor_request(request | {"dataset": to_plain(planned)}, store, max_bytes)
    if campaign.is_first or "scope" in request.get("predictor", {}):
        return read
    return read._replace(recipe=read.recipe.as_planned())


def train_next(
    task: Task, campaigns: Campaigns, campaign_id: str, point: str, request: MonitorRequest
) -> Result:
    """Train that monitor and store its id with the point; the result has both."""
    try:
        result = train_monitor(task, request, campaigns.store)
    except CollectionError as error:
        raise CampaignError(
            f"no monitor can be calibrated for {point!r}: nearly none or nearly all flights of "
            f"the identified aircraft exceed a limit there: {error}"
        ) from None
    stored, campaign = campaigns.get(campaign_id)
    number = [each.name for each in campaign.points].index(point)
    trained = replace(campaign.points[number], monitor=result["monitor"])
    campaigns.put(stored, campaign.with_point(number, trained))
    return result | {"campaign": campaign_id, "point": point}
