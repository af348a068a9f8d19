"""Build-up campaigns: points are cleared, flown and identified one by one."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any

from fastapi import APIRouter, Depends
from fastapi.responses import HTMLResponse
from pydantic import ConfigDict, Field

from app.access.people import Person
from app.assessment.segments import Interval
from app.campaigns.campaign import Campaign, from_file
from app.campaigns.clearing import check_computable, history, identification_plain
from app.campaigns.flying import aborted_flight, flown_point
from app.campaigns.point import CampaignError, FlownPoint
from app.campaigns.stored import CampaignDetails, Campaigns, CampaignSummary, check_next
from app.http.problems import Problem, problem_responses
from app.jobs.campaigns import (
    CampaignRequest,
    ConditionRequest,
    clear,
    next_monitor_request,
    train_next,
)
from app.recipes.recipes import limits_named, stored_names, to_plain
from app.recordings.recordings import Recordings
from app.report.campaign import build_up_plot, campaign_page, derivatives_plot, plan_in_words
from app.report.strip_chart import styled
from app.routes.dependencies import (
    PAGE_TO_PRINT,
    By,
    Described,
    Finite,
    JobsDep,
    PersonDep,
    PlainBody,
    RecordingsDep,
    SettingsDep,
    StoreDep,
    body_of,
    json_response,
    refused,
    signature,
)
from app.routes.jobs import accepted, queued
from app.store.jobs import ENDED
from app.store.people import LOCAL
from core.bounds import quoted

router = APIRouter(prefix="/api/v1/campaigns", tags=["campaigns"])


class Decision(Described):
    """A decision on the next point."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"point": "60%", "by": "Ann"}]}
    )

    point: str = Field(description="name of the next point, as displayed; any other is refused")
    by: By = LOCAL
    why: str = Field(default="", max_length=2000, description="reason")


class ClearanceDecision(Decision):
    """A clearance to compute."""

    with_monitor: bool = False
    """whether the point's monitor, trained afterwards, is a part of the clearance: at most epsilon
    of the points that would exceed are flown without an alert in time"""


class _Recorded(Decision):
    """A decision on the next point, with its interval of a recording."""

    start: Finite | None = None
    """start of the manoeuvre with its trim [s] in the recording; if absent, the only detected
    manoeuvre is used, or the whole recording for an aborted point"""
    end: Finite | None = Field(default=None, description="end of the manoeuvre [s]")

    @property
    def marked(self) -> Interval | None:
        """The given interval; Problem 422 if only one end is given."""
        if (self.start is None) != (self.end is None):
            raise Problem(422, "only one of start and end was given: give both or neither")
        if self.start is None or self.end is None:
            return None
        return Interval(self.start, self.end, self.point)


class FlownRequest(_Recorded):
    """The recording of the next point."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"point": "60%", "recording": "3f9a1c20b7de", "by": "Bob"}]}
    )

    recording: str = Field(description="id")


class AbortRequest(_Recorded):
    """The reason to abort the next point, and its recording if it was broken off in flight."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"point": "60%", "by": "Bob", "why": "flutter at 0.4 g"}]}
    )

    recording: str | None = None
    """id, if the point was broken off in flight"""


async def _campaigns(store: StoreDep) -> Campaigns:
    return Campaigns(store)


CampaignsDep = Annotated[Campaigns, Depends(_campaigns)]
_FILE: dict[str, Any] = {"type": "object", "title": "Campaign's file"}


@router.get("")
def list_campaigns(campaigns: CampaignsDep) -> list[CampaignSummary]:
    """All campaigns, latest change first."""
    return campaigns.all()


@router.post("", status_code=201)
def plan_campaign(
    request: CampaignRequest, campaigns: CampaignsDep, settings: SettingsDep
) -> CampaignDetails:
    """Plan a campaign: a build-up at one or more flight conditions.

    Parts missing from a condition's `dataset` come from the aircraft's usual test.
    """
    with refused(422, "recipe", CampaignError):
        campaign = request.read(settings.max_array_bytes)
    return _made(campaigns.add(campaign))


@router.post(
    "/file",
    status_code=201,
    openapi_extra=body_of(_FILE, {"format": "forewarn campaign", "version": 2}),
)
def add_campaign_file(plain: PlainBody, campaigns: CampaignsDep) -> CampaignDetails:
    """Store a campaign file from `forewarn campaign` or `GET /campaigns/{id}/file`.

    The names of people in it are marked as unverified.
    """
    with refused(422, "campaign", CampaignError):
        campaign = from_file(plain, "the file")
        return _made(campaigns.add(campaign.imported))


def _made(details: CampaignDetails) -> Any:
    return json_response(
        limits_named(to_plain(details)), 201, {"Location": f"/api/v1/campaigns/{details.id}"}
    )


