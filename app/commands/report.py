"""`forewarn report`: score a recorded flight and write the report as one HTML file."""

import argparse
from dataclasses import dataclass
from functools import partial
from pathlib import Path

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
from app.recordings.exports import EXPORTS, export
from app.recordings.scored_file import MappingMemory, ScoreRequest, labels, score_file
from app.report.page import report
from app.report.subject import about, file_subjects


def add(parser: argparse.ArgumentParser) -> None:
    add_scoring_options(parser)
    option(
        parser, "--export csv,parquet,mat", "also write every sample as these formats", default=""
    )
    add_output(parser, "HTML", "report to write; named after FILE if absent")
    parser.epilog = f"Each monitor and each epsilon gets its own report. {SETTINGS}"


def run(options: argparse.Namespace) -> int:
    """Returns 1 where no sample could be assessed."""
    request, memory = request_of(options)
    out = check_file(options.out or Path(f"{request.file.stem}-report.html"))
    exports = tuple(dict.fromkeys(filter(None, options.export.split(","))))
    files = ReportFiles(out, exports, options.aircraft)
    outcome = write_reports(request, files, memory)
    print_result(options, outcome.text, outcome.plain)
    return 0 if outcome.is_assessed else 1


@dataclass(frozen=True)
class ReportFiles:
    """The files to write for a scored recording.

    out: the report; several reports get a label before the ending.   exports: keys of EXPORTS.
    aircraft: its name.
    """

    out: Path
    exports: tuple[str, ...] = ()
    aircraft: str | None = None

    def __post_init__(self) -> None:
        if unknown := [kind for kind in self.exports if kind not in EXPORTS]:
            raise ValueError(f"--export {unknown[0]!r}: choose from {', '.join(EXPORTS)}")

    def paths(self, label: str) -> tuple[Path, ...]:
        stem = f"{self.out.stem}-{label}" if label else self.out.stem
        endings = (self.out.suffix, *(f".{kind}" for kind in self.exports))
        return tuple(self.out.with_name(f"{stem}{ending}") for ending in endings)

    def check(self, request: ScoreRequest) -> None:
        """DestinationError where an output would overwrite an input."""
        read = request.by_set.in_use.ids if request.by_set else request.monitors
        inputs = {Path(path).resolve() for path in (request.file, *read)}
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
        scored_file = score_file(request, memory)
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
