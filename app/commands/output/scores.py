"""A scored file and its mapping: printed, and written as tables and figures."""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from app.assessment.limits_history import pieces_of
from app.assessment.wording import sensors, verdict
from app.recipes.recipes import read_plain
from app.recordings.exports import export
from app.recordings.scored_file import (
    MappingMemory,
    Scored,
    ScoredFile,
    ScoreRequest,
    UnmappedFile,
    score_file,
)
from app.telemetry.contents import Contents
from app.telemetry.mapping.mapping import ChannelSource, Mapping, counts_the_day
from app.telemetry.mapping.proposal import Proposal
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import in_order, target_of
from core.channels import Channel
from core.evaluation.certificate import warnings_of
from core.whole_file import whole_file, write_whole

MAPPING = "mapping.json"
Write = Callable[[BinaryIO], object]


class Outcome(NamedTuple):
    """is_assessed: whether any sample could be assessed.   plain: `text` as plain data."""

    text: str
    is_assessed: bool
    plain: dict[str, Any]


def write_scores(
    request: ScoreRequest, out: Path, memory: MappingMemory | None = None, with_png: bool = False
) -> Outcome:
    """Score a file; write tables, figures and the mapping to a directory.

    memory: as for `score_file`.   Nothing is written before everything is scored and drawn.
    """
    with asking_for_mapping(out / MAPPING):
        scored_file = score_file(request, memory)
    text = json.dumps(scored_file.mapping.to_plain(), indent=2, ensure_ascii=False)
    files = {MAPPING: just(f"{text}\n".encode())}
    for scoring in scored_file.scored:
        files |= _files(request.file.name, scoring, with_png)
    write_files({out / name: write for name, write in files.items()})
    return outcome_of(scored_file, [out / name for name in files])


def write_files(files: dict[Path, Write]) -> None:
    """Write each file, completely or not at all."""
    for path, write in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            write(file)


def just(content: bytes) -> Write:
    return lambda file: file.write(content)


def outcome_of(scored_file: ScoredFile, written: Sequence[Path]) -> Outcome:
    names = [str(path) for path in written]
    return Outcome(
        "\n".join([*lines(scored_file), f"written: {', '.join(names)}"]),
        any(map(is_assessed, scored_file.scored)),
        {
            "mapping": scored_file.mapping.to_plain(),
            "scorings": [_plain(scoring) for scoring in scored_file.scored],
            "accept_useless": scored_file.accept_useless,
            "files": names,
        },
    )


def _plain(scoring: Scored) -> dict[str, Any]:
    """A scoring without its samples; SI units, N_y in g."""
    recording = scoring.recording
    return {
        "monitor": str(scoring.path),
        "label": scoring.label,
        "epsilon": recording.epsilon,
        "alert_above": recording.alert_above,
        "assessed": is_assessed(scoring),
        "manoeuvres": [asdict(manoeuvre) for manoeuvre in recording.manoeuvres],
        "outside_exceedances": [asdict(each) for each in recording.outside_exceedances],
        "notes": [*recording.quality.sentences(), *recording.notes],
        "compatibility": [check.to_plain() for check in recording.compatibility],
        "warnings": _warnings(scoring),
    } | ({"monitor_set": scoring.by_set.in_use.to_plain()} if scoring.by_set else {})


def lines(scored_file: ScoredFile) -> Iterator[str]:
    yield from contents_lines(scored_file.contents)
    yield from mapping_lines(scored_file.mapping, scored_file.proposal)
    for scoring in scored_file.scored:
        yield from _lines(
            scoring,
            scoring is scored_file.scored[0],
            counts_the_day(scored_file.mapping.times.values()),
        )


def is_assessed(scoring: Scored) -> bool:
    samples = scoring.recording.samples
    return bool((np.isfinite(samples["p_value"]) | np.isfinite(samples["withdrawn"])).any())


def _files(file: str, scoring: Scored, with_png: bool) -> dict[str, Write]:
    """Writers of the table and the figure, by their path in the output directory."""
    from app.report.figures import png, score_figure

    scored, monitor = scoring.recording, scoring.monitor
    figure = score_figure(
        monitor.dictionary,
        scored.samples,
        [asdict(manoeuvre) for manoeuvre in scored.manoeuvres],
        pieces_of(monitor.dictionary, monitor.envelope, scored.limits_in_force),
        scored.alert_above,
        monitor.lead,
        " ".join(["scored:", file, scoring.label]).strip(),
    )
    table = partial(export, scored.samples, {}, "csv", dictionary=monitor.dictionary)
    files: dict[str, Write] = {"assessments.csv": table, "scored.svg": just(figure)}
    if with_png:
        files["scored.png"] = just(png(figure))
    return {str(Path(scoring.label) / name): write for name, write in files.items()}


