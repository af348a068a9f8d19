"""Figures of reports and scores: entire recording, each manoeuvre, data faults."""

import os
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from app.assessment import sample_type
from app.assessment.limits_history import LimitPiece, pieces_of
from app.assessment.outcome import runs
from app.report.strip_chart import Strip, StripChart
from core.channels import Channel, Dictionary
from core.monitor import Monitor
from core.monitor.assessment import STATES, State
from core.types import Array

Plain = Mapping[str, Any]
INVALID = STATES.index(State.INVALID)
TALL, LOW, LOWEST = 64.0, 52.0, 9.0
"""Heights of strips in the overview, of a manoeuvre, and of the data's faults [px]."""
MOST_STRIPS = 12
"""Most channels drawn for one manoeuvre."""
FAULTS = {
    "gap": "gaps",
    "clock": "clock jumps",
    "repeated": "repeated",
    "reordered": "out of order",
    "missing": "missing",
    "frozen": "frozen",
    "implausible": "implausible",
}
"""Kinds of faults in words, in the order of their strips."""
MOST_FAULTS = 20
LABELS = 110.0
"""Width of the labels next to the strips [px]."""
LEAST = 1.5
"""Smallest width of a fault [px]."""


def overview(
    dictionary: Dictionary,
    samples: npt.NDArray,
    manoeuvres: Sequence[Plain],
    limits: Sequence[LimitPiece],
    alert_above: float,
) -> Markup:
    """Limited channels and risk of the entire recording, with its manoeuvres."""
    t = samples["t"]
    chart = StripChart(float(t[0]), float(t[-1]))
    intervals = [(manoeuvre["start"], manoeuvre["end"]) for manoeuvre in manoeuvres]
    for c in _limited(limits) or list(dictionary.of_role("output")[-1:]):
        channel = dictionary.channels[c]
        strip, y = chart.strip(TALL, _label(channel)), _shown(samples["y"], channel, c)
        strip.show(y, *_levels(channel, c, limits))
        strip.fill("manoeuvre", intervals)
        strip.line("measured", t, y)
        _draw_limits(strip, channel, c, limits)
    risk_strip(chart, TALL, samples, alert_above, intervals)
    chart.name([(manoeuvre["start"], manoeuvre["name"]) for manoeuvre in manoeuvres])
    return chart.svg("The limited channels and the risk over the entire recording")


def manoeuvre(
    dictionary: Dictionary,
    samples: npt.NDArray,
    manoeuvre: Plain,
    limits: Sequence[LimitPiece],
    alert_above: float,
    lead: float,
) -> Markup:
    """Channels of one manoeuvre with forecasts and limits, and the risk below."""
    part = samples[manoeuvre["first"] : manoeuvre["last"] + 1]
    chart = StripChart(float(part["t"][0]), float(part["t"][-1]))
    exceedance = [manoeuvre["exceedance"]["t"]] if manoeuvre["exceedance"] else []
    every_strip(dictionary, chart, LOW, part, limits, alert_above, lead, exceedance)
    return chart.svg(f"Channels, forecasts, limits and risk of {manoeuvre['name']}")


def faults(quality: Plain | None) -> Markup | None:
    """One strip for each kind of data fault; None without faults.

    quality: plain, as app.telemetry.timing.quality.
    """
    if not quality or not quality["faults"] or not quality["clocks"]:
        return None
    start = min(clock["start"] for clock in quality["clocks"])
    end = max(clock["end"] for clock in quality["clocks"])
    chart = StripChart(start, end, LABELS)
    kinds = groupby(sorted(quality["faults"], key=_order), lambda fault: str(fault["kind"]))
    for _, (kind, recorded) in zip(range(MOST_FAULTS), kinds, strict=False):
        name, _, channel = kind.partition(":")
        words = FAULTS.get(name, name)
        strip = chart.strip(LOWEST, f"{channel} {words}" if channel else words)
        strip.fill("fault", [(fault["start"], fault["end"]) for fault in recorded], LEAST)
    return chart.svg(
        "Where the recording has gaps, repeated, missing, frozen or implausible samples"
    )


def every_strip(
    dictionary: Dictionary,
    chart: StripChart,
    height: float,
    samples: npt.NDArray,
    limits: Sequence[LimitPiece],
    alert_above: float,
    lead: float,
    exceedances: Sequence[float],
    intervals: Sequence[tuple[float, float]] = (),
) -> None:
    """A legend, the channels and the risk, with each exceedance [s] and its last timely alert.

    At most MOST_STRIPS channels: the limited ones, then controls, then the others.
    """
    chart.explain(
        [
            ("measured", "measured" if dictionary.absolute else "measured, from trim"),
            ("forecast", f"predicted {lead:g} s ahead"),
            ("limit", "limit"),
            *(
                [("exceedance", "limit exceeded"), ("late", "last timely alert")]
                * bool(exceedances)
            ),
        ]
    )
    strips = [
        channel_strip(dictionary.channels[c], c, chart, height, samples, limits, lead, intervals)
        for c in _drawn(dictionary, limits)
    ]
    for strip in (*strips, risk_strip(chart, height, samples, alert_above, intervals)):
        strip.moments("exceedance", exceedances)
        strip.moments("late", [t - lead for t in exceedances])


def channel_strip(
    channel: Channel,
    c: int,
    chart: StripChart,
    height: float,
    samples: npt.NDArray,
    limits: Sequence[LimitPiece],
    lead: float,
    intervals: Sequence[tuple[float, float]] = (),
) -> Strip:
    """One channel, number c: measured, forecast (at the time it is for) and limits.

    intervals: shaded.
    """
    t, y, y_hat = samples["t"], *(_shown(samples[of], channel, c) for of in ("y", "y_hat"))
    strip = chart.strip(height, _label(channel))
    strip.show(y, y_hat[t + lead <= t[-1]], *_levels(channel, c, limits, chart.start, chart.end))
    strip.fill("manoeuvre", intervals)
    strip.line("forecast", t + lead, y_hat)
    strip.line("measured", t, y)
    _draw_limits(strip, channel, c, limits)
    return strip


