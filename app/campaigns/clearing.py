"""Compute the clearance of a campaign's next point; the checklist for a person to confirm."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

from app.campaigns.campaign import Campaign
from app.campaigns.point import CampaignError, Clearing, Point, percent_at_most, samples_of
from core.clearance.clearance import calibrate
from core.clearance.identification import FlownSegment, Identification, identify_test
from core.clearance.with_monitor import CLEARED, with_monitor
from core.planned_test.planned_test import DatasetRecipe, ManeuverTest

Progress = Callable[[int, int], object]

CHECKLIST = (
    "N_y and surface sensors are calibrated: the fit cannot detect a scale error",
    "control law and dampers are as at the flown steps",
    "the pilot flies the next point no rougher than planned",
    "Mach, dynamic pressure, mass and configuration are as at the flown steps",
)
"""Conditions that no fit can check."""
SENSORS = (
    "sensors of limited channels and surfaces are calibrated, with the trim of the flown steps"
)
"""The first one where flights predict, and no aircraft is identified."""
MONITORED = "the point's monitor is in force at ε = {epsilon:.2g}, and its alert aborts the flight"
ONE_STEP = "one step cannot reveal a nonlinear aircraft: fly a second one to exclude it"


def checklist(campaign: Campaign, point: Point) -> tuple[str, ...]:
    """What a person confirms before a point is flown; empty for a first point."""
    n_flown = len(campaign.flown(point.condition))
    monitor = point.clearing and point.clearing.monitor
    is_linear = campaign.condition_of(point).is_identifiable
    conditions = CHECKLIST if is_linear else (SENSORS, *CHECKLIST[1:])
    return (
        *(conditions if n_flown else ()),
        *((ONE_STEP,) if n_flown == 1 and is_linear else ()),
        *((MONITORED.format(epsilon=monitor.epsilon),) if monitor else ()),
    )


def clear_next(
    campaign: Campaign,
    by: str,
    progress: Progress | None = None,
    executor: Executor | None = None,
    *,
    monitored: bool = False,
) -> Campaign:
    """Compute the clearance of the next point: on condition, or hold.

    monitored: its monitor, which is trained afterwards, is a part of the clearance.
    A first point has no flown step to compute from: a person decides.
    CampaignError without a next point; ClearanceError where calibration is impossible.
    """
    number, point = campaign.next
    check_computable(campaign)
    flown = campaign.flown(point.condition)
    rule = calibrate(campaign.build_up(point), campaign.clearance, progress, executor)
    epsilon = with_monitor(rule, progress, executor).epsilon if monitored else None
    clear_below = None if rule.is_rare else rule.clear_below if epsilon is None else CLEARED
    records = [samples_of(step.flown) for step in flown if step.flown]
    verdict = rule.decide(records, clear_below)
    withdrawn = tuple(
        f"{check.words} ({check.value:.3g}, expected at most {check.level:.3g})"
        for check in verdict.withdrawn
    )
    if (last := campaign.last_flown(point.condition)).failed:
        withdrawn += (f"{last.name} did not pass",)
    clearing = Clearing(
        verdict.cleared and not withdrawn,
        verdict.p_value,
        clear_below,
        verdict.reached,
        None if withdrawn else verdict.amplitude_deg,
        withdrawn,
        rule.n_exceeding,
        rule.n_tried,
        campaign.clearance,
        tuple(step.name for step in flown),
        rule.exceeding_share,
        verdict.p_error,
        epsilon,
    )
    state = "on condition" if clearing.cleared else "hold"
    return campaign.changed(number, state, by, clearing_in_words(clearing), clearing=clearing)


def check_computable(campaign: Campaign) -> None:
    """CampaignError if the next point has no flown step to compute from."""
    point = campaign.next.point
    if not campaign.flown(point.condition):
        raise CampaignError(
            f"no step flown before {point.name!r} at its flight condition, so its clearance cannot "
            "be computed: a person clears it, by confirming it with a name"
        )


def bound_in_words(clearing: Clearing) -> str:
    """` (at most 0.92 %, 95 % confidence)`: the share of aircraft that exceed a limit."""
    share = clearing.exceeding_share_at_most
    return "" if share is None else f" (at most {percent_at_most(share)}, 95 % confidence)"


def clearing_in_words(clearing: Clearing) -> str:
    if clearing.withdrawn:
        return f"clearance withdrawn: {'; '.join(clearing.withdrawn)}"
    low, middle, high = (f"{part:.0%}" for part in clearing.reached)
    predicted = f"predicted to reach {middle} of a limit ({low} to {high})"
    if clearing.p_value is None:
        return (
            f"{clearing.n_exceeding} of {clearing.n_tried:,} simulated aircraft exceed a limit"
            f"{bound_in_words(clearing)}, {predicted}"
        )
    return f"{_p_value_in_words(clearing)}: {predicted}"


def _p_value_in_words(clearing: Clearing) -> str:
    """`p-value 0.06 ± 0.01, cleared up to 0.05, close: other random draws may decide otherwise`."""
    error = "" if clearing.p_error is None else f" ± {clearing.p_error:.1g}"
    close = ", close: other random draws may decide otherwise" if clearing.is_close else ""
    if (epsilon := clearing.monitor_epsilon) is not None:
        close += f", with its monitor at ε = {epsilon:.2g}"
    return f"p-value {clearing.p_value:.3g}{error}, cleared up to {clearing.clear_below:.3g}{close}"


def identified(campaign: Campaign, condition: str, first: int | None = None) -> Identification:
    """The aircraft at a flight condition, identified from its complete points.

    first: number of points to use; None for all.   CampaignError without a complete point, and for
    an aircraft that is not linear.
    """
    flown = campaign.flown(condition)[:first]
    if not flown:
        raise CampaignError("no point is complete: fly one before identifying the aircraft")
    test = campaign.condition_of(flown[0]).test
    if not isinstance(test, DatasetRecipe):
        raise CampaignError(
            "derivatives are identified of a linear aircraft alone: the flown steps of this one "
            "predict the next point by simulated flights, see its clearance"
        )
    segments = [FlownSegment(samples_of(p.flown), test.dt, p.name) for p in flown if p.flown]
    return identify_test(test, segments)


def updated(campaign: Campaign, point: Point) -> ManeuverTest:
    """Planned test of a point with the aircraft identified from the complete points, or as planned
    where none can be identified."""
    if not campaign.condition_of(point).is_identifiable:
        return campaign.test_of(point)
    known = identified(campaign, point.condition).identified
    flown = campaign.flown(point.condition)
    sources = tuple(f"{step.name} ({step.flown.source})" for step in flown if step.flown)
    return replace(campaign.test_of(point), aircraft=replace(known, sources=sources))


def history(campaign: Campaign, condition: str) -> list[Identification]:
    """Identifications after the first complete point, after the second, and so on."""
    flown = campaign.flown(condition)
    n_flown = len(flown) if flown and campaign.condition_of(flown[0]).is_identifiable else 0
    return [identified(campaign, condition, first) for first in range(1, n_flown + 1)]


def identification_plain(identification: Identification) -> dict[str, Any]:
    """An identification as plain data; before and after are [mean, sigma]."""
    return {
        "sources": list(identification.sources),
        "parameters": [
            {
                "name": name,
                "before": [identification.prior_mean[k], identification.prior_sigma[k]],
                "after": [identification.mean[k], identification.sigma[k]],
                "determined": name not in identification.undetermined,
            }
            for k, name in enumerate(identification.names)
        ],
        "covariance": identification.covariance.tolist(),
        "r2": identification.r2.tolist(),
        "distance": identification.distance,
        "noise": identification.noise.tolist(),
    }
