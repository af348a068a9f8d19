"""Requests and long work of campaigns: clear the next point, train a monitor for it."""

from dataclasses import replace
from typing import Any

from app.campaigns.campaign import (
    LONGEST_CRITERIA,
    LONGEST_NAME,
    USUAL_STEPS,
    Campaign,
    CampaignError,
    Condition,
)
from app.campaigns.clearing import clear_next, updated
from app.campaigns.stored import Campaigns, check_next
from app.jobs.jobs import Task, Work
from app.jobs.kinds import monitor_work
from app.jobs.requests import MonitorRequest, dataset_request, monitor_request
from app.recipes.recipes import RecipeError, from_plain, to_plain
from app.store.store import Store
from core.bounds import quoted
from core.clearance.clearance import ClearanceRecipe
from core.planned_test.collection import CollectionError


def campaign_request(plain: dict[str, Any], max_bytes: int) -> Campaign:
    """Read the body of a request for a campaign. RecipeError."""
    plain = dict(plain)
    name, conditions = plain.pop("name", None), plain.pop("conditions", None)
    recipe = from_plain(ClearanceRecipe(), plain.pop("clearance", {}), "clearance")
    if plain:
        raise RecipeError(f"{next(iter(plain))!r} is unknown: give name, conditions, clearance")
    if not isinstance(name, str) or not 0 < len(name.strip()) <= LONGEST_NAME:
        raise RecipeError(f"name is {quoted(name)}: give 1 to {LONGEST_NAME} characters")
    if not (isinstance(conditions, list) and conditions and all(_is_object(c) for c in conditions)):
        raise RecipeError(f"conditions is {quoted(conditions)}: give a list of flight conditions")
    (condition, steps, passes_below, criteria), *others = [
        condition_request(each, max_bytes, f"conditions.{n}") for n, each in enumerate(conditions)
    ]
    try:
        campaign = Campaign.planned(name, condition, steps, recipe, passes_below, criteria)
        for other in others:
            campaign = campaign.extended(*other)
    except CampaignError as error:
        raise RecipeError(str(error)) from None
    return campaign


def condition_request(
    plain: dict[str, Any], max_bytes: int, where: str = "condition"
) -> tuple[Condition, list[float], float, str]:
    """Read a flight condition, its steps and their pass criteria. RecipeError."""
    plain = dict(plain)
    name = plain.pop("name", "")
    test = dataset_request(plain.pop("dataset", {}), max_bytes).recipe
    steps, passes_below = plain.pop("steps", list(USUAL_STEPS)), plain.pop("passes_below", 1.0)
    criteria = plain.pop("criteria", "")
    if plain:
        raise RecipeError(
            f"{where}.{next(iter(plain))} is unknown: give name, dataset, steps, passes_below, "
            "criteria"
        )
    if not isinstance(name, str) or len(name) > LONGEST_NAME:
        raise RecipeError(f"{where}.name is {quoted(name)}: give up to {LONGEST_NAME} characters")
    if not isinstance(steps, list) or not all(_is_number(step) for step in steps):
        raise RecipeError(f"{where}.steps is {quoted(steps)}: give shares of the planned amplitude")
    if not _is_number(passes_below):
        raise RecipeError(
            f"{where}.passes_below is {quoted(passes_below)}: give a share of the limit"
        )
    if not isinstance(criteria, str) or len(criteria) > LONGEST_CRITERIA:
        raise RecipeError(
            f"{where}.criteria is {quoted(criteria)}: give up to {LONGEST_CRITERIA} characters"
        )
    return Condition(name.strip(), test), steps, float(passes_below), criteria


def _is_object(value: Any) -> bool:
    return isinstance(value, dict)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def clearance_work(campaigns: Campaigns, campaign_id: str, point: str, by: str) -> Work:
    """Compute and store whether the next point may be flown; the result has its state."""

    def work(task: Task) -> dict[str, Any]:
        stored, campaign = campaigns.get(campaign_id)
        check_next(campaign, point)

        def identified(done: int, total: int) -> None:
            task.progress(f"{done} of {total} aircraft identified", done, total)

        cleared = clear_next(campaign, by, identified)
        task.progress("storing", task.done, task.total)
        campaigns.put(stored, cleared)
        return {"campaign": campaign_id, "point": point, "state": cleared.next.point.state}

    return work


def next_monitor_request(
    campaign: Campaign, point: str, plain: dict[str, Any], store: Store, max_bytes: int
) -> MonitorRequest:
    """A monitor for the next point, for the aircraft identified from the complete points.

    plain: the monitor's request without its dataset.   CampaignError, RecipeError.
    """
    check_next(campaign, point)
    following = campaign.next.point
    is_first = not campaign.flown(following.condition)
    planned = campaign.test_of(following) if is_first else updated(campaign, following)
    request = {"name": f"{campaign.name}, {following.name}"} | plain
    return monitor_request(request | {"dataset": to_plain(planned)}, store, max_bytes)


def next_monitor_work(
    campaigns: Campaigns, campaign_id: str, point: str, request: MonitorRequest
) -> Work:
    """Train that monitor and store its id with the point; the result has both."""
    train = monitor_work(request, campaigns.store)

    def work(task: Task) -> dict[str, Any]:
        try:
            result = train(task)
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

    return work
