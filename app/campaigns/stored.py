"""Stored campaigns, and their details over REST."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from app.campaigns.campaign import Campaign, from_file
from app.campaigns.clearing import checklist
from app.campaigns.point import CampaignError, Clearing, Event, Point, State
from app.recipes.recipes import SentRecipe, to_plain
from app.store.campaigns import StoredCampaign
from app.store.repository import Entry, NotFound
from app.store.store import Store


@dataclass(frozen=True)
class CampaignSummary(Entry):
    """A campaign in a list."""

    id: str
    name: str
    created: str
    """UTC, ISO 8601"""
    changed: str
    """UTC, ISO 8601"""
    aircraft: list[str]
    n_points: int
    n_complete: int
    next: str | None
    """name of the next point; null where all are over"""
    state: State | None
    """of the next point"""


@dataclass(frozen=True)
class CampaignCondition(Entry):
    """A flight condition and the planned test there."""

    name: str
    aircraft: str
    test: SentRecipe
    """recipe of a dataset, of its last point"""
    figure: str = ""
    """predicted and flown peaks as SVG, with the campaign itself only"""
    plan: str = ""
    """aircraft, trim, manoeuvre and limits in words, with the campaign itself only"""


@dataclass(frozen=True)
class CampaignFlight(Entry):
    """A point as flown, and where it is stored."""

    source: str
    """recording, and the time in it"""
    reached: float
    """largest part of a limit"""
    exceeded: str
    """channel and time, or empty"""
    passed: bool
    """whether it is complete and stayed below its pass criterion"""
    recording: str | None
    """id, if it is still stored"""
    flight: str | None
    """id of its live flight, if that is still stored"""
    scorings: list[str]
    """ids, of the recording"""
    start: float | None
    """in the recording [s]"""
    end: float | None
    """in the recording [s]"""
    recording_deleted: bool
    """whether its recording was stored and has been deleted"""


@dataclass(frozen=True)
class CampaignClearing(Clearing):
    """The clearance computed for a point."""

    close: bool = False
    """whether the p-value is within two of its errors of the threshold"""
    exceeding_at_most: float | None = None
    """upper bound on the share of aircraft that exceed a limit, with 95 % confidence"""


@dataclass(frozen=True)
class CampaignPoint(Entry):
    """A point, its clearance and its flight."""

    name: str
    condition: str
    """name of its flight condition"""
    peak_deg: float
    """of the manoeuvre's command"""
    state: State
    passes_below: float
    """part of a limit to stay below"""
    criteria: str
    """further pass criteria"""
    events: list[Event]
    clearing: CampaignClearing | None
    """clearance computed before the flight; null where none was"""
    flown: CampaignFlight | None
    monitor: str | None
    """id of the monitor trained for it, if that is still stored"""


@dataclass(frozen=True)
class CampaignStep(Entry):
    """A proposed step."""

    name: str
    peak_deg: float
    """of the manoeuvre's command"""


@dataclass(frozen=True)
class CampaignDetails(CampaignSummary):
    """A campaign, point by point."""

    conditions: list[CampaignCondition]
    points: list[CampaignPoint]
    clearance: dict[str, Any]
    """how clearances are calibrated"""
    checklist: list[str]
    """what a person confirms before the next point is flown; empty for a first point"""
    is_first: bool
    """whether the next point has no flown step to compute its clearance from"""
    exceeding_at_most: float
    """upper bound on the probability that any point cleared by computation exceeds a limit"""
    smaller_step: CampaignStep | None
    """step to fly before a next point that is not cleared; null without one"""


