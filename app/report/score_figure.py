"""The figure of a scored recording: a self-contained SVG, or a PNG of it."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy.typing as npt
from markupsafe import escape

from app.assessment.limits_history import LimitPiece
from app.report.figures import every_strip
from app.report.strip_chart import WIDTH, StripChart

TALL, TOP = 72.0, 34.0
"""Height of a strip, and of the legend and names above the first [px]."""
TITLED = 20.0
"""Height above the chart for its title [px]."""
PIXELS = 2
"""Pixels of the figure per unit of the chart."""
SECONDS = 60.0
"""Time limit for drawing a PNG."""


class FlownManeuver(NamedTuple):
    """A manoeuvre of the recording. start, end [s].   exceedance: time of the first [s]."""

    name: str
    start: float
    end: float
    exceedance: float | None = None


class Drawing(NamedTuple):
    """An SVG file. width, height [px]."""

    svg: bytes
    width: int
    height: int


class NoPngError(ValueError):
    """No installed program draws a PNG."""


def score_figure(
    samples: npt.NDArray,
    maneuvers: Sequence[FlownManeuver],
    limits: Sequence[LimitPiece],
    alert_above: float,
    lead: float,
    title: str,
) -> Drawing:
    """Draw every channel, forecast and limit and the risk. lead [s]."""
    t = samples["t"]
    chart = StripChart(float(t[0]), float(t[-1]), top=TOP)
    intervals = [(maneuver.start, maneuver.end) for maneuver in maneuvers]
    exceedances = [m.exceedance for m in maneuvers if m.exceedance is not None]
    every_strip(chart, TALL, samples, limits, alert_above, lead, exceedances, intervals)
    chart.name([(maneuver.start, maneuver.name) for maneuver in maneuvers])
    return _alone(chart, title)


def png(drawing: Drawing) -> bytes:
    """Draw it with an installed program. NoPngError where there is none, or it fails."""
    root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    window = f"--window-size={drawing.width},{drawing.height}"
    page = ["--headless", "--disable-gpu", "--hide-scrollbars", *root, window]
    programs = {
        "rsvg-convert": ["-o", "figure.png", "figure.svg"],
        "inkscape": ["figure.svg", "--export-filename=figure.png"],
        "chromium": [*page, "--screenshot=figure.png", "figure.svg"],
        "google-chrome": [*page, "--screenshot=figure.png", "figure.svg"],
    }
    program = next(filter(shutil.which, programs), None)
    if program is None:
        raise NoPngError(
            f"no installed program draws a PNG: install one of {', '.join(programs)}, or use "
            "the SVG"
        )
    with TemporaryDirectory() as folder:
        (Path(folder) / "figure.svg").write_bytes(drawing.svg)
        command = [program, *programs[program]]
        try:
            subprocess.run(command, cwd=folder, capture_output=True, check=True, timeout=SECONDS)
            return (Path(folder) / "figure.png").read_bytes()
        except (subprocess.SubprocessError, OSError) as error:
            raise NoPngError(f"{program} drew no PNG: {error}; use the SVG") from error


def _alone(chart: StripChart, title: str) -> Drawing:
    """The chart as a file of its own, with its styles."""
    here = Path(__file__).parent
    style, hatch = (here / "chart.css").read_text(), (here / "hatch.svg").read_text()
    width, height = round(WIDTH * PIXELS), round((chart.height + TITLED) * PIXELS)
    box = f"0 {-TITLED:g} {WIDTH:g} {height / PIXELS:g}"
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="chart" width="{width}" height="{height}" '
        f'viewBox="{box}"><title>{escape(title)}</title><style>{style}</style>{hatch}'
        f'<rect y="{-TITLED:g}" width="100%" height="100%" fill="#ffffff"/>'
        f'<text x="{WIDTH / 2:g}" y="-6" text-anchor="middle">{escape(title)}</text>'
        f"{chart.content()}</svg>\n"
    )
    return Drawing(svg.encode(), width, height)