@router.get("/{campaign_id}")
def read_campaign(campaign_id: str, campaigns: CampaignsDep) -> CampaignDetails:
    """One campaign, point by point."""
    _, campaign = campaigns.get(campaign_id)
    details = campaigns.details(campaign_id)
    drawn = [
        replace(
            sent,
            figure=styled(build_up_plot(campaign, sent.name)),
            plan=plan_in_words(campaign, condition),
        )
        for sent, condition in zip(details.conditions, campaign.conditions, strict=True)
    ]
    return replace(details, conditions=drawn)


@router.delete("/{campaign_id}", status_code=204)
def delete_campaign(campaign_id: str, store: StoreDep) -> None:
    """Delete a campaign. Its recordings and monitors are kept."""
    store.campaigns.delete(campaign_id)


@router.get("/{campaign_id}/file")
def read_campaign_file(campaign_id: str, campaigns: CampaignsDep) -> dict[str, Any]:
    """The whole campaign with its flown samples as one file, for another server."""
    _, campaign = campaigns.get(campaign_id)
    disposition = f'attachment; filename="campaign-{campaign_id}.json"'
    return json_response(campaign.as_plain(), 200, {"Content-Disposition": disposition})


@router.get("/{campaign_id}/derivatives")
def read_derivatives(campaign_id: str, campaigns: CampaignsDep) -> list[dict[str, Any]]:
    """Identified parameters of the aircraft at each flight condition after each completed point.

    Each parameter is [mean, standard deviation] before and after the point, with a flag whether the
    point determined it. `figure` shows them as SVG.
    """
    _, campaign = campaigns.get(campaign_id)
    histories = {each.name: history(campaign, each.name) for each in campaign.conditions}
    return json_response(
        [
            {
                "condition": condition,
                "after": [identification_plain(each) for each in after],
                "figure": styled(derivatives_plot(after)),
            }
            for condition, after in histories.items()
            if after
        ]
    )


@router.get("/{campaign_id}/report", response_class=HTMLResponse)
def read_campaign_report(campaign_id: str, campaigns: CampaignsDep) -> HTMLResponse:
    """A page to print: the card of the next point and the results so far."""
    _, campaign = campaigns.get(campaign_id)
    return HTMLResponse(campaign_page(campaign), headers=PAGE_TO_PRINT)


@router.post("/{campaign_id}/conditions", responses=problem_responses(409))
def add_condition(
    campaign_id: str, request: ConditionRequest, campaigns: CampaignsDep, settings: SettingsDep
) -> CampaignDetails:
    """Add points at another flight condition after the planned ones.

    A `dataset` without an aircraft needs only the differences from the last condition.
    """
    with refused(422, "campaign", CampaignError):
        stored, campaign = campaigns.get(campaign_id)
        if "aircraft" not in request.dataset:
            last = to_plain(campaign.conditions[-1].test)
            request.dataset = last | stored_names(request.dataset)
        extended = campaign.extended(*request.read(settings.max_array_bytes))
        return json_response(limits_named(to_plain(campaigns.put(stored, extended))))


_DECIDED = problem_responses(404, 409, 422)


@router.post("/{campaign_id}/confirm", responses=_DECIDED)
def confirm_point(
    campaign_id: str, decision: Decision, campaigns: CampaignsDep, person: PersonDep
) -> CampaignDetails:
    """Confirm the checklist: clears a point that is on condition, or a first point."""
    return _decided(campaigns, campaign_id, decision, person, Campaign.confirmed)


@router.post("/{campaign_id}/smaller-step", responses=_DECIDED)
def plan_smaller_step(
    campaign_id: str, decision: Decision, campaigns: CampaignsDep, person: PersonDep
) -> CampaignDetails:
    """Plan the proposed `smaller_step` before a next point that is not cleared."""
    return _decided(campaigns, campaign_id, decision, person, Campaign.with_smaller_step)


@router.post("/{campaign_id}/hold", responses=_DECIDED)
def hold_point(
    campaign_id: str, decision: Decision, campaigns: CampaignsDep, person: PersonDep
) -> CampaignDetails:
    """Put the next point on hold."""
    return _decided(campaigns, campaign_id, decision, person, Campaign.on_hold)


@router.post("/{campaign_id}/abort", responses=_DECIDED)
def abort_point(
    campaign_id: str,
    request: AbortRequest,
    campaigns: CampaignsDep,
    recordings: RecordingsDep,
    person: PersonDep,
) -> CampaignDetails:
    """Abort the next point, before or during the flight. Give the reason in `why`.

    Give the `recording` of a point that was broken off in flight: it is checked against the limits
    but not used for identification.
    """
    marked, recording, by = request.marked, request.recording, signature(person, request.by)
    if marked is not None and recording is None:
        raise Problem(422, "start and end need a recording: give its id, or omit them")

    def decide(campaign: Campaign) -> Campaign:
        flown = None
        if recording is not None:
            flown = _cut(aborted_flight, recordings, recording, campaign, marked)
        return campaign.aborted(by, request.why, flown)

    return campaigns.change(campaign_id, request.point, decide)


