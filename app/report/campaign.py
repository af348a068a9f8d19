"""A campaign as a printable page: the next point's test card, and the results so far."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from app.assessment.planned_test import SURFACE_NAMES, PlannedTest
from app.campaigns.campaign import Campaign
from app.campaigns.clearing import bound_in_words, checklist, history
from app.campaigns.point import Condition, Point, percent_at_most
from app.recipes.labels import kind_label
from app.recipes.recipes import to_plain
from app.report.page import TEMPLATES
from app.report.strip_chart import ticks
from core import __version__
from core.channels import CHANNELS
from core.clearance.identification import Identification
from core.planned_test.planned_test import DatasetRecipe
from core.types import Array

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 680.0, 280.0, 46.0, 14.0, 12.0, 34.0
"""Size and margins of the build-up plot [px]."""
LEFT_OF_ROWS, ROW_HEIGHT = 64.0, 20.0
"""Left margin and row height of the plot of derivatives [px]."""
MOST_STEPS = 12
"""Longest input that is described step by step."""
ROOM = 1.08
"""Axis length as a multiple of the largest number."""


def campaign_page(campaign: Campaign) -> str:
    point = None if campaign.is_over else campaign.next.point
    return TEMPLATES.get_template("campaign.html").render(
        campaign=campaign,
        point=point,
        checklist=checklist(campaign, point) if point else (),
        input=input_words(campaign.test_of(point)) if point else "",
        is_first=point is not None and not campaign.flown(point.condition),
        conditions=[_condition(campaign, condition) for condition in campaign.conditions],
        any_cleared=any(point.clearing and point.clearing.cleared for point in campaign.points),
        bound_in_words=bound_in_words,
        exceeding_at_most=percent_at_most(campaign.exceeding_at_most),
        version=__version__,
    )


def input_words(test: DatasetRecipe) -> str:
    """The input step by step: time, surface, deflection; empty if it has too many steps."""
    commands = np.degrees(PlannedTest.of(test).commands)
    lines: list[str] = []
    for name, command in zip(SURFACE_NAMES, commands.T, strict=True):
        changes = np.flatnonzero(np.diff(command, prepend=0.0))
        if 0 < len(changes) <= MOST_STEPS:
            steps = (f"at {k * test.dt:g} s to {command[k]:.3g} deg" for k in changes)
            lines.append(f"{name} {', '.join(steps)}")
    return "; ".join(lines)


def _condition(campaign: Campaign, condition: Condition) -> dict[str, Any]:
    identifications = history(campaign, condition.name)
    test = condition.test
    limits = zip(CHANNELS, test.specification.magnitudes, strict=True)
    return {
        "name": condition.name,
        "points": [point for point in campaign.points if point.condition == condition.name],
        "maneuver": kind_label(to_plain(test.maneuver)["kind"]),
        "limits": [(channel, float(limit)) for channel, limit in limits if limit < float("inf")],
        "aircraft": test.aircraft.description.split(";")[0],
        "plot": build_up_plot(campaign, condition.name),
        "identified": identifications[-1] if identifications else None,
        "derivatives": derivatives_plot(identifications) if identifications else "",
    }


class _Axes:
    """x: magnitude of the amplitude [deg].   y: part of the limit. Both start at 0."""

    def __init__(self, most_deg: float, most_part: float) -> None:
        self._most_deg, self._most_part = ROOM * most_deg, ROOM * most_part

    def x(self, amplitude_deg: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * amplitude_deg / self._most_deg

    def y(self, part: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * part / self._most_part

    def frame(self) -> str:
        right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM
        parts = [
            f'<path class="grid" d="M{LEFT} {self.y(part):.1f}H{right}"/>'
            f'<text x="{LEFT - 5}" y="{self.y(part) + 3:.1f}" text-anchor="end">{part:.0%}</text>'
            for part, _ in ticks(0.0, self._most_part, 5)
        ]
        parts += [
            f'<text x="{self.x(at):.1f}" y="{bottom + 13}" text-anchor="middle">{words}</text>'
            for at, words in ticks(0.0, self._most_deg, 6)
        ]
        words = "amplitude [deg]; vertical: largest part of a limit"
        parts.append(
            f'<text x="{(LEFT + right) / 2}" y="{HEIGHT - 4}" text-anchor="middle">{words}</text>'
        )
        parts.append(f'<path class="frame" d="M{LEFT} {TOP}V{bottom}H{right}"/>')
        return "".join(parts)


def build_up_plot(campaign: Campaign, condition: str) -> Markup:
    """Predicted intervals and flown peaks over the points, with the limit, as SVG."""
    points = [point for point in campaign.points if point.condition == condition]
    reached = [point.flown.reached for point in points if point.flown]
    predicted = [point.clearing.reached[2] for point in points if point.clearing]
    axes = _Axes(max(abs(point.peak_deg) for point in points), max([1.0, *reached, *predicted]))
    limit = (
        f'<path class="limit" d="M{LEFT} {axes.y(1.0):.1f}H{WIDTH - RIGHT}"/>'
        f'<text class="limit-words" x="{LEFT + 6}" y="{axes.y(1.0) - 4:.1f}">limit</text>'
    )
    marks = "".join(_marks(axes, point) for point in points)
    return Markup(
        f'<svg class="chart" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        'aria-label="Predicted and flown peaks over amplitude">'
        f"{axes.frame()}{limit}{marks}</svg>"
    )


def _marks(axes: _Axes, point: Point) -> str:
    """A point: its name, the predicted bar, the flown mark."""
    x, parts = axes.x(abs(point.peak_deg)), []
    if point.clearing:
        low, middle, high = (axes.y(part) for part in point.clearing.reached)
        parts.append(
            f'<path class="predicted" d="M{x - 5:.1f} {low:.1f}h10m-5 0V{high:.1f}m-5 0h10'
            f'M{x - 8:.1f} {middle:.1f}h16"/>'
        )
    if point.flown:
        y = axes.y(point.flown.reached)
        parts.append(
            f'<path class="not-passed" d="M{x - 4:.1f} {y - 4:.1f}l8 8m-8 0l8 -8"/>'
            if point.failed or point.state == "aborted"
            else f'<circle class="flown" cx="{x:.1f}" cy="{y:.1f}" r="4"/>'
        )
    name = escape(point.name)
    parts.append(f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM - 4}" text-anchor="middle">{name}</text>')
    return "".join(parts)


def derivatives_plot(history: Sequence[Identification]) -> Markup:
    """Each uncertain derivative after each point, in units of the prior sigma, as SVG.

    history: after the first point, the second, and so on.
    """
    last = history[-1]
    uncertain = [k for k in range(len(last.names)) if last.prior_sigma[k] > 0.0]
    known = [_standard(identified) for identified in history]
    most = max(3.0, *(float(np.abs(mean[uncertain]).max()) + 1.0 for mean, _ in known))
    height = TOP + ROW_HEIGHT * len(uncertain) + BOTTOM
    middle, unit = (LEFT_OF_ROWS + WIDTH - RIGHT) / 2, (WIDTH - RIGHT - LEFT_OF_ROWS) / 2 / most
    bottom = height - BOTTOM
    parts = [
        f'<rect class="prior" x="{middle - 2 * unit:.1f}" y="{TOP}" width="{4 * unit:.1f}" '
        f'height="{bottom - TOP:.1f}"/>'
    ]
    for at in range(-int(most), int(most) + 1):
        x = middle + unit * at
        parts.append(f'<path class="grid" d="M{x:.1f} {TOP}V{bottom}"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 13}" text-anchor="middle">{at}</text>')
    for row, k in enumerate(uncertain):
        y = TOP + ROW_HEIGHT * row
        parts.append(
            f'<text x="{LEFT_OF_ROWS - 6}" y="{y + ROW_HEIGHT / 2 + 3:.1f}" text-anchor="end">'
            f"{escape(last.names[k])}</text>"
        )
        for number, (mean, sigma) in enumerate(known):
            at = y + ROW_HEIGHT * (number + 1) / (len(known) + 1)
            low, high = (middle + unit * (mean[k] + side * sigma[k]) for side in (-1.96, 1.96))
            kind = "known" if number == len(known) - 1 else "known earlier"
            parts.append(f'<path class="{kind}" d="M{low:.1f} {at:.1f}H{high:.1f}"/>')
            x = middle + unit * mean[k]
            parts.append(f'<circle class="{kind}" cx="{x:.1f}" cy="{at:.1f}" r="2"/>')
    words = "difference from the expected value, in expected standard deviations"
    parts.append(f'<text x="{middle:.1f}" y="{height - 4}" text-anchor="middle">{words}</text>')
    return Markup(
        f'<svg class="chart" viewBox="0 0 {WIDTH:g} {height:g}" role="img" '
        f'aria-label="Derivatives after each point">{"".join(parts)}</svg>'
    )


def _standard(identified: Identification) -> tuple[Array, Array]:
    """(n_params,) each: shift of the means, and the sigmas, in units of the prior sigma."""
    scale = np.where(identified.prior_sigma > 0.0, identified.prior_sigma, 1.0)
    return (identified.mean - identified.prior_mean) / scale, identified.sigma / scale
