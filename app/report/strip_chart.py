"""Strip charts over one axis, usually time, as SVG inside a page.

This module makes the geometry; colours, widths and dashes are classes of chart.css.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import ceil, floor, log10
from pathlib import Path

import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape

from app.assessment.outcome import runs
from core.types import Array

WIDTH, LEFT, RIGHT = 680.0, 60.0, 14.0
"""Width of a chart, and the usual margins left and right of its strips [px]."""
TOP, BETWEEN, BOTTOM = 22.0, 9.0, 30.0
LETTER = 5.0
"""Approximate width of a letter [px]."""
TURNED = 30.0
"""From this height on, a strip's label is rotated [px]."""
MARGIN = 0.06
"""Share of a strip's range left free above and below."""
Intervals = Iterable[tuple[float, float]]
"""From, to [s]."""
TITLED, PIXELS = 20.0, 2
"""Height above a chart for its title [px]; pixels of a file per unit of the chart."""
TRIANGLE, STROKE, CROSS = "l-3.5-6h7z", "m-5 0h10", "m-4-4l8 8m-8 0l8-8"
STYLE = (Path(__file__).parent / "chart.css").read_text()
DOT = "m-3 0a3 3 0 1 0 6 0a3 3 0 1 0-6 0z"
BINS = 1200
"""Columns of a trace; paper shows no more."""


