"""Strips over one time axis as SVG that stands in a page: small, quick, styled by the page.

Colours, widths and dashes are classes of report.css; geometry is all that is made here.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import ceil, floor, log10

import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape

from app.report.envelope import Array, envelope, runs

WIDTH, LEFT, RIGHT = 680.0, 60.0, 14.0
"""Of a chart, and what is usually left and right of its strips [px]."""
TOP, BETWEEN, BOTTOM = 22.0, 9.0, 30.0
LETTER = 5.0
"""About the width of one [px]."""
TURNED = 30.0
"""Height from which a strip's label is turned to stand beside its ticks [px]."""
MARGIN = 0.06
"""Of what a strip shows, left free above and below."""
Intervals = Iterable[tuple[float, float]]
"""From, to [s]."""


class Strip:
    """A strip of a chart, which shows values from `low` to `high`."""

    def __init__(self, chart: "StripChart", top: float, height: float, label: str) -> None:
        self.chart, self.top, self.height, self.label = chart, top, height, label
        self.low, self.high = 0.0, 1.0
        self.ticks: list[tuple[float, str]] = []
        self._parts: list[str] = []

    def show(self, *values: npt.ArrayLike) -> None:
        """Make room for all of these values, and mark about four."""
        every = np.concatenate([np.ravel(np.asarray(one, np.float64)) for one in values])
        known = every[np.isfinite(every)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
        spread = high - low or abs(high) or 1.0
        self.low, self.high = low - MARGIN * spread, high + MARGIN * spread
        self.ticks = list(ticks(self.low, self.high, 4))

    def line(self, kind: str, t: Array, values: Array) -> None:
        """A trace, broken where a value is missing or outside of the chart."""
        t, values = envelope(t, values)
        inside = np.isfinite(values) & (t >= self.chart.start) & (t <= self.chart.end)
        x, y = self.chart.x(t), self.y(values)
        path = [
            "M" + "L".join(f"{x[k]:.1f} {y[k]:.1f}" for k in range(first, last + 1))
            for first, last in runs(inside)
        ]
        self._draw(kind, path)

    def levels(self, kind: str, values: Iterable[float]) -> None:
        """A line over the whole time at each value."""
        heights = self.y(np.array([*values], np.float64)).tolist()
        self._draw(kind, [f"M{self.chart.left:g} {y:.1f}H{WIDTH - RIGHT:g}" for y in heights])

    def steps(self, kind: str, values: Iterable[tuple[float, float, float]]) -> None:
        """A line from, to [s] at each value."""
        path = []
        for start, end, value in values:
            first, last = max(start, self.chart.start), min(end, self.chart.end)
            if first < last:
                left, right = self.chart.x(np.array([first, last])).tolist()
                y = float(self.y(np.array([value]))[0])
                path.append(f"M{left:.1f} {y:.1f}H{right:.1f}")
        self._draw(kind, path)

    def moments(self, kind: str, times: Iterable[float]) -> None:
        """A line over the whole height at each time."""
        at = self.chart.x(np.array([*times], np.float64)).tolist()
        self._draw(kind, [f"M{x:.1f} {self.top:.1f}v{self.height:.1f}" for x in at])

    def fill(self, kind: str, intervals: Intervals, least: float = 0.0) -> None:
        """The whole height over intervals of time. least: width of each at least [px]."""
        sides = self.chart.x(np.array([*intervals], np.float64).reshape(-1, 2)).tolist()
        boxes = [
            f"M{left:.1f} {self.top:.1f}H{max(right, left + least):.1f}"
            f"v{self.height:.1f}H{left:.1f}z"
            for left, right in sides
        ]
        self._draw(kind, boxes)

    def marks(self, kind: str, t: Array, values: Array) -> None:
        """A triangle that points down at each sample."""
        points = zip(self.chart.x(t), self.y(values), strict=True)
        self._draw(kind, [f"M{x:.1f} {y:.1f}l-3.5-6h7z" for x, y in points])

    def y(self, values: Array) -> Array:
        """Where values lie in the chart [px]."""
        return self.top + (self.high - values) / (self.high - self.low) * self.height

    def svg(self, times: Sequence[tuple[float, str]]) -> Iterator[str]:
        """Grid, traces, frame and words."""
        bottom, left, right = self.top + self.height, self.chart.left, WIDTH - RIGHT
        across = [f"M{x:.1f} {self.top:.1f}V{bottom:.1f}" for x, _ in times]
        heights = self.y(np.array([value for value, _ in self.ticks])).tolist()
        along = [f"M{left:g} {y:.1f}H{right:g}" for y in heights]
        yield f'<path class="grid" d="{"".join(across + along)}"/>'
        yield from self._parts
        yield f'<path class="frame" d="M{left:g} {self.top:.1f}V{bottom:.1f}H{right:g}"/>'
        for y, (_, text) in zip(heights, self.ticks, strict=True):
            yield _text(left - 5, y + 3, text, "end")
        middle = self.top + self.height / 2
        if self.height < TURNED:
            yield _text(left - 5, middle + 3, _symbol(self.label), "end")
        else:
            turned = f' transform="rotate(-90 12 {middle:.1f})"'
            yield _text(12, middle + 3, _symbol(self.label), "middle", turned)

    def _draw(self, kind: str, path: list[str]) -> None:
        if path:
            self._parts.append(f'<path class="{kind}" d="{"".join(path)}"/>')


class StripChart:
    """Strips, one below the other.

    start, end: of the time axis [s].   left, top: beside and above the strips [px].
    """

    def __init__(self, start: float, end: float, left: float = LEFT, top: float = TOP) -> None:
        self.start, self.end = start, end if end > start else start + 1.0
        self.left, self.top = left, top
        self._strips: list[Strip] = []
        self._words: list[str] = []
        self._bottom = top

    def x(self, t: Array) -> Array:
        """Where times lie in the chart [px]."""
        width = WIDTH - RIGHT - self.left
        return self.left + (t - self.start) / (self.end - self.start) * width

    def strip(self, height: float, label: str = "") -> Strip:
        """Add a strip. label: `N_y [g]`."""
        made = Strip(self, self._bottom, height, label)
        self._strips.append(made)
        self._bottom += height + BETWEEN
        return made

    def explain(self, kinds: Iterable[tuple[str, str]]) -> None:
        """Say above the strips what lines of a kind are: (kind, words)."""
        x = self.left
        for kind, words in kinds:
            self._words.append(f'<path class="{kind}" d="M{x:g} 9h20"/>')
            self._words.append(_text(x + 24, 12, words))
            x += 24 + LETTER * (len(words) + 3)

    def name(self, names: Sequence[tuple[float, str]]) -> None:
        """Write names above the first strip from the time of each on [s], in order, if they fit.

        Where one does not, all are numbered, and those left out that still do not.
        """
        at = [*self.x(np.array([t for t, _ in names])).tolist(), WIDTH]
        widths = [LETTER * (len(name) + 2) for _, name in names]
        fit = all(x + w <= after for x, w, after in zip(at, widths, at[1:], strict=False))
        free = 0.0
        for number, (x, (_, name)) in enumerate(zip(at, names, strict=False), 1):
            text = name if fit else str(number)
            if x >= free:
                self._words.append(_text(x + 1, self.top - 4, text, more=' class="named"'))
                free = x + LETTER * (len(text) + 1)

    def svg(self, title: str) -> Markup:
        """The chart as an element. title: for those who do not see it."""
        return Markup(
            f'<svg class="chart" viewBox="0 0 {WIDTH:g} {self.height:.0f}" role="img" '
            f'aria-label="{escape(title)}">{self.content()}</svg>'
        )

    @property
    def height(self) -> float:
        """Of the whole chart [px]."""
        return self._bottom - BETWEEN + BOTTOM

    def content(self) -> str:
        """All that is drawn, without the element around it."""
        marked = list(ticks(self.start, self.end, 8))
        places = self.x(np.array([t for t, _ in marked])).tolist()
        times = list(zip(places, (text for _, text in marked), strict=True))
        axis = [_text(x, self.height - 18, text, "middle") for x, text in times]
        axis.append(_text((self.left + WIDTH - RIGHT) / 2, self.height - 4, "t [s]", "middle"))
        strips = [part for strip in self._strips for part in strip.svg(times)]
        return "".join(strips + axis + self._words)


def ticks(low: float, high: float, n: int) -> Iterator[tuple[float, str]]:
    """About n round values between low and high, as written at an axis."""
    rough = (high - low) / n
    power = 10.0 ** floor(log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough * 0.999)
    digits = max(0, -floor(log10(step) + 1e-9))
    for k in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1):
        yield k * step, f"{k * step:.{digits}f}".replace("-", "−")


def _text(x: float, y: float, words: str, anchor: str = "start", more: str = "") -> str:
    """Words at a place."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{more}>{escape(words)}</text>'


def _symbol(label: str) -> Markup:
    """`N_y [g]` with its index below the line."""
    symbol, bracket, unit = label.partition(" [")
    base, _, index = symbol.partition("_")
    if not index or not bracket:
        return escape(label)
    lowered = Markup('{}<tspan class="index" dy="2">{}</tspan><tspan dy="-2"> [{}</tspan>')
    return lowered.format(base, index, unit)
