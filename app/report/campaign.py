"""A campaign as a printable page: the next point's test card, and the results so far."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from app.campaigns.campaign import Campaign
from app.campaigns.clearing import bound_in_words, checklist, history
from app.campaigns.point import Condition, percent_at_most
from app.recipes.labels import kind_label
from app.recipes.recipes import to_plain
from app.report.facts import limited
from app.report.page import TEMPLATES, limits_in_words
from app.report.strip_chart import CROSS, DOT, STROKE, StripChart
from core import __version__
from core.channels import significant
from core.clearance.identification import Identification
from core.counted import counted
from core.types import Array

HEIGHT, ROW_HEIGHT = 230.0, 12.0
"""Heights of the build-up plot, and of a row of the plot of derivatives [px]."""
ROOM = 1.08
"""Axis length as a multiple of the largest number."""


def campaign_page(campaign: Campaign) -> str:
    point = campaign.following
    return TEMPLATES.get_template("campaign.html").render(
        campaign=campaign,
        point=point,
        checklist=checklist(campaign, point) if point else (),
        condition=campaign.condition_of(point) if point else None,
        test=campaign.test_of(point) if point else None,
        is_first=campaign.is_first,
        conditions=[_condition(campaign, condition) for condition in campaign.conditions],
        any_cleared=any(point.clearing and point.clearing.cleared for point in campaign.points),
        bound_in_words=bound_in_words,
        exceeding_at_most=percent_at_most(campaign.exceeding_at_most),
        version=__version__,
    )


def plan_in_words(campaign: Campaign, condition: Condition) -> str:
    """Aircraft, trim, manoeuvre and limits of a flight condition, on one line."""
    test = condition.test
    points = [point for point in campaign.points if point.condition == condition.name]
    maneuver = kind_label(to_plain(test.maneuver)["kind"])
    limits = ", ".join(
        f"{channel.label} {limits_in_words(low, high, channel)}"
        for channel, low, high in limited(test.dictionary, test.judged_by)
    )
    parts = (
        condition.aircraft,
        "" if condition.is_identifiable else condition.trim,  # linear aircraft name their own
        f"{maneuver}, {counted(len(points), 'point')} up to {significant(points[-1].peak_deg)} deg",
        f"limits {limits}",
    )
    return "; ".join(filter(None, parts))


def _condition(campaign: Campaign, condition: Condition) -> dict[str, Any]:
    identifications = history(campaign, condition.name)
    return {
        "name": condition.name,
        "plan": plan_in_words(campaign, condition),
        "plot": build_up_plot(campaign, condition.name),
        "identified": identifications[-1] if identifications else None,
        "derivatives": derivatives_plot(identifications) if identifications else "",
    }


def build_up_plot(campaign: Campaign, condition: str) -> Markup:
    """Predicted intervals and flown peaks over the points, with the limit, as SVG."""
    points = [point for point in campaign.points if point.condition == condition]
    reached = [point.flown.reached for point in points if point.flown]
    predicted = [point.clearing.reached[2] for point in points if point.clearing]
    peaks = [abs(point.peak_deg) for point in points]
    chart = StripChart(0.0, ROOM * max(peaks), axis="amplitude [deg]")
    strip = chart.strip(HEIGHT, "largest part of a limit [%]")
    strip.show([0.0, 100.0 * max([1.0, *reached, *predicted])])
    strip.levels("limit", [100.0])
    for at, point in zip(peaks, points, strict=True):
        if point.clearing:
            interval = 100.0 * np.array(point.clearing.reached)
            kind = "predicted doubted" if point.clearing.withdrawn else "predicted"
            strip.line(kind, np.full(3, at), interval)
            strip.marks(kind, np.full(3, at), interval, STROKE)
        if point.flown:
            failed = point.failed or point.state == "aborted"
            look = ("not-passed", CROSS) if failed else ("flown", DOT)
            strip.marks(look[0], np.array([at]), np.array([100.0 * point.flown.reached]), look[1])
    chart.name([(at, point.name) for at, point in zip(peaks, points, strict=True)])
    return chart.svg("Predicted and flown peaks over amplitude")


def derivatives_plot(history: Sequence[Identification]) -> Markup:
    """Each uncertain derivative after each point, in units of the prior sigma, as SVG.

    history: after the first point, the second, and so on.
    """
    last, n = history[-1], len(history)
    uncertain = [k for k in range(len(last.names)) if last.prior_sigma[k] > 0.0]
    known = [_standard(identified) for identified in history]
    most = max(3.0, *(float(np.abs(mean[uncertain]).max()) + 1.0 for mean, _ in known))
    words = "difference from the expected value, in expected standard deviations"
    chart = StripChart(-most, most, axis=words)
    for k in uncertain:
        strip = chart.strip(ROW_HEIGHT, last.names[k])
        strip.low, strip.high = 0.0, n + 1.0
        strip.fill("prior", [(-2.0, 2.0)])
        for number, (mean, sigma) in enumerate(known):
            kind, level = ("known" if number == n - 1 else "known earlier"), n - number
            half = 1.96 * sigma[k]
            strip.steps(kind, [(mean[k] - half, mean[k] + half, level)])
            strip.marks(kind, mean[[k]], np.array([level]), DOT)
    return chart.svg("Derivatives after each point")


def _standard(identified: Identification) -> tuple[Array, Array]:
    """(n_params,) each: shift of the means, and the sigmas, in units of the prior sigma."""
    scale = np.where(identified.prior_sigma > 0.0, identified.prior_sigma, 1.0)
    return (identified.mean - identified.prior_mean) / scale, identified.sigma / scale