class Campaigns:
    """The campaigns of a store. Call its methods in a thread."""

    def __init__(self, store: Store) -> None:
        self.store = store

    def add(self, campaign: Campaign) -> CampaignDetails:
        return self._details(self.store.campaigns.add(campaign.name, campaign.as_plain()), campaign)

    def all(self) -> list[CampaignSummary]:
        """All campaigns, most recently changed first."""
        return [_summary(stored, _campaign(stored)) for stored in self.store.campaigns.all()]

    def get(self, campaign_id: str) -> tuple[StoredCampaign, Campaign]:
        """One campaign, as stored and as an object. Raises NotFound."""
        stored = self.store.campaigns.info(campaign_id)
        return stored, _campaign(stored)

    def details(self, campaign_id: str) -> CampaignDetails:
        """One campaign, point by point. Raises NotFound."""
        return self._details(*self.get(campaign_id))

    def change(
        self, campaign_id: str, point: str, decide: Callable[[Campaign], Campaign]
    ) -> CampaignDetails:
        """Apply a decision to the next point, which must have this name.

        Raises NotFound, CampaignError, or CampaignChanged after a change by another person.
        """
        stored, campaign = self.get(campaign_id)
        check_next(campaign, point)
        return self.put(stored, decide(campaign))

    def put(self, before: StoredCampaign, campaign: Campaign) -> CampaignDetails:
        """Store a changed campaign; CampaignChanged if `before` is not the newest version."""
        return self._details(self.store.campaigns.put(before, campaign.as_plain()), campaign)

    def _details(self, stored: StoredCampaign, campaign: Campaign) -> CampaignDetails:
        point, step = campaign.following, campaign.smaller_step
        return CampaignDetails(
            **vars(_summary(stored, campaign)),
            conditions=[
                CampaignCondition(each.name, each.aircraft, to_plain(each.test))
                for each in campaign.conditions
            ],
            points=[self._point(each) for each in campaign.points],
            clearance=to_plain(campaign.clearance),
            checklist=list(checklist(campaign, point)) if point else [],
            is_first=campaign.is_first,
            exceeding_at_most=campaign.exceeding_at_most,
            smaller_step=step and CampaignStep(step.name, step.peak_deg),
        )

    def _point(self, point: Point) -> CampaignPoint:
        monitors, cleared = self.store.monitors, point.clearing
        most = cleared.exceeding_share_at_most if cleared else None
        known = vars(point) | {
            "state": point.state,
            "events": list(point.events),
            "clearing": cleared and CampaignClearing(**vars(cleared), exceeding_at_most=most),
            "flown": self._flight(point),
            "monitor": point.monitor if _looked_up(monitors.info, point.monitor) else None,
        }
        return CampaignPoint(**known)

    def _flight(self, point: Point) -> CampaignFlight | None:
        flown = point.flown
        if flown is None:
            return None
        recordings = self.store.recordings
        info = _looked_up(recordings.info, flown.recording)
        scorings = self.store.scorings.of(flown.recording) if info else []
        return CampaignFlight(
            flown.source,
            flown.reached,
            flown.exceeded,
            point.state == "complete" and not point.failed,
            info.id if info else None,
            info.flight_id if info else None,
            [scoring.id for scoring in scorings],
            flown.start,
            flown.end,
            bool(flown.recording) and info is None,
        )


def check_next(campaign: Campaign, point: str) -> None:
    """CampaignError if another point is next: the page that decided is out of date."""
    if (following := campaign.next.point.name) != point:
        raise CampaignError(
            f"{point!r} is not the next point: {following!r} is; reload the campaign"
        )


def _campaign(stored: StoredCampaign) -> Campaign:
    return from_file(stored.content, f"campaign {stored.name!r}")


def _summary(stored: StoredCampaign, campaign: Campaign) -> CampaignSummary:
    point = campaign.following
    return CampaignSummary(
        stored.id,
        stored.name,
        stored.created,
        stored.changed,
        list(dict.fromkeys(each.aircraft for each in campaign.conditions)),
        len(campaign.points),
        sum(each.state == "complete" for each in campaign.points),
        point.name if point else None,
        point.state if point else None,
    )


def _looked_up(look_up: Callable[[str], Any], identity: str) -> Any:
    try:
        return look_up(identity) if identity else None
    except NotFound:
        return None
