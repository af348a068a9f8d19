"""Options of the commands that score a file."""

from __future__ import annotations

import argparse
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from app.commands.options.condition import add_condition, declared_of
from app.commands.options.fields import numbers
from app.commands.options.option import option

if TYPE_CHECKING:  # slow to import, and not needed for help
    from app.recordings.scored_file import MappingMemory, RequestedSet, ScoreRequest

TRIM_SEGMENT, NO_TRIM = "trim-segment", "none"
SETTINGS = (
    "With --aircraft, or the name of a monitor set, FOREWARN_* variables set the data directory."
)


def add_scoring_options(
    parser: argparse.ArgumentParser,
    file: str = "file FILE",
    text: str = "telemetry in any known format",
    aircraft: str = "use its stored mapping; a given mapping is stored for it",
    kind: type = Path,
) -> None:
    """file, text, kind: name, help and type of what is scored.   aircraft: help of its option."""
    option(
        parser, "monitors MONITOR", "monitor files; none with --monitor-set", type=Path, nargs="+"
    )
    option(parser, file, text, type=kind).required = False  # the only one with --monitor-set
    option(
        parser,
        "--monitor-set NAME|FILE.json",
        "score by a monitor set: each sample by the monitor of its flight condition",
    )
    add_condition(parser)
    option(
        parser,
        "--epsilon E[,E...]",
        "miss rates to compare; each monitor's own if absent",
        type=miss_rates,
        action="append",
        default=[],
    )
    option(parser, "--mapping FILE.json", "mapping of signals; proposed if absent", type=Path)
    option(parser, "--rate '50 Hz[ from 12:31:05]'", "sample rate of a file without times")
    option(parser, "--group NAME", "flight to map if the file has several", default="")
    option(parser, "--aircraft NAME", aircraft)
    option(
        parser,
        "--trim SECONDS|trim-segment|none",
        "mean over this time before each manoeuvre",
        type=trim,
        default=TRIM_SEGMENT,
    )
    option(parser, "--accept-useless", "accept a monitor that alerts on nearly every safe flight")
    option(
        parser,
        "--manoeuvres detected|entire|START:END,...",
        "found by control activity, the entire recording, or given times [s]",
        type=manoeuvres,
        default="detected",
    )


def miss_rates(text: str) -> tuple[float, ...]:
    return numbers(text)


def trim(text: str) -> float | str | None:
    named = {TRIM_SEGMENT: "trim_segment", NO_TRIM: None}
    return named[text] if text in named else float(text)


def manoeuvres(text: str) -> str | tuple[tuple[float, float], ...]:
    if text in ("detected", "entire"):
        return text
    ends = [each.split(":") for each in text.split(",")]
    return tuple((float(start), float(end)) for start, end in ends)


def request_of(options: argparse.Namespace) -> tuple[ScoreRequest, MappingMemory | None]:
    """The request, and the memory of the aircraft's mapping if one is named. ValueError."""
    from app.assessment.segments import Interval, ScoringRecipe
    from app.commands.output.scores import read_mapping
    from app.recordings.scored_file import MappingMemory, ScoreRequest
    from app.settings import read_settings
    from app.telemetry.mapping.mapping import read_rate

    monitors, file = _files(options)
    marked = options.manoeuvres
    if isinstance(marked, tuple):
        marked = tuple(Interval(*ends) for ends in marked)
    request = ScoreRequest(
        monitors=monitors,
        file=file,
        epsilons=tuple(chain(*options.epsilon)) or (None,),
        recipe=ScoringRecipe(trim=options.trim, manoeuvres=marked),
        mapping=None if options.mapping is None else read_mapping(options.mapping),
        rate=None if options.rate is None else read_rate(options.rate),
        group=options.group,
        accept_useless=options.accept_useless,
        by_set=_requested_set(options),
    )
    memory = MappingMemory(read_settings(), options.aircraft) if options.aircraft else None
    return request, memory


def _files(options: argparse.Namespace) -> tuple[tuple[Path, ...], Path]:
    """The monitors and the recording. ValueError."""
    *monitors, file = [*options.monitors, *([] if options.file is None else [options.file])]
    if options.monitor_set and monitors:
        raise ValueError(
            f"a monitor set and {' '.join(map(str, monitors))} were given: give the set, or "
            "monitors, and one file to score"
        )
    if not options.monitor_set and not monitors:
        raise ValueError(
            f"only {file} was given: give a monitor and the file to score, or --monitor-set and "
            "the file"
        )
    if options.monitor_set and options.epsilon:
        raise ValueError("a monitor set uses each monitor at its own epsilon: leave out --epsilon")
    return tuple(monitors), file


def _requested_set(options: argparse.Namespace) -> RequestedSet | None:
    from app.recordings.scored_file import set_of_file, stored_set
    from app.settings import read_settings

    declared, name = declared_of(options), options.monitor_set
    if name is None:
        return None
    if Path(name).is_file() or Path(name).suffix == ".json":
        return set_of_file(Path(name), declared)
    return stored_set(read_settings(), name, declared)
