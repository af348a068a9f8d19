"""Reports of a file that was scored, with exports beside them: what is written, and where."""

from dataclasses import dataclass
from pathlib import Path

from app.commands.destinations import DestinationError
from app.commands.scoring_lines import Report, is_assessed, lines
from app.recordings.exports import EXPORTS, export
from app.recordings.mapping_memory import MappingMemory
from app.recordings.scored_file import ScoreRequest, labels, score_file
from app.report.from_file import file_subjects
from app.report.page import report
from app.report.subject import about
from core.whole_file import write_whole


@dataclass(frozen=True)
class ReportOrder:
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
    request: ScoreRequest, order: ReportOrder, memory: MappingMemory | None = None
) -> Report:
    """Score a file and report it, each monitor at each epsilon in a file of its own.

    memory: as for `score_file`.   Nothing is written before everything is made.
    """
    order.check(request)
    found = score_file(request, memory)
    files: dict[Path, bytes] = {}
    for one, subject in file_subjects(request, found, order.aircraft, order.n_test):
        notes = about(subject.recording, subject.scoring)
        exported = [export(subject.samples, notes, form) for form in order.exports]
        content = [report(subject).encode(), *exported]
        files |= zip(order.places(one.label), content, strict=True)
    for path, content in files.items():
        write_whole(path, content)
    written = f"written: {', '.join(map(str, files))}"
    return Report("\n".join([*lines(found), written]), any(map(is_assessed, found.scored)))
