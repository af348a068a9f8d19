"""The command that reports a recorded flight: one file to read, print and keep."""

import argparse
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from app.commands.options.destinations import DestinationError, check_file
from app.commands.options.mapping_request import asking_for_mapping
from app.commands.options.scoring import SETTINGS, add_scoring_options, request_of
from app.commands.output.results import add_json, print_result
from app.commands.output.scores import Report, Write, just, report_of, write_files
from app.jobs.requests import N_TEST
from app.jobs.training import fly_test
from app.recipes import RecipeError, from_plain
from app.recordings.exports import EXPORTS, export
from app.recordings.mapping_memory import MappingMemory
from app.recordings.scored_file import ScoredFile, ScoreRequest, labels, score_file
from app.report.from_file import file_subjects
from app.report.page import report
from app.report.subject import about
from core.collection import DatasetRecipe
from core.monitor import Monitor


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    add_scoring_options(parser)
    parser.add_argument(
        "--export",
        default="",
        metavar="csv,parquet,mat",
        help="write every sample beside the report too, for other programs",
    )
    parser.add_argument(
        "--n-test",
        type=int,
        default=N_TEST,
        metavar="NUMBER",
        help=f"fresh simulated flights that certify the monitor, {N_TEST} if absent, 0 for none",
    )
    parser.add_argument("-o", "--out", type=Path, help="HTML file, FILE's name if absent")
    add_json(parser)
    parser.epilog = f"Several monitors or epsilons make a report each. {SETTINGS}"


def run(options: argparse.Namespace) -> int:
    """Score the file and report it; 1 where nothing could be assessed."""
    out = check_file(options.out or Path(f"{options.file.stem}-report.html"))
    request, memory = request_of(options)
    exports = tuple(dict.fromkeys(filter(None, options.export.split(","))))
    wanted = ReportRequest(out, exports, options.n_test, options.aircraft)
    written = write_reports(request, wanted, memory)
    print_result(options, written.text, written.plain)
    return 0 if written.assessed else 1


@dataclass(frozen=True)
class ReportRequest:
    """What is to be written of a scored file.

    out: the report; of several, a label goes before its ending.   exports: keys of EXPORTS.
    n_test: fresh flights that certify a monitor.   aircraft: whose flight it is.
    """

    out: Path
    exports: tuple[str, ...] = ()
    n_test: int = 0
    aircraft: str | None = None

    def __post_init__(self) -> None:
        """Refuse formats that there are not, and less than no test flight."""
        if unknown := [form for form in self.exports if form not in EXPORTS]:
            raise ValueError(
                f"--export {unknown[0]!r}: write {', '.join(EXPORTS)}, or some of them"
            )
        if self.n_test < 0:
            raise ValueError(f"--n-test {self.n_test}: it must be 0 or more")

    def places(self, label: str) -> tuple[Path, ...]:
        """Where the report and the exports of one scoring go."""
        stem = f"{self.out.stem}-{label}" if label else self.out.stem
        endings = (self.out.suffix, *(f".{EXPORTS[form].ending}" for form in self.exports))
        return tuple(self.out.with_name(f"{stem}{ending}") for ending in endings)

    def check(self, request: ScoreRequest) -> None:
        """DestinationError where a file that is to be read would be written over."""
        read = {path.resolve() for path in (request.file, *request.monitors)}
        for path in (path for label in labels(request) for path in self.places(label)):
            if path.resolve() in read:
                raise DestinationError(
                    f"{path} is to be read, and would be written over: name another file with --out"
                )


def write_reports(
    request: ScoreRequest, wanted: ReportRequest, memory: MappingMemory | None = None
) -> Report:
    """Score a file and report it, each monitor at each epsilon in a file of its own.

    memory: as for `score_file`.   Nothing is written before everything is scored and drawn.
    """
    wanted.check(request)
    with asking_for_mapping(wanted.out.with_name(f"{wanted.out.stem}-mapping.json")):
        scored_file = tested(score_file(request, memory), wanted.n_test)
    files: dict[Path, Write] = {}
    for scoring, subject in file_subjects(request, scored_file, wanted.aircraft):
        notes = about(subject.recording, subject.scoring)
        page = report(subject).encode()
        exports = [partial(export, subject.samples, notes, form) for form in wanted.exports]
        files |= zip(wanted.places(scoring.label), [just(page), *exports], strict=True)
    write_files(files)
    return report_of(scored_file, list(files))


def tested(scored_file: ScoredFile, n_test: int) -> ScoredFile:
    """The same, where each monitor has its evaluation, and so says the same wherever it is told."""
    monitors = {one.path: one.monitor for one in scored_file.scored}
    known = {
        path: replace(monitor, evaluation=evaluation(monitor, n_test))
        for path, monitor in monitors.items()
    }
    scored = tuple(one._replace(monitor=known[one.path]) for one in scored_file.scored)
    return replace(scored_file, scored=scored)


def evaluation(monitor: Monitor, n_test: int) -> dict[str, Any] | None:
    """What its file says of fresh flights, else those flown now by its recipe; None for neither."""
    if monitor.evaluation is not None:
        return monitor.evaluation
    try:
        recipe = from_plain(DatasetRecipe(), monitor.dataset_recipe, "dataset")
    except RecipeError:
        return None
    if not (n_test and monitor.dataset_recipe):
        return None
    return fly_test(monitor, recipe, n_test).as_plain(n_test, monitor.lead, monitor.dt)