def risk_strip(
    chart: StripChart,
    height: float,
    samples: npt.NDArray,
    alert_above: float,
    intervals: Sequence[tuple[float, float]] = (),
) -> Strip:
    """The risk: grey where withdrawn, hatched where a manoeuvre has none."""
    strip = chart.strip(height, "risk")
    t = samples["t"]
    strip.show([0.0, 1.0])
    alerts = runs(samples["alert"])
    silent = runs((samples["state"] == INVALID) & (samples["manoeuvre"] >= 0))
    strip.fill("manoeuvre", intervals)
    strip.fill("silent", [(t[begin], t[end]) for begin, end in silent])
    strip.fill("alert", [(t[begin], t[end]) for begin, end in alerts])
    strip.levels("epsilon", [alert_above])
    strip.line("withdrawn", t, samples["withdrawn"])
    strip.line("measured", t, samples["p_value"])
    begins = [begin for begin, _ in alerts]
    strip.marks("mark", t[begins], samples["p_value"][begins])
    return strip


def _limited(limits: Sequence[LimitPiece]) -> list[int]:
    """Channels with a limit at any time."""
    return np.flatnonzero(np.any([piece.limits.limited for piece in limits], axis=0)).tolist()


def _drawn(dictionary: Dictionary, limits: Sequence[LimitPiece]) -> list[int]:
    """Channels that are drawn, in order."""
    order = (*_limited(limits), *dictionary.of_role("control"), *range(len(dictionary)))
    return sorted(list(dict.fromkeys(order))[:MOST_STRIPS])


def _shown(y: Array, channel: Channel, c: int) -> Array:
    return y[:, c] * channel.display_factor


def _levels(
    channel: Channel,
    c: int,
    limits: Sequence[LimitPiece],
    start: float = -np.inf,
    end: float = np.inf,
) -> list[float]:
    """Limits of a channel between two times [s], in its display unit, from the highest."""
    here = [piece.limits for piece in limits if piece.start <= end and piece.end >= start]
    ends = np.array([end for envelope in here for end in (envelope.low[c], envelope.high[c])])
    return (np.unique(ends[np.isfinite(ends)])[::-1] * channel.display_factor).tolist()


def _draw_limits(strip: Strip, channel: Channel, c: int, limits: Sequence[LimitPiece]) -> None:
    levels = [(p.start, p.end, level) for p in limits for level in _levels(channel, c, [p])]
    strip.steps("limit", levels)


def _label(channel: Channel) -> str:
    return f"{channel.symbol} [{channel.display_unit}]"


def _order(fault: Plain) -> tuple[int, str, float]:
    name, known = fault["kind"].partition(":")[0], list(FAULTS)
    return known.index(name) if name in known else len(known), fault["kind"], fault["start"]


class NoPngError(ValueError):
    """No installed program draws a PNG."""


def score_figure(
    dictionary: Dictionary,
    samples: npt.NDArray,
    manoeuvres: Sequence[Plain],
    limits: Sequence[LimitPiece],
    alert_above: float,
    lead: float,
    title: str,
) -> bytes:
    """Channels, forecasts, limits and the risk as an SVG file. lead [s]."""
    t = samples["t"]
    chart = StripChart(float(t[0]), float(t[-1]), top=34.0)
    intervals = [(manoeuvre["start"], manoeuvre["end"]) for manoeuvre in manoeuvres]
    exceedances = [m["exceedance"]["t"] for m in manoeuvres if m["exceedance"]]
    every_strip(dictionary, chart, TALL, samples, limits, alert_above, lead, exceedances, intervals)
    chart.name([(manoeuvre["start"], manoeuvre["name"]) for manoeuvre in manoeuvres])
    return chart.file(title)


def flown_figure(monitor: Monitor, y: Array, fail_index: int, title: str) -> bytes:
    """A simulated flight (n, n_channels) with its forecasts and the risk as an SVG file.

    fail_index: first sample beyond a limit, n for none.
    """
    assessments = monitor.assess(monitor.dt * np.arange(len(y)), y)
    samples = np.zeros(len(y), sample_type(y.shape[1]))
    samples["y"], samples["withdrawn"] = y, np.nan
    for name in ("t", "y_hat", "p_value", "alert", "state"):
        samples[name] = getattr(assessments, name)
    limits = list(pieces_of(monitor.dictionary, monitor.envelope, None))
    failures = samples["t"][fail_index : fail_index + 1].tolist()
    chart = StripChart(0.0, float(samples["t"][-1]), top=34.0)
    about = limits, monitor.alert_above(), monitor.lead, failures
    every_strip(monitor.dictionary, chart, TALL, samples, *about)
    return chart.file(title)


def png(svg: bytes) -> bytes:
    """A score figure as PNG, drawn by an installed program. NoPngError without one."""
    width, height = re.findall(r' (?:width|height)="(\d+)"', svg.decode())[:2]
    root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    window = f"--window-size={width},{height}"
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
        (Path(folder) / "figure.svg").write_bytes(svg)
        command = [program, *programs[program]]
        try:
            subprocess.run(command, cwd=folder, capture_output=True, check=True, timeout=60)
            return (Path(folder) / "figure.png").read_bytes()
        except (subprocess.SubprocessError, OSError) as error:
            raise NoPngError(f"{program} drew no PNG: {error}; use the SVG") from error
