"""Campaigns of the store, and what is told of them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from app.campaigns.campaign import (
    Campaign,
    CampaignError,
    Clearing,
    Event,
    Point,
    State,
)
from app.campaigns.clearing import checklist
from app.campaigns.file import from_file
from app.recipes import SentRecipe, to_plain
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


@dataclass(frozen=True)
class CampaignFlight(Entry):
    """How a point was flown, and where it is stored."""

    source: str
    """recording, and the time in it"""
    reached: float
    """largest part of a limit"""
    exceeded: str
    """channel and time, or empty"""
    passed: bool
    """whether it is complete and stayed below what it must"""
    recording: str | None
    """id, where it is stored still"""
    flight: str | None
    """id of the live flight that it was, where it is stored still"""
    scorings: list[str]
    """ids, of the recording"""
    start: float | None
    """in the recording [s]"""
    end: float | None
    """in the recording [s]"""
    recording_deleted: bool
    """whether it was stored, and is not any more"""


@dataclass(frozen=True)
class CampaignClearing(Clearing):
    """What was computed of a point, with what follows from it."""

    exceeding_at_most: float | None = None
    """share of aircraft that exceed, with 95 % confidence by those simulated"""


@dataclass(frozen=True)
class CampaignPoint(Entry):
    """A point, what was computed of it and what became of it."""

    name: str
    condition: str
    """name of its flight condition"""
    peak_deg: float
    """of the manoeuvre's command"""
    state: State
    passes_below: float
    """part of a limit that it must stay below"""
    criteria: str
    """what else it must show"""
    events: list[Event]
    clearing: CampaignClearing | None
    """what was computed before it was flown; null where nothing was"""
    flown: CampaignFlight | None
    monitor: str | None
    """id of the one that was trained for it, where it is stored still"""


@dataclass(frozen=True)
class CampaignDetails(CampaignSummary):
    """A campaign, point by point."""

    conditions: list[CampaignCondition]
    points: list[CampaignPoint]
    clearance: dict[str, Any]
    """how clearances are calibrated"""
    checklist: list[str]
    """what a person confirms before the next point is flown; empty before a first one"""
    is_first: bool
    """whether no step was flown before the next point, so that nothing can be computed of it"""
    exceeding_at_most: float
    """probability that any point exceeds that was cleared by computation"""


class Campaigns:
    """The campaigns of a store. Its methods are for a thread."""

    def __init__(self, store: Store) -> None:
        self.store = store

    def add(self, campaign: Campaign) -> CampaignDetails:
        """Store a campaign."""
        return self._told(self.store.campaigns.add(campaign.name, campaign.as_plain()), campaign)

    def all(self) -> list[CampaignSummary]:
        """All campaigns, the one changed last first."""
        return [_summary(stored, _campaign(stored)) for stored in self.store.campaigns.all()]

    def get(self, campaign_id: str) -> tuple[StoredCampaign, Campaign]:
        """One campaign, as it is stored and as what it is. NotFound."""
        stored = self.store.campaigns.get(campaign_id)
        return stored, _campaign(stored)

    def details(self, campaign_id: str) -> CampaignDetails:
        """One campaign, point by point. NotFound."""
        return self._told(*self.get(campaign_id))

    def change(
        self, campaign_id: str, point: str, decide: Callable[[Campaign], Campaign]
    ) -> CampaignDetails:
        """Do something with the next point, which must be the one of this name.

        NotFound; CampaignError; CampaignChanged where somebody else was faster.
        """
        stored, campaign = self.get(campaign_id)
        check_next(campaign, point)
        return self.put(stored, decide(campaign))

    def put(self, before: StoredCampaign, campaign: Campaign) -> CampaignDetails:
        """Store what came of a campaign; CampaignChanged where `before` is not the newest."""
        return self._told(self.store.campaigns.put(before, campaign.as_plain()), campaign)

    def _told(self, stored: StoredCampaign, campaign: Campaign) -> CampaignDetails:
        point = None if campaign.is_over else campaign.next.point
        return CampaignDetails(
            **vars(_summary(stored, campaign)),
            conditions=[
                CampaignCondition(
                    one.name, one.test.aircraft.description.split(";")[0], to_plain(one.test)
                )
                for one in campaign.conditions
            ],
            points=[self._point(one) for one in campaign.points],
            clearance=to_plain(campaign.clearance),
            checklist=list(checklist(campaign, point)) if point else [],
            is_first=point is not None and not campaign.flown(point.condition),
            exceeding_at_most=campaign.exceeding_at_most,
        )

    def _point(self, point: Point) -> CampaignPoint:
        return CampaignPoint(
            point.name,
            point.condition,
            point.peak_deg,
            point.state,
            point.passes_below,
            point.criteria,
            list(point.events),
            _told(point.clearing),
            self._flight(point),
            point.monitor if _is_there(self.store.monitors.info, point.monitor) else None,
        )

    def _flight(self, point: Point) -> CampaignFlight | None:
        flown = point.flown
        if flown is None:
            return None
        recordings = self.store.recordings
        info = _is_there(recordings.info, flown.recording)
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
    """CampaignError where another point is next: what is decided is decided of what was seen."""
    if (following := campaign.next.point.name) != point:
        raise CampaignError(f"{point!r} is not the next point, that is {following!r}: look again")


def _campaign(stored: StoredCampaign) -> Campaign:
    return from_file(stored.content, f"campaign {stored.name!r}")


def _summary(stored: StoredCampaign, campaign: Campaign) -> CampaignSummary:
    point = None if campaign.is_over else campaign.next.point
    aircraft = [one.test.aircraft.description.split(";")[0] for one in campaign.conditions]
    return CampaignSummary(
        stored.id,
        stored.name,
        stored.created,
        stored.changed,
        list(dict.fromkeys(aircraft)),
        len(campaign.points),
        sum(one.state == "complete" for one in campaign.points),
        point.name if point else None,
        point.state if point else None,
    )


def _told(clearing: Clearing | None) -> CampaignClearing | None:
    if clearing is None:
        return None
    return CampaignClearing(**vars(clearing), exceeding_at_most=clearing.exceeding_share_at_most)


def _is_there(look_up: Callable[[str], Any], identity: str) -> Any:
    """What is stored of an id; None where there is none, or not any more."""
    try:
        return look_up(identity) if identity else None
    except NotFound:
        return None