def _lines(scoring: Scored, is_first: bool, of_day: bool) -> Iterator[str]:
    if is_first:
        yield from dict.fromkeys((*scoring.recording.quality.sentences(), *scoring.recording.notes))
        yield from sensors(scoring.recording.compatibility)
    if scoring.label:
        yield f"== {scoring.label} =="
    if scoring.by_set:
        yield f"scored by monitor set {scoring.by_set.in_use.name}"
    yield from (f"WARNING: {warning}" for warning in _warnings(scoring))
    yield from verdict(scoring.monitor, scoring.recording, of_day=of_day)


def _warnings(scoring: Scored) -> list[str]:
    """Warnings of the monitor; for a set, of each of its monitors at its own epsilon."""
    if not scoring.by_set:
        return list(warnings_of(scoring.monitor.evaluation, scoring.recording.epsilon))
    in_use = scoring.by_set.in_use
    return [
        f"{name}: {warning}"
        for name, monitor in zip(in_use.names, in_use.members, strict=True)
        for warning in warnings_of(monitor.evaluation, monitor.check_epsilon())
    ]


MOST_BAD_ROWS = 10
"""Most bad rows to list."""
EVIDENT = 0.9
"""A proposal with at least this confidence is printed without reasons."""


def read_mapping(path: Path) -> Mapping:
    """A mapping from a JSON file. RecipeError, TelemetryError."""
    return Mapping.from_plain(read_plain(path))


def contents_lines(contents: Contents) -> Iterator[str]:
    yield from contents.notes
    yield from (f"ignored: {item}" for item in contents.ignored)
    listed = contents.bad_rows[:MOST_BAD_ROWS]
    if contents.n_bad_rows:
        yield f"bad rows skipped: {contents.n_bad_rows}"
    yield from (f"  line {row.line}: {row.reason}: {row.text}" for row in listed)
    if contents.n_bad_rows > len(listed):
        yield f"  and {contents.n_bad_rows - len(listed)} more"


def mapping_lines(mapping: Mapping, proposal: Proposal | None) -> Iterator[str]:
    """One line for each channel, with the confidence of a proposal."""
    yield "proposed mapping:" if proposal else "given mapping:"
    yield from (f"  {note}" for note in (proposal.notes if proposal else ()))
    for key in in_order(mapping.channels):
        source = mapping.channels[key]
        rationale = proposal.rationales.get(key) if proposal else None
        confidence = ""
        if rationale is not None and not source.derivation:
            confidence = f", confidence {rationale.confidence:.0%}"
            if rationale.confidence < EVIDENT:
                confidence += f": {'; '.join(rationale.reasons)}"
        yield f"  {key:8} {_source(source, target_of(key, source.unit))}{confidence}"


def _source(source: ChannelSource, target: Channel) -> str:
    if source.derivation:
        return f"derived: {source.derivation}"
    sign = "-" if source.sign < 0 else ""
    bias = f", bias removed: {target.read(source.bias)}" if source.bias else ""
    scaled = f" = {source.scaling}" if str(source.scaling) else ""
    return f"{sign}{source.signal}{scaled} [{source.unit or 'unit not given'}]{bias}"


MOST_SIGNALS = 400
"""Most signals to list."""


@contextmanager
def asking_for_mapping(path: Path) -> Iterator[None]:
    """If the block cannot map a file, list its signals and write a mapping to complete.

    path: of the mapping to write. If it exists, the next free name is used.   TelemetryError.
    """
    try:
        yield
    except UnmappedFile as error:
        print("\n".join(signal_lines(error.contents)), file=sys.stderr)
        path = _free(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(error.template, indent=2, ensure_ascii=False)
        write_whole(path, f"{text}\n".encode())
        raise TelemetryError(
            f"{error}; the signals are listed above: complete {path} and give it with --mapping"
        ) from None


def signal_lines(contents: Contents) -> Iterator[str]:
    yield f"signals of the file: {len(contents.signals)}"
    n_shown = 0
    for number, group in enumerate(contents.groups):
        if group.name:
            yield f"  {group.name}, {group.n_rows} rows:"
        members = [signal for signal in contents.signals if signal.group == number]
        for signal in members[: max(0, MOST_SIGNALS - n_shown)]:
            unit = f" [{signal.unit}]" if signal.unit else ""
            description = f"  {signal.description}" if signal.description else ""
            yield f"    {signal.name}{unit}{description}"
        n_shown += len(members)
    if n_shown > MOST_SIGNALS:
        yield f"  and {n_shown - MOST_SIGNALS} more"


def _free(path: Path) -> Path:
    """The path, or the first free one with a number after its stem."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_stem(f"{path.stem}-{number}")
    return free
