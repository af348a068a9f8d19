"""A campaign as a page that prints: the card of the next point, and the results of those flown."""

from markupsafe import Markup, escape

from app.campaigns.campaign import Campaign, Point
from app.campaigns.clearing import checklist, identified
from app.report.page import TEMPLATES
from app.report.strip_chart import ticks
from core import __version__
from core.channels import CHANNELS

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 680.0, 280.0, 46.0, 14.0, 12.0, 34.0
"""Of the build-up plot [px]."""
ROOM = 1.08
"""Of what is shown, beyond the largest number."""


def campaign_page(campaign: Campaign) -> str:
    """Return the campaign as HTML that needs no other file."""
    over = all(point.is_over for point in campaign.points)
    point = None if over else campaign.next.point
    found = identified(campaign) if campaign.flown else None
    limits = zip(CHANNELS, campaign.test.specification.magnitudes, strict=True)
    return TEMPLATES.get_template("campaign.html").render(
        campaign=campaign,
        point=point,
        checklist=checklist(campaign) if campaign.flown else (),
        plot=build_up_plot(campaign),
        found=found,
        parameters=[]
        if found is None
        else zip(
            found.names,
            found.prior_mean,
            found.prior_sigma,
            found.mean,
            found.sigma,
            strict=True,
        ),
        limits=[(channel, float(limit)) for channel, limit in limits if limit < float("inf")],
        aircraft=campaign.test.aircraft.description.split(";")[0],
        version=__version__,
    )


class _Axes:
    """Amplitude [deg] to the right, part of a limit upwards, both from 0."""

    def __init__(self, most_deg: float, most_part: float) -> None:
        self._most_deg, self._most_part = ROOM * most_deg, ROOM * most_part

    def x(self, amplitude_deg: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * amplitude_deg / self._most_deg

    def y(self, part: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * part / self._most_part

    def frame(self) -> str:
        """Grid, ticks and what the axes mean."""
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
        words = "amplitude [deg]; upwards: largest part of a limit"
        parts.append(
            f'<text x="{(LEFT + right) / 2}" y="{HEIGHT - 4}" text-anchor="middle">{words}</text>'
        )
        parts.append(f'<path class="frame" d="M{LEFT} {TOP}V{bottom}H{right}"/>')
        return "".join(parts)


def build_up_plot(campaign: Campaign) -> Markup:
    """Predicted intervals and flown peaks over the points, with the limit, as SVG."""
    reached = [point.flown.reached for point in campaign.points if point.flown]
    predicted = [point.clearing.reached[2] for point in campaign.points if point.clearing]
    axes = _Axes(max(point.peak_deg for point in campaign.points), max([1.0, *reached, *predicted]))
    limit = (
        f'<path class="limit" d="M{LEFT} {axes.y(1.0):.1f}H{WIDTH - RIGHT}"/>'
        f'<text class="limit-words" x="{LEFT + 6}" y="{axes.y(1.0) - 4:.1f}">limit</text>'
    )
    points = "".join(_drawn(axes, point) for point in campaign.points)
    return Markup(
        f'<svg class="chart" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        'aria-label="Predicted and flown peaks over amplitude">'
        f"{axes.frame()}{limit}{points}</svg>"
    )


def _drawn(axes: _Axes, point: Point) -> str:
    """A point: its name, the bar of what was predicted, the dot of what was flown."""
    x, parts = axes.x(point.peak_deg), []
    if point.clearing:
        low, middle, high = (axes.y(part) for part in point.clearing.reached)
        parts.append(
            f'<path class="predicted" d="M{x - 5:.1f} {low:.1f}h10m-5 0V{high:.1f}m-5 0h10'
            f'M{x - 8:.1f} {middle:.1f}h16"/>'
        )
    if point.flown:
        parts.append(
            f'<circle class="flown" cx="{x:.1f}" cy="{axes.y(point.flown.reached):.1f}" r="4"/>'
        )
    name = escape(point.name)
    parts.append(f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM - 4}" text-anchor="middle">{name}</text>')
    return "".join(parts)
