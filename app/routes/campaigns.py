"""Build-up campaigns: points are cleared, flown and identified one by one."""

import asyncio
from collections.abc import Callable
from typing import Annotated, Any

from fastapi import Depends, Response
from fastapi.responses import HTMLResponse
from pydantic import BaseModel, ConfigDict, Field

from app.campaigns.campaign import Campaign, CampaignError, FlownPoint
from app.campaigns.clearing import check_computable
from app.campaigns.derivatives import derivatives
from app.campaigns.file import from_file
from app.campaigns.flying import aborted_flight, flown_point
from app.campaigns.stored import CampaignDetails, Campaigns, CampaignSummary, check_next
from app.catalog import campaign_request_schema, condition_request_schema
from app.http.head_requests import Router
from app.http.people import Person
from app.http.problems import Problem, problem_responses
from app.jobs.campaigns import (
    campaign_request,
    clearance_work,
    condition_request,
    next_monitor_request,
    next_monitor_work,
)
from app.recipes import limits_named, stored_names, to_plain
from app.recordings.recordings import Recordings
from app.report.campaign import campaign_page
from app.routes.dependencies import (
    PAGE_TO_PRINT,
    JobsDep,
    PersonDep,
    PlainBody,
    RecordingsDep,
    SettingsDep,
    StoreDep,
    body_of,
    json_from,
    json_response,
    signature,
)
from app.routes.job_answers import ACCEPTED, accepted
from app.scoring.recipe import Interval
from app.store.campaigns import CampaignChanged
from app.store.jobs import ENDED, JobInfo
from app.store.tokens import LOCAL
from core.quoted import quoted