class Strip:
    """A strip of a chart, showing values from `low` to `high`."""

    def __init__(self, chart: "StripChart", top: float, height: float, label: str) -> None:
        self.chart, self.top, self.height, self.label = chart, top, height, label
        self.low, self.high = 0.0, 1.0
        self.ticks: list[tuple[float, str]] = []
        self._parts: list[str] = []

    def show(self, *values: npt.ArrayLike) -> None:
        """Set the range to hold all these values, with about four ticks."""
        flat = np.concatenate([np.ravel(np.asarray(each, np.float64)) for each in values])
        known = flat[np.isfinite(flat)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
        spread = high - low or abs(high) or 1.0
        self.low, self.high = low - MARGIN * spread, high + MARGIN * spread
        self.ticks = list(ticks(self.low, self.high, 4))

    def line(self, kind: str, t: Array, values: Array) -> None:
        """A trace, broken where a value is missing or outside the chart."""
        t, values = envelope(t, values)
        inside = np.isfinite(values) & (t >= self.chart.start) & (t <= self.chart.end)
        x, y = self.chart.x(t), self.y(values)
        path = [
            "M" + "L".join(f"{x[k]:.1f} {y[k]:.1f}" for k in range(first, last + 1))
            for first, last in runs(inside)
        ]
        self._draw(kind, path)

    def levels(self, kind: str, values: Iterable[float]) -> None:
        self.steps(kind, [(self.chart.start, self.chart.end, value) for value in values])

    def steps(self, kind: str, values: Iterable[tuple[float, float, float]]) -> None:
        """A horizontal line at each (start [s], end [s], value)."""
        path = []
        for start, end, value in values:
            first, last = max(start, self.chart.start), min(end, self.chart.end)
            if first < last:
                left, right = self.chart.x(np.array([first, last])).tolist()
                y = float(self.y(np.array([value]))[0])
                path.append(f"M{left:.1f} {y:.1f}H{right:.1f}")
        self._draw(kind, path)

    def moments(self, kind: str, times: Iterable[float]) -> None:
        at = self.chart.x(np.array([*times], np.float64)).tolist()
        self._draw(kind, [f"M{x:.1f} {self.top:.1f}v{self.height:.1f}" for x in at])

    def fill(self, kind: str, intervals: Intervals, least: float = 0.0) -> None:
        """Fill the height over time intervals. least: smallest width [px]."""
        sides = self.chart.x(np.array([*intervals], np.float64).reshape(-1, 2)).tolist()
        boxes = [
            f"M{left:.1f} {self.top:.1f}H{max(right, left + least):.1f}"
            f"v{self.height:.1f}H{left:.1f}z"
            for left, right in sides
        ]
        self._draw(kind, boxes)

    def marks(self, kind: str, t: Array, values: Array, shape: str = TRIANGLE) -> None:
        """A mark at each sample. shape: its path from there."""
        points = zip(self.chart.x(t), self.y(values), strict=True)
        self._draw(kind, [f"M{x:.1f} {y:.1f}{shape}" for x, y in points])

    def y(self, values: Array) -> Array:
        return self.top + (self.high - values) / (self.high - self.low) * self.height

    def svg(self, times: Sequence[tuple[float, str]]) -> Iterator[str]:
        """Grid, traces, frame and labels."""
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

    start, end: of the axis, usually time [s].   left, top: margins of the strips [px].
    axis: its label.
    """

    def __init__(
        self,
        start: float,
        end: float,
        left: float = LEFT,
        top: float = TOP,
        axis: str = "t [s]",
    ) -> None:
        self.start, self.end = start, end if end > start else start + 1.0
        self.left, self.top, self.axis = left, top, axis
        self._strips: list[Strip] = []
        self._words: list[str] = []
        self._bottom = top

    def x(self, t: Array) -> Array:
        width = WIDTH - RIGHT - self.left
        return self.left + (t - self.start) / (self.end - self.start) * width

    def strip(self, height: float, label: str = "") -> Strip:
        """Add a strip. label: `N_y [g]`."""
        strip = Strip(self, self._bottom, height, label)
        self._strips.append(strip)
        self._bottom += height + BETWEEN
        return strip

    def explain(self, kinds: Iterable[tuple[str, str]]) -> None:
        """Add a legend above the strips: (kind, words) of each line."""
        x = self.left
        for kind, words in kinds:
            self._words.append(f'<path class="{kind}" d="M{x:g} 9h20"/>')
            self._words.append(_text(x + 24, 12, words))
            x += 24 + LETTER * (len(words) + 3)

    def name(self, names: Sequence[tuple[float, str]]) -> None:
        """Write names above the first strip, each from its time [s] on, in order.

        If one does not fit, all become numbers, and numbers that do not fit are left out.
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
        """The chart as an element. title: for screen readers."""
        return Markup(
            f'<svg class="chart" viewBox="0 0 {WIDTH:g} {self.height:.0f}" role="img" '
            f'aria-label="{escape(title)}">{self.content()}</svg>'
        )

    def file(self, title: str) -> bytes:
        """The chart as a separate SVG file, with its styles and a title above it."""
        hatch = (Path(__file__).parent / "hatch.svg").read_text()
        width, height = round(WIDTH * PIXELS), round((self.height + TITLED) * PIXELS)
        box = f"0 {-TITLED:g} {WIDTH:g} {height / PIXELS:g}"
        svg = (
            f'<svg xmlns="http://www.w3.org/2000/svg" class="chart" width="{width}" '
            f'height="{height}" viewBox="{box}"><title>{escape(title)}</title>'
            f"<style>{STYLE}</style>{hatch}"
            f'<rect y="{-TITLED:g}" width="100%" height="100%" fill="#ffffff"/>'
            f"{_text(WIDTH / 2, -6, title, 'middle')}{self.content()}</svg>\n"
        )
        return svg.encode()

    @property
    def height(self) -> float:
        """Height of the whole chart [px]."""
        return self._bottom - BETWEEN + BOTTOM

    def content(self) -> str:
        """The drawing without the element around it."""
        labels = list(ticks(self.start, self.end, 8))
        places = self.x(np.array([t for t, _ in labels])).tolist()
        times = list(zip(places, (text for _, text in labels), strict=True))
        axis = [_text(x, self.height - 18, text, "middle") for x, text in times]
        axis.append(_text((self.left + WIDTH - RIGHT) / 2, self.height - 4, self.axis, "middle"))
        strips = [part for strip in self._strips for part in strip.svg(times)]
        return "".join(strips + axis + self._words)


def styled(chart: Markup) -> str:
    """A chart with its styles, for a page that has none of them."""
    return f"<style>{STYLE}</style>{chart}"


def ticks(low: float, high: float, n: int) -> Iterator[tuple[float, str]]:
    """About n round values between low and high, with their axis labels."""
    rough = (high - low) / n
    power = 10.0 ** floor(log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough * 0.999)
    digits = max(0, -floor(log10(step) + 1e-9))
    for k in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1):
        yield k * step, f"{k * step:.{digits}f}".replace("-", "−")


def _text(x: float, y: float, words: str, anchor: str = "start", more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{more}>{escape(words)}</text>'


def _symbol(label: str) -> Markup:
    """`N_y [g]` with a subscript."""
    symbol, bracket, unit = label.partition(" [")
    base, _, index = symbol.partition("_")
    if not index or not bracket:
        return escape(label)
    lowered = Markup('{}<tspan class="index" dy="2">{}</tspan><tspan dy="-2"> [{}</tspan>')
    return lowered.format(base, index, unit)


def envelope(t: Array, values: Array, bins: int = BINS) -> tuple[Array, Array]:
    """The lowest and the highest value of each bin, in order of time. t, values: (n,)."""
    if len(t) <= 2 * bins:
        return t, values
    size = -(-len(t) // bins)
    whole = len(t) // size * size
    blocks = values[:whole].reshape(-1, size)
    at = np.arange(len(blocks)) * size
    low = np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1) + at
    high = np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1) + at
    order = np.sort(np.concatenate([low, high, np.arange(whole, len(t))]), kind="stable")
    return t[order], values[order]
