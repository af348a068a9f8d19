"""Options that declare the flight condition of a monitor set."""

from __future__ import annotations

import argparse

from app.commands.options.option import option
from core.conditions import CONDITION_KEYS, CONDITIONS, ConditionKey, check_declared
from core.recipe import instead_of


def add_condition(parser: argparse.ArgumentParser) -> None:
    option(
        parser,
        "--condition KEY=VALUE",
        "with a monitor set: declared flight condition, such as mach=0.6 or "
        f"altitude=30000ft: {', '.join(CONDITION_KEYS)}",
        action="append",
        default=[],
    )


def declared_of(options: argparse.Namespace) -> dict[ConditionKey, float]:
    """The declared flight condition, in SI units. ValueError."""
    if options.condition and not options.monitor_set:
        raise ValueError("--condition is for a monitor set: give --monitor-set too")
    declared = dict(map(_declared, options.condition))
    check_declared(declared)
    return declared


def _declared(text: str) -> tuple[ConditionKey, float]:
    """Key and value in SI units of `altitude=30000ft`. ValueError."""
    import numpy as np  # slow to import

    from app.telemetry.limit_texts import VALUE
    from app.telemetry.recording import TelemetryError
    from app.telemetry.units import PLAIN, convert

    key, _, value = text.partition("=")
    known = next((each for each in CONDITIONS.values() if each.key == key.strip()), None)
    match = VALUE.fullmatch(value.strip())
    if known is None or match is None:
        wrong = instead_of(key.strip(), CONDITIONS) if known is None else "write a number"
        raise ValueError(f"--condition {text!r}: {wrong}, such as altitude=30000ft or mach=0.6")
    unit = known.unit or PLAIN
    try:
        return known.key, float(convert(np.array([float(match[1])]), match[2] or unit, unit)[0])
    except TelemetryError as error:
        raise ValueError(f"--condition {text!r}: {error}") from None
