"""The report: what was flown, what the monitor said, and what that is worth."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees
from pathlib import Path
from typing import Any

import numpy.typing as npt
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from app.recipes import from_plain, to_plain
from app.report import figures
from core import __version__
from core.channels import CHANNELS, KEYS
from core.evaluation import clopper_pearson
from core.monitor import Monitor
from core.specification import Limits

OUTCOMES = {
    "timely_alert": ("▲", "alert in time", "good"),
    "late_alert": ("▲", "alert too late", "bad"),
    "missed": ("✕", "missed: no alert before the limit", "bad"),
    "false_alert": ("△", "alert, limit not reached", "caution"),
    "quiet": ("●", "no alert, limit not reached", "good"),
    "invalid": ("▨", "no verdict: outside what the monitor knows", "invalid"),
}
"""Sign, words and level of each outcome."""
MOST_FIGURES = 20
"""Manoeuvres that are drawn one by one."""
TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=StrictUndefined,
)


@dataclass(frozen=True, eq=False)
class ReportSubject:
    """Everything a report is about, in plain data but for the monitor and the samples.

    recording: name, digest, size, format, aircraft, start, n_bad_rows, bad_rows, notes.
    scoring: a stored scoring (see app.scoring) with mapping, epsilon, stretches, notes, quality.
    evaluation: what fresh flights said of the monitor, None if it was not tested.
    samples: as stored.   markers: of the user: t, end, kind, text.
    """

    recording: Mapping[str, Any]
    scoring: Mapping[str, Any]
    monitor: Monitor
    monitor_name: str
    monitor_digest: str
    evaluation: Mapping[str, Any] | None
    samples: npt.NDArray
    markers: Sequence[Mapping[str, Any]] = field(default=())


def report(subject: ReportSubject) -> str:
    """Return the report as HTML that needs no other file."""
    monitor, scoring = subject.monitor, subject.scoring
    plain = monitor.dataset_recipe.get("specification", {})
    limits = from_plain(Limits(), plain, "specification").magnitudes
    stretches = scoring["stretches"]
    drawn = stretches[:MOST_FIGURES]
    return TEMPLATES.get_template("report.html").render(
        recording=subject.recording,
        scoring=scoring,
        markers=subject.markers,
        monitor={
            "name": subject.monitor_name,
            "digest": subject.monitor_digest,
            "recipe": to_plain(monitor.recipe),
            "test": monitor.dataset_recipe,
            "n_unsafe": monitor.n_unsafe,
            "n_early": monitor.n_early,
            "lead": monitor.lead,
            "dt": monitor.dt,
            "version": monitor.version,
            "dataset_digest": monitor.dataset_digest,
        },
        certificate=certificate(subject.evaluation, scoring["epsilon"]),
        limits=[
            {"channel": channel, "limit": float(limit)}
            for channel, limit in zip(CHANNELS, limits, strict=True)
            if limit < float("inf")
        ],
        counts=counts(stretches),
        unchecked=sum(stretch["validity"]["valid"] is None for stretch in stretches),
        outcomes=OUTCOMES,
        alerts=alerts(stretches),
        mapping=mapping_rows(scoring["mapping"]),
        overview=_embedded(
            figures.overview(subject.samples, stretches, limits, scoring["epsilon"])
        ),
        figures=[
            (
                stretch,
                _embedded(
                    figures.manoeuvre(
                        subject.samples, stretch, limits, scoring["epsilon"], monitor.lead
                    )
                ),
            )
            for stretch in drawn
        ],
        not_drawn=len(stretches) - len(drawn),
        version=__version__,
        channels={channel.key: channel for channel in CHANNELS},
    )


def counts(stretches: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """How many manoeuvres came to each outcome."""
    return {name: sum(s["outcome"] == name for s in stretches) for name in OUTCOMES}


def alerts(stretches: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Every alert with the time it left before the limit, None where that was not reached after."""
    rows = []
    for stretch in stretches:
        crossing = stretch["crossing"]
        for begin, end in stretch["alerts"]:
            lead = crossing["t"] - begin if crossing and crossing["t"] >= begin else None
            rows.append({"stretch": stretch["name"], "start": begin, "end": end, "lead": lead})
    return rows


def certificate(evaluation: Mapping[str, Any] | None, epsilon: float) -> dict[str, Any] | None:
    """What fresh simulated flights said at this epsilon, or at the nearest one they were asked.

    None where the monitor was not tested, or on no failing flight.
    """
    if evaluation is None or not evaluation["n_unsafe"]:
        return None
    curves = evaluation["curves"]
    asked = [*curves["epsilon"], evaluation["epsilon"]]
    nearest = min(range(len(asked)), key=lambda i: abs(asked[i] - epsilon))
    at = evaluation["at_epsilon"]
    row = {
        key: at[key] if nearest == len(asked) - 1 else curves[key][nearest]
        for key in ("misses", "false_alerts")
    }
    n_unsafe, n_safe = evaluation["n_unsafe"], evaluation["n_safe"]
    alerted = n_unsafe - row["misses"]
    return {
        "epsilon": asked[nearest],
        "miss": _share(row["misses"], n_unsafe),
        "power": _share(n_safe - row["false_alerts"], n_safe),
        "fail_given_alert": _share(alerted, alerted + row["false_alerts"]),
    }


def mapping_rows(mapping: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One row a channel with what it was read from, None where it is missing."""
    channels = mapping["channels"]
    keys = [*KEYS, *(key for key in channels if key not in KEYS)]
    return [{"key": key, "source": channels.get(key)} for key in keys]


def _share(count: int, total: int) -> dict[str, Any] | None:
    if not total:
        return None
    low, high = clopper_pearson(count, total)
    share = {"count": count, "total": total, "share": count / total}
    return share | {"low": float(low), "high": float(high)}


def _embedded(svg: bytes) -> str:
    return f"data:image/svg+xml;base64,{base64.b64encode(svg).decode()}"


def _symbol(symbol: str) -> Markup:
    """`N_y` with its index below the line."""
    base, _, index = symbol.partition("_")
    return Markup("{}<sub>{}</sub>").format(base, index) if index else Markup(escape(base))


def _with_degrees(value: float, unit: str) -> str:
    """`0.0873 rad (5°)`: what is computed with, and what is read."""
    text = f"{value:.4g} {unit}".strip().replace("-", "−")
    if unit.startswith("rad"):
        return f"{text} ({degrees(value):.3g}°{unit.removeprefix('rad')})"
    return text


TEMPLATES.filters |= {
    "symbol": _symbol,
    "seconds": lambda t: f"{t:.2f} s",
    "percent": lambda share: f"{share:.1%}",
    "significant": lambda number: f"{number:.3g}",
    "quantity": _with_degrees,
    "megabytes": lambda size: f"{size / 1e6:.3g} MB" if size >= 1e5 else f"{size} bytes",
}