router = Router(prefix="/api/v1/campaigns", tags=["campaigns"])
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Decision(BaseModel):
    """A decision on the next point."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"point": "60%", "by": "Ann"}]}
    )

    point: str = Field(description="name of the next point, as displayed; any other is refused")
    by: str = Field(
        default=LOCAL,
        min_length=1,
        max_length=200,
        description="ignored where a person is logged in",
    )
    why: str = Field(default="", max_length=2000, description="reason")


class _Recorded(Decision):
    """A decision on the next point, with its part of a recording."""

    start: Finite | None = Field(
        default=None,
        description="of the manoeuvre with its trim [s], in the recording; if absent the only one "
        "that is detected, of an aborted point the whole recording",
    )
    end: Finite | None = Field(default=None, description="of the manoeuvre [s]")

    @property
    def marked(self) -> Interval | None:
        """The part; Problem 422 for half of it."""
        if (self.start is None) != (self.end is None):
            raise Problem(422, "one of start and end was given: give both, or none")
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

    recording: str | None = Field(default=None, description="id, of one that was broken off")


def _campaigns(store: StoreDep) -> Campaigns:
    return Campaigns(store)


CampaignsDep = Annotated[Campaigns, Depends(_campaigns)]
_TEST = {"aircraft": {"kind": "attas_id_16kft"}}
_PLAN = {"name": "Rudder build-up", "conditions": [{"dataset": _TEST, "steps": [0.4, 0.7, 1.0]}]}
_FILE: dict[str, Any] = {"type": "object", "title": "Campaign's file"}


@router.get("")
async def list_campaigns(campaigns: CampaignsDep) -> list[CampaignSummary]:
    """All campaigns, the one changed last first."""
    return await asyncio.to_thread(campaigns.all)


@router.post(
    "",
    status_code=201,
    response_model=CampaignDetails,
    responses=problem_responses(413, 415, 422),
    openapi_extra=body_of(campaign_request_schema(), _PLAN),
)
async def plan_campaign(plain: PlainBody, campaigns: CampaignsDep, settings: SettingsDep):
    """Plan a campaign: a build-up at one flight condition or several.

    The aircraft's usual test where a condition's `dataset` does not say otherwise.
    """

    def plan() -> CampaignDetails:
        return campaigns.add(campaign_request(plain, settings.max_array_bytes))

    return _made(await asyncio.to_thread(plan))


@router.post(
    "/file",
    status_code=201,
    response_model=CampaignDetails,
    responses=problem_responses(413, 415, 422),
    openapi_extra=body_of(_FILE, {"format": "forewarn campaign", "version": 2}),
)
async def add_campaign_file(plain: PlainBody, campaigns: CampaignsDep):
    """Store a campaign's file, as `forewarn campaign` or `GET /campaigns/{id}/file` gives it.

    Its names are marked as unverified.
    """

    def add() -> CampaignDetails:
        try:
            return campaigns.add(from_file(plain, "what was sent").imported)
        except CampaignError as error:
            raise Problem(422, str(error), "urn:forewarn:campaign") from None

    return _made(await asyncio.to_thread(add))


def _made(details: CampaignDetails) -> Response:
    return json_response(
        limits_named(to_plain(details)), 201, {"Location": f"/api/v1/campaigns/{details.id}"}
    )


@router.get("/{campaign_id}", responses=problem_responses(404))
async def read_campaign(campaign_id: str, campaigns: CampaignsDep) -> CampaignDetails:
    """One campaign, point by point."""
    return await asyncio.to_thread(campaigns.details, campaign_id)


@router.delete("/{campaign_id}", status_code=204, responses=problem_responses(404))
async def delete_campaign(campaign_id: str, store: StoreDep) -> None:
    """Delete a campaign; its recordings and monitors stay."""
    await asyncio.to_thread(store.campaigns.delete, campaign_id)


@router.get(
    "/{campaign_id}/file",
    responses=problem_responses(404) | {200: {"content": {"application/json": {"schema": _FILE}}}},
)
async def read_campaign_file(campaign_id: str, campaigns: CampaignsDep) -> Response:
    """The whole campaign as one file, flown samples included, for another server."""
    _, campaign = await asyncio.to_thread(campaigns.get, campaign_id)
    named = f'attachment; filename="campaign-{campaign_id}.json"'
    return json_response(campaign.as_plain(), 200, {"Content-Disposition": named})


@router.get(
    "/{campaign_id}/derivatives",
    responses=problem_responses(404)
    | {
        200: {
            "content": {
                "application/json": {"schema": {"type": "array", "items": {"type": "object"}}}
            }
        }
    },
)
async def read_derivatives(campaign_id: str, campaigns: CampaignsDep) -> Response:
    """The aircraft at each flight condition, as known after each complete point.

    Each parameter as [mean, standard deviation] before and after, and whether it was determined.
    """
    _, campaign = await asyncio.to_thread(campaigns.get, campaign_id)
    return await json_from(derivatives, campaign)


@router.get("/{campaign_id}/report", response_class=HTMLResponse, responses=problem_responses(404))
async def read_campaign_report(campaign_id: str, campaigns: CampaignsDep) -> HTMLResponse:
    """The card of the next point and the results, as a page that prints."""
    _, campaign = await asyncio.to_thread(campaigns.get, campaign_id)
    return HTMLResponse(await asyncio.to_thread(campaign_page, campaign), headers=PAGE_TO_PRINT)


@router.post(
    "/{campaign_id}/conditions",
    response_model=CampaignDetails,
    responses=problem_responses(404, 409, 413, 415, 422),
    openapi_extra=body_of(condition_request_schema(), {"name": "Mach 0.6", "steps": [0.5, 1.0]}),
)
async def add_condition(
    campaign_id: str, plain: PlainBody, campaigns: CampaignsDep, settings: SettingsDep
):
    """Plan points at another flight condition, after the others.

    Where its `dataset` names no aircraft, it says what differs from the last condition's.
    """

    def add() -> Response:
        stored, campaign = campaigns.get(campaign_id)
        wanted, dataset = plain, plain.get("dataset", {})
        if isinstance(dataset, dict) and "aircraft" not in dataset:
            last = to_plain(campaign.conditions[-1].test)
            wanted = plain | {"dataset": last | stored_names(dataset)}
        try:
            extended = campaign.extended(*condition_request(wanted, settings.max_array_bytes))
            return json_response(limits_named(to_plain(campaigns.put(stored, extended))))
        except CampaignError as error:
            raise Problem(422, str(error), "urn:forewarn:campaign") from None
        except CampaignChanged as error:
            raise Problem(409, str(error), "urn:forewarn:campaign") from None

    return await asyncio.to_thread(add)


_DECIDED = problem_responses(404, 409, 422)


@router.post("/{campaign_id}/confirm", responses=_DECIDED)
async def confirm_point(
    campaign_id: str, decision: Decision, campaigns: CampaignsDep, person: PersonDep
) -> CampaignDetails:
    """Confirm the checklist of a point that is on condition, or a first one: it is cleared."""
    return await _decided(campaigns, campaign_id, decision, person, Campaign.confirmed)


@router.post("/{campaign_id}/hold", responses=_DECIDED)
async def hold_point(
    campaign_id: str, decision: Decision, campaigns: CampaignsDep, person: PersonDep
) -> CampaignDetails:
    """Hold the next point: do not fly it for now."""
    return await _decided(campaigns, campaign_id, decision, person, Campaign.on_hold)


@router.post("/{campaign_id}/abort", responses=_DECIDED)
async def abort_point(
    campaign_id: str,
    asked: AbortRequest,
    campaigns: CampaignsDep,
    recordings: RecordingsDep,
    person: PersonDep,
) -> CampaignDetails:
    """Abort the next point: it is given up, or was broken off. Give the reason in `why`.

    `recording` shows a point that was broken off: it counts against the limits, and nothing is
    identified from it.
    """
    marked, recording, by = asked.marked, asked.recording, signature(person, asked.by)
    if marked is not None and recording is None:
        raise Problem(422, "start and end are of a recording: give its id, or leave them out")

    def decide(campaign: Campaign) -> Campaign:
        flown = None
        if recording is not None:
            flown = _cut(aborted_flight, recordings, recording, campaign, marked)
        return campaign.aborted(by, asked.why, flown)

    return await _changed(campaigns, campaign_id, asked.point, decide)


@router.post("/{campaign_id}/flown", responses=_DECIDED)
async def complete_point(
    campaign_id: str,
    asked: FlownRequest,
    campaigns: CampaignsDep,
    recordings: RecordingsDep,
    person: PersonDep,
) -> CampaignDetails:
    """Complete the next point with its manoeuvre from a stored recording."""
    marked, by = asked.marked, signature(person, asked.by)

    def decide(campaign: Campaign) -> Campaign:
        flown = _cut(flown_point, recordings, asked.recording, campaign, marked)
        return campaign.completed(flown, by)

    return await _changed(campaigns, campaign_id, asked.point, decide)


def _cut(
    cut: Callable[..., FlownPoint],
    recordings: Recordings,
    recording_id: str,
    campaign: Campaign,
    marked: Interval | None,
) -> FlownPoint:
    """The next point, cut out of a stored recording."""
    name = recordings.store.recordings.info(recording_id).name
    recorded = recordings.mapped(recording_id).scorable()
    return cut(name, recorded, campaign.test_of(campaign.next.point), marked, recording_id)


async def _decided(
    campaigns: Campaigns,
    campaign_id: str,
    decision: Decision,
    person: Person,
    state: Callable[[Campaign, str, str], Campaign],
) -> CampaignDetails:
    by = signature(person, decision.by)
    return await _changed(
        campaigns, campaign_id, decision.point, lambda one: state(one, by, decision.why)
    )


async def _changed(
    campaigns: Campaigns, campaign_id: str, point: str, decide: Callable[[Campaign], Campaign]
) -> CampaignDetails:
    try:
        return await asyncio.to_thread(campaigns.change, campaign_id, point, decide)
    except (CampaignError, CampaignChanged) as error:
        raise Problem(409, str(error), "urn:forewarn:campaign") from None


@router.post(
    "/{campaign_id}/clearance",
    status_code=202,
    response_model=JobInfo,
    responses=ACCEPTED | problem_responses(409),
)
async def clear_point(
    campaign_id: str,
    decision: Decision,
    campaigns: CampaignsDep,
    jobs: JobsDep,
    person: PersonDep,
):
    """Compute whether the next point may be flown, from the points flown before; a job.

    The point is then on condition, until a person confirms the checklist, or on hold.
    """
    by = signature(person, decision.by)
    await _check_next(campaigns, campaign_id, decision.point)
    if await asyncio.to_thread(_is_clearing, campaigns, campaign_id):
        text = f"the clearance of {decision.point!r} is being computed: wait for it, or cancel it"
        raise Problem(409, text, "urn:forewarn:campaign")
    work = clearance_work(campaigns, campaign_id, decision.point, by)
    request = {"campaign": campaign_id, "point": decision.point, "by": by}
    return await accepted(jobs, "clearance", request, work)


@router.post(
    "/{campaign_id}/monitor",
    status_code=202,
    response_model=JobInfo,
    responses=ACCEPTED | problem_responses(409),
    openapi_extra=body_of(
        {
            "type": "object",
            "title": "Monitor for the next point",
            "required": ["point"],
            "properties": {
                "point": {"type": "string", "description": "name of the next point"},
            },
            "description": "and what `POST /monitors` takes, but for `dataset`",
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
    """Train a monitor for the next point, answered by a job.

    On simulated flights of the aircraft as the complete points have shown it, which its certificate
    names.
    """
    asked = dict(plain)
    if not isinstance(point := asked.pop("point", None), str):
        raise Problem(422, f"point is {quoted(point)}: give the name of the next point")
    if "dataset" in asked:
        raise Problem(422, "dataset was given: the campaign determines it, leave it out")
    _, campaign = await asyncio.to_thread(campaigns.get, campaign_id)

    def request() -> Any:
        try:
            return next_monitor_request(
                campaign, point, asked, campaigns.store, settings.max_array_bytes
            )
        except CampaignError as error:
            raise Problem(409, str(error), "urn:forewarn:campaign") from None

    training = await asyncio.to_thread(request)
    details = {"name": training.name, "campaign": campaign_id, "point": point}
    details |= {"n_test": training.n_test} | to_plain(training.recipe)
    work = next_monitor_work(campaigns, campaign_id, point, training)
    return await accepted(jobs, "monitor", details, work)


def _is_clearing(campaigns: Campaigns, campaign_id: str) -> bool:
    return any(
        (job.kind, job.request.get("campaign")) == ("clearance", campaign_id)
        for job in campaigns.store.jobs.all()
        if job.status not in ENDED
    )


async def _check_next(campaigns: Campaigns, campaign_id: str, point: str) -> None:
    """Problem 409 where another point is next, or nothing can be computed of it."""

    def check() -> None:
        _, campaign = campaigns.get(campaign_id)
        check_next(campaign, point)
        check_computable(campaign)

    try:
        await asyncio.to_thread(check)
    except CampaignError as error:
        raise Problem(409, str(error), "urn:forewarn:campaign") from None
