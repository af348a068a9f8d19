"""Options of the command line that say which file is scored by what, and how."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # slow to import, and not needed for help
    from app.recordings.mapping_memory import MappingMemory
    from app.recordings.scored_file import ScoreRequest
    from app.scoring.recipe import Interval, ScoringRecipe

TRIM_SEGMENT, NO_TRIM = "trim-segment", "none"
SETTINGS = "Settings of the data directory, for --aircraft, come from FOREWARN_*."


def add_scoring_options(parser: argparse.ArgumentParser) -> None:
    """Add what says which file is scored by what, and how."""
    parser.add_argument("monitors", type=Path, nargs="+", metavar="MONITOR", help="monitor files")
    parser.add_argument("file", type=Path, metavar="FILE", help="telemetry in any format read")
    parser.add_argument(
        "--epsilon",
        action="append",
        default=[],
        metavar="E[,E...]",
        help="accepted miss rates, side by side; each monitor's own if absent",
    )
    parser.add_argument(
        "--mapping",
        type=Path,
        metavar="FILE.json",
        help="which signal is which channel",
    )
    parser.add_argument(
        "--rate",
        metavar="'50 Hz[ from 12:31:05]'",
        help="of the rows, where the file has no times",
    )
    parser.add_argument(
        "--aircraft", metavar="NAME", help="use the mapping kept for it, and keep the one given"
    )
    parser.add_argument(
        "--trim",
        default=TRIM_SEGMENT,
        metavar="SECONDS|trim-segment|none",
        help="what each manoeuvre is measured from: the mean of so much before its first input",
    )
    parser.add_argument(
        "--accept-useless",
        action="store_true",
        help="score by a monitor alone that alerts on nearly every safe flight",
    )
    parser.add_argument(
        "--manoeuvres",
        default="detected",
        metavar="detected|entire|START:END,...",
        help="detected by control activity, the recording as one, or between times [s]",
    )


def request_of(options: argparse.Namespace) -> tuple[ScoreRequest, MappingMemory | None]:
    """What the options ask for, and the memory of the aircraft where one is named."""
    from app.commands.output.mapping_lines import read_mapping
    from app.recordings.scored_file import ScoreRequest
    from app.telemetry.mapping.typed_rate import read_rate

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
    from app.recordings.mapping_memory import MappingMemory
    from app.settings import read_settings

    return MappingMemory(read_settings(), aircraft)


def _epsilon(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"--epsilon {text!r}: write a miss rate between 0 and 1") from None


def _recipe(options: argparse.Namespace) -> ScoringRecipe:
    from app.scoring.recipe import ScoringRecipe

    words = {TRIM_SEGMENT: "trim_segment", NO_TRIM: None}
    trim = words[options.trim] if options.trim in words else _seconds("--trim", options.trim)
    marked = options.manoeuvres
    if marked not in ("detected", "entire"):
        marked = tuple(map(_interval, marked.split(",")))
    return ScoringRecipe(trim=trim, manoeuvres=marked)


def _interval(text: str) -> Interval:
    from app.scoring.recipe import Interval

    start, colon, end = text.partition(":")
    if not colon:
        raise ValueError(
            f"--manoeuvres {text!r}: write detected, entire, or START:END in seconds, several with "
            "commas between"
        )
    return Interval(_seconds("--manoeuvres", start), _seconds("--manoeuvres", end))


def _seconds(option: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        words = {"--trim": f", {TRIM_SEGMENT} or {NO_TRIM}"}.get(option, "")
        raise ValueError(f"{option} {text!r}: write a number of seconds{words}") from None
