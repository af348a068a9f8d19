"""The report of a scored flight: manoeuvres, alerts, guarantee and data quality."""

from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from app.assessment.limits_history import pieces_of
from app.assessment.outcome import OUTCOMES, begins_in_words, lead_words
from app.assessment.wording import PROMISED, alerts_above, amplitude_of
from app.recipes.labels import choice_label, kind_label
from app.recipes.recipes import to_plain
from app.report import facts, figures
from app.report.subject import PROPOSED, ReportSubject
from app.telemetry.mapping.mapping import TimeSource, counts_the_day, time_of_day
from core import __version__
from core.channels import Channel, Dictionary, significant
from core.counted import counted
from core.evaluation.certificate import certificate, warnings_of

CONFIDENT = 0.9
"""From this confidence on, a proposal is listed without its reasons."""
MOST_OUTSIDE = 20
"""Rows of exceedances outside every manoeuvre."""
MOST_LETTERS = 48
"""Longest name of a manoeuvre in a table."""
GLUE = "\N{NO-BREAK SPACE}"
"""Between a number and its unit."""
TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=StrictUndefined,
)


def report(subject: ReportSubject) -> str:
    monitor, scoring, recording = subject.monitor, subject.scoring, subject.recording
    dictionary, in_force = monitor.dictionary, scoring.get("limits_in_force")
    pieces = pieces_of(dictionary, monitor.envelope, in_force)
    manoeuvres, epsilon = scoring["manoeuvres"], scoring["epsilon"]
    limits = facts.limited(dictionary, monitor.specification)
    rows = facts.limits_in_force(dictionary, in_force or [], manoeuvres)
    ends = [*limits, *(limit for row in rows for limit in row["limits"])]
    outside = scoring["outside_exceedances"]
    drawn, above = facts.drawn(manoeuvres), monitor.alert_above(epsilon)
    valid = [manoeuvre["validity"]["valid"] for manoeuvre in manoeuvres]
    quality = scoring["quality"] or {"sentences": []}
    sentences = quality["sentences"]
    return TEMPLATES.get_template("report.html").render(
        vars(subject),
        manoeuvres=manoeuvres,
        recipe=to_plain(monitor.recipe),
        certificate=certificate(monitor.evaluation, epsilon),
        warnings=warnings_of(monitor.evaluation, epsilon),
        limits=[
            (channel, low, high, facts.exceeded_own(manoeuvres, channel.key, low, high))
            for channel, low, high in limits
        ],
        either_sign=", either sign" if all(low == -high for _, low, high in ends) else "",
        in_force=rows,
        look_ahead=max((s.get("look_ahead", 0.0) for s in manoeuvres), default=0.0),
        headline=facts.headline(manoeuvres, outside),
        of_day=_counts_the_day(scoring["mapping"]),
        outside=outside,
        most_outside=MOST_OUTSIDE,
        proposed=subject.mapped == PROPOSED,
        alerts_above=alerts_above(epsilon, above, monitor.recipe.guarantee),
        promise=PROMISED[monitor.recipe.guarantee],
        worst=facts.worst(manoeuvres),
        counts=facts.counts(manoeuvres),
        promised=valid.count(True),
        withdrawn=valid.count(False),
        unchecked=valid.count(None),
        outcomes=OUTCOMES,
        alerts=facts.alerts(manoeuvres),
        mapping=facts.mapping_rows(scoring["mapping"], subject.rationales, monitor.dictionary),
        confident=CONFIDENT,
        sentences=facts.notes(sentences),
        notes=facts.notes(
            recording["ignored"], recording["notes"], scoring["notes"], apart_from=sentences
        ),
        faults=figures.faults(scoring["quality"]),
        sensors=quality.get("compatibility", []),
        tolerances=quality.get("compatibility_tolerances", ""),
        overview=figures.overview(dictionary, subject.samples, manoeuvres, pieces, above),
        figures={
            number: figures.manoeuvre(
                dictionary, subject.samples, manoeuvres[number], pieces, above, monitor.lead
            )
            for number in drawn
        },
        version=__version__,
        channels=dictionary.by_key,
        dictionary=dictionary,
    )


def _counts_the_day(mapping: Mapping[str, Any]) -> bool:
    """Whether times are seconds of the day. mapping: plain data."""
    return counts_the_day(
        TimeSource(rate=given.get("rate", 0.0), start=given.get("start", 0.0))
        for given in mapping["times"].values()
    )


def _symbol(symbol: str) -> Markup:
    """`N_y` with a subscript."""
    base, _, index = symbol.partition("_")
    return Markup("{}<sub>{}</sub>").format(base, index) if index else Markup(escape(base))


def _quantity(value: float, channel: Channel) -> str:
    return _glued(channel.read(value))


def limits_in_words(low: float, high: float, channel: Channel) -> str:
    """`0.5 g` for either sign, `−1.4 g to 4.9 g`, `at most 4.9 g`."""
    if low == -high:
        return _quantity(high, channel)
    if low == -inf:
        return f"at most {_quantity(high, channel)}"
    if high == inf:
        return f"at least {_quantity(low, channel)}"
    return f"{_quantity(low, channel)} to {_quantity(high, channel)}"


def _glued(text: str) -> str:
    """A number with its unit on one line; only its bracket may move to the next."""
    return text.replace(" ", GLUE).replace(f"{GLUE}(", " (").replace("-", "−")


def _interval(estimate: Mapping[str, float] | None, channel: Channel | None = None) -> str:
    """`0.95 (0.93 to 0.97)`; `0.1 (0 to 0.2) g` of a channel; a dash for None."""
    if estimate is None:
        return "–"
    factor, unit = (channel.display_factor, channel.display_unit) if channel else (1.0, "")
    value, low, high = (significant(factor * estimate[name]) for name in ("value", "low", "high"))
    return _glued(f"{value} ({low} to {high}) {unit}".strip())


def _delay(estimate: Mapping[str, float] | None) -> str:
    """`0.010 (0.008 to 0.011)`: to milliseconds [s]; a dash for None."""
    if estimate is None:
        return "–"
    value, low, high = (f"{estimate[name]:.3f}" for name in ("value", "low", "high"))
    return _glued(f"{value} ({low} to {high})")


def _trimmed(trim: Sequence[float | None], dictionary: Dictionary) -> list[tuple[Channel, float]]:
    channels = zip(dictionary.channels, trim, strict=True)
    return [(channel, value) for channel, value in channels if value]


TEMPLATES.filters |= {
    "symbol": _symbol,
    "time": lambda t: f"{t:.2f}",
    "time_of_day": time_of_day,
    "ahead": lead_words,
    "seconds": lambda t: f"{t:.2f}{GLUE}s",
    "span": lambda begin, end: f"{begin:.2f} to {end:.2f}{GLUE}s",
    "percent": lambda share: f"{share:.1%}",
    "significant": significant,
    "quantity": _quantity,
    "limits": limits_in_words,
    "counted": counted,
    "interval": _interval,
    "delay": _delay,
    "outcome_of": facts.outcome_of,
    "begins": begins_in_words,
    "amplitude_of": lambda s: amplitude_of(s["outcome"], s.get("amplitude")),
    "short": lambda name: name if len(name) <= MOST_LETTERS else f"{name[:MOST_LETTERS]}…",
    "kind": kind_label,
    "choice": lambda value, parameter: choice_label(parameter, value),
    "trimmed": _trimmed,
    "moment": lambda utc: f"{utc[:16].replace('T', ' ')} UTC",
    "megabytes": lambda size: f"{size / 1e6:.3g} MB" if size >= 1e5 else f"{size} bytes",
}