@router.post("/{campaign_id}/flown", responses=_DECIDED)
def complete_point(
    campaign_id: str,
    request: FlownRequest,
    campaigns: CampaignsDep,
    recordings: RecordingsDep,
    person: PersonDep,
) -> CampaignDetails:
    """Complete the next point with its manoeuvre from a stored recording."""
    marked, by = request.marked, signature(person, request.by)

    def decide(campaign: Campaign) -> Campaign:
        flown = _cut(flown_point, recordings, request.recording, campaign, marked)
        return campaign.completed(flown, by)

    return campaigns.change(campaign_id, request.point, decide)


def _cut(
    cut: Callable[..., FlownPoint],
    recordings: Recordings,
    recording_id: str,
    campaign: Campaign,
    marked: Interval | None,
) -> FlownPoint:
    """The next point's interval of a stored recording."""
    name = recordings.store.recordings.info(recording_id).name
    recorded = recordings.mapped(recording_id).scorable()
    return cut(name, recorded, campaign.test_of(campaign.next.point), marked, recording_id)


def _decided(
    campaigns: Campaigns,
    campaign_id: str,
    decision: Decision,
    person: Person,
    state: Callable[[Campaign, str, str], Campaign],
) -> CampaignDetails:
    by = signature(person, decision.by)

    def decide(campaign: Campaign) -> Campaign:
        return state(campaign, by, decision.why)

    return campaigns.change(campaign_id, decision.point, decide)


@router.post("/{campaign_id}/clearance", **queued(409))
async def clear_point(
    campaign_id: str,
    decision: ClearanceDecision,
    campaigns: CampaignsDep,
    jobs: JobsDep,
    person: PersonDep,
):
    """Compute the clearance of the next point from the points flown so far; starts a job.

    The point is then on hold, or on condition until a person confirms the checklist. With its
    monitor, `monitor_epsilon` of the clearing is the epsilon at which `POST .../monitor` trains it.
    """
    by = signature(person, decision.by)
    await asyncio.to_thread(_check_clearing, campaigns, campaign_id, decision.point)
    request = {"campaign": campaign_id, "point": decision.point, "by": by}
    about = campaigns, campaign_id, decision.point, by, decision.with_monitor
    return await accepted(jobs, "clearance", request, clear, *about)


@router.post(
    "/{campaign_id}/monitor",
    **queued(409),
    openapi_extra=body_of(
        {
            "type": "object",
            "title": "Monitor for the next point",
            "required": ["point"],
            "properties": {
                "point": {"type": "string", "description": "name of the next point"},
            },
            "description": "also takes the fields of `POST /monitors` except `dataset`",
        },
        {"point": "80%", "t_early": 0.25},
    ),
)
async def train_next_monitor(
    campaign_id: str,
    plain: PlainBody,
    campaigns: CampaignsDep,
    jobs: JobsDep,
    settings: SettingsDep,
):
    """Train a monitor for the next point; starts a job.

    It is trained on simulated flights of the aircraft as identified from the completed points. Its
    certificate names these points.
    """
    recipe = dict(plain)
    if not isinstance(point := recipe.pop("point", None), str):
        raise Problem(422, f"point is {quoted(point)}: give the name of the next point")
    if "dataset" in recipe:
        raise Problem(422, "dataset is determined by the campaign: omit it")
    _, campaign = await asyncio.to_thread(campaigns.get, campaign_id)
    about = campaign, point, recipe, campaigns.store, settings.max_array_bytes
    training = await asyncio.to_thread(next_monitor_request, *about)
    details = {"name": training.name, "campaign": campaign_id, "point": point}
    details |= {"n_test": training.n_test} | to_plain(training.recipe)
    about = campaigns, campaign_id, point, training
    return await accepted(jobs, "monitor", details, train_next, *about)


def _check_clearing(campaigns: Campaigns, campaign_id: str, point: str) -> None:
    """CampaignError or Problem 409 if the clearance of this point cannot be computed now."""
    _, campaign = campaigns.get(campaign_id)
    check_next(campaign, point)
    check_computable(campaign)
    for job in campaigns.store.jobs.all():
        about = job.kind, job.request.get("campaign")
        if job.status not in ENDED and about == ("clearance", campaign_id):
            text = f"the clearance of {point!r} is being computed: wait for it or cancel it"
            raise Problem(409, text, "urn:forewarn:campaign")
