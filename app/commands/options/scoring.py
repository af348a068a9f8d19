"""Options of the commands that score a file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from app.commands.options.option import option

if TYPE_CHECKING:  # slow to import, and not needed for help
    from app.assessment.segments import Interval, ScoringRecipe
    from app.recordings.scored_file import MappingMemory, ScoreRequest

TRIM_SEGMENT, NO_TRIM = "trim-segment", "none"
SETTINGS = "With --aircraft, FOREWARN_* variables set the data directory."


def add_scoring_options(parser: argparse.ArgumentParser) -> None:
    option(parser, "monitors MONITOR", "monitor files", type=Path, nargs="+")
    option(parser, "file FILE", "telemetry in any known format", type=Path)
    option(
        parser,
        "--epsilon E[,E...]",
        "accepted miss rates to compare; each monitor's own if absent",
        action="append",
        default=[],
    )
    option(
        parser,
        "--mapping FILE.json",
        "mapping of signals to channels; proposed by the program if absent",
        type=Path,
    )
    option(parser, "--rate '50 Hz[ from 12:31:05]'", "sample rate of a file without times")
    option(
        parser,
        "--aircraft NAME",
        "use the mapping stored for this aircraft; a given mapping is stored for it",
    )
    option(
        parser,
        "--trim SECONDS|trim-segment|none",
        "trim of each manoeuvre: the mean over this time before its first input",
        default=TRIM_SEGMENT,
    )
    option(
        parser,
        "--accept-useless",
        "score even with a monitor that alerts on nearly every safe flight",
    )
    option(
        parser,
        "--manoeuvres detected|entire|START:END,...",
        "found by control activity, the entire recording, or given times [s]",
        default="detected",
    )


def request_of(options: argparse.Namespace) -> tuple[ScoreRequest, MappingMemory | None]:
    """The request, and the memory of the aircraft's mapping if one is named."""
    from app.commands.output.scores import read_mapping
    from app.recordings.scored_file import ScoreRequest
    from app.telemetry.mapping.mapping import read_rate

    epsilons = tuple(map(_epsilon, ",".join(options.epsilon).split(","))) if options.epsilon else ()
    request = ScoreRequest(
        monitors=tuple(options.monitors),
        file=options.file,
        epsilons=epsilons or (None,),
        recipe=_recipe(options),
        mapping=None if options.mapping is None else read_mapping(options.mapping),
        rate=None if options.rate is None else read_rate(options.rate),
        accept_useless=options.accept_useless,
    )
    return request, _memory(options.aircraft) if options.aircraft else None


def _memory(aircraft: str) -> MappingMemory:
    from app.recordings.scored_file import MappingMemory
    from app.settings import read_settings

    return MappingMemory(read_settings(), aircraft)


def _epsilon(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"--epsilon {text!r}: write a miss rate between 0 and 1") from None


def _recipe(options: argparse.Namespace) -> ScoringRecipe:
    from app.assessment.segments import ScoringRecipe

    named = {TRIM_SEGMENT: "trim_segment", NO_TRIM: None}
    trim = named[options.trim] if options.trim in named else _seconds("--trim", options.trim)
    manoeuvres = options.manoeuvres
    if manoeuvres not in ("detected", "entire"):
        manoeuvres = tuple(map(_interval, manoeuvres.split(",")))
    return ScoringRecipe(trim=trim, manoeuvres=manoeuvres)


def _interval(text: str) -> Interval:
    from app.assessment.segments import Interval

    start, colon, end = text.partition(":")
    if not colon:
        raise ValueError(
            f"--manoeuvres {text!r}: write detected, entire, or START:END in seconds, separated by "
            "commas"
        )
    return Interval(_seconds("--manoeuvres", start), _seconds("--manoeuvres", end))


def _seconds(option: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        or_named = f", {TRIM_SEGMENT} or {NO_TRIM}" if option == "--trim" else ""
        raise ValueError(f"{option} {text!r}: write a number of seconds{or_named}") from None
