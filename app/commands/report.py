"""`forewarn report`: score a recorded flight and write the report as one HTML file."""

import argparse
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from app.commands.options.option import add_output, option
from app.commands.options.scoring import SETTINGS, add_scoring_options, request_of
from app.commands.output.results import DestinationError, check_file, print_result
from app.commands.output.scores import (
    Outcome,
    Write,
    asking_for_mapping,
    just,
    outcome_of,
    write_files,
)
from app.jobs.requests import N_TEST
from app.jobs.training import fly_test
from app.recipes.recipes import RecipeError, default_test, from_plain
from app.recordings.exports import EXPORTS, export
from app.recordings.scored_file import MappingMemory, ScoredFile, ScoreRequest, labels, score_file
from app.report.page import report
from app.report.subject import about, file_subjects
from core.monitor import Monitor


def add(parser: argparse.ArgumentParser) -> None:
    add_scoring_options(parser)
    option(
        parser, "--export csv,parquet,mat", "also write every sample as these formats", default=""
    )
    option(
        parser,
        "--n-test NUMBER",
        f"fresh flights to test an untested monitor, 0 for none; {N_TEST} if absent",
        type=int,
        default=N_TEST,
    )
    add_output(parser, "HTML", "report to write; named after FILE if absent")
    parser.epilog = f"Each monitor and each epsilon gets its own report. {SETTINGS}"


def run(options: argparse.Namespace) -> int:
    """Returns 1 where no sample could be assessed."""
    request, memory = request_of(options)
    out = check_file(options.out or Path(f"{request.file.stem}-report.html"))
    exports = tuple(dict.fromkeys(filter(None, options.export.split(","))))
    files = ReportFiles(out, exports, options.n_test, options.aircraft)
    outcome = write_reports(request, files, memory)
    print_result(options, outcome.text, outcome.plain)
    return 0 if outcome.is_assessed else 1


@dataclass(frozen=True)
class ReportFiles:
    """The files to write for a scored recording.

    out: the report; several reports get a label before the ending.   exports: keys of EXPORTS.
    n_test: fresh flights that test a monitor without test results.   aircraft: its name.
    """

    out: Path
    exports: tuple[str, ...] = ()
    n_test: int = 0
    aircraft: str | None = None

    def __post_init__(self) -> None:
        if unknown := [kind for kind in self.exports if kind not in EXPORTS]:
            raise ValueError(f"--export {unknown[0]!r}: choose from {', '.join(EXPORTS)}")
        if self.n_test < 0:
            raise ValueError(f"--n-test {self.n_test}: it must be 0 or more")

    def paths(self, label: str) -> tuple[Path, ...]:
        stem = f"{self.out.stem}-{label}" if label else self.out.stem
        endings = (self.out.suffix, *(f".{kind}" for kind in self.exports))
        return tuple(self.out.with_name(f"{stem}{ending}") for ending in endings)

    def check(self, request: ScoreRequest) -> None:
        """DestinationError where an output would overwrite an input."""
        inputs = {path.resolve() for path in (request.file, *request.monitors)}
        for path in (path for label in labels(request) for path in self.paths(label)):
            if path.resolve() in inputs:
                raise DestinationError(
                    f"{path} is an input and would be overwritten: give another file with --out"
                )


def write_reports(
    request: ScoreRequest, files: ReportFiles, memory: MappingMemory | None = None
) -> Outcome:
    """Score a file and write a report for each monitor at each epsilon.

    memory: as for `score_file`.   Nothing is written before everything is scored and drawn.
    """
    files.check(request)
    with asking_for_mapping(files.out.with_name(f"{files.out.stem}-mapping.json")):
        scored_file = tested(score_file(request, memory), files.n_test)
    writers: dict[Path, Write] = {}
    for scoring, subject in file_subjects(request, scored_file, files.aircraft):
        notes = about(subject.recording, subject.scoring)
        page = report(subject).encode()
        dictionary = subject.monitor.dictionary
        exports = [
            partial(export, subject.samples, notes, kind, dictionary=dictionary)
            for kind in files.exports
        ]
        writers |= zip(files.paths(scoring.label), [just(page), *exports], strict=True)
    write_files(writers)
    return outcome_of(scored_file, list(writers))


def tested(scored_file: ScoredFile, n_test: int) -> ScoredFile:
    """The scored file with an evaluation in each monitor that has or can get one."""
    monitors = {scoring.path: scoring.monitor for scoring in scored_file.scored}
    evaluated = {
        path: replace(monitor, evaluation=evaluation(monitor, n_test))
        for path, monitor in monitors.items()
    }
    scored = tuple(
        scoring._replace(monitor=evaluated[scoring.path]) for scoring in scored_file.scored
    )
    return replace(scored_file, scored=scored)


def evaluation(monitor: Monitor, n_test: int) -> dict[str, Any] | None:
    """The monitor's stored evaluation, else one on n_test flights of its recipe; None without."""
    if monitor.evaluation is not None:
        return monitor.evaluation
    try:
        plain = monitor.dataset_recipe
        recipe = from_plain(default_test(plain), plain, "dataset")
    except RecipeError:
        return None
    if not (n_test and monitor.dataset_recipe):
        return None
    return fly_test(monitor, recipe, n_test).as_plain(n_test, monitor)
