"""A recorded flight scored from its file: what is read, printed and written."""

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app import figures
from app.exports import export
from app.mapping_memory import MappingMemory
from app.mapping_report import contents_lines, mapping_lines
from app.report.figures import whole_flight
from app.scoring import MissingChannels, ScoredRecording, ScoringOrder, score_at_each
from app.scoring.plan import plan_of
from app.scoring.verdict import verdict
from app.telemetry.applying import apply_mapping
from app.telemetry.contents import Columns, open_columns
from app.telemetry.mapping import Mapping
from app.telemetry.proposal import Proposal, propose
from app.telemetry.reading import read_file
from app.telemetry.recording import TelemetryError
from app.telemetry.signs import CONVENTION
from app.telemetry.traces import Traces
from core.monitor import Monitor, load
from core.simulation.attitude import surface_signs
from core.whole_file import write_whole

MAPPING = "mapping.json"


@dataclass(frozen=True)
class ScoreRequest:
    """What is asked for on the command line.

    epsilons: None for a monitor's own.   mapping: what the signals are; None: as proposed.
    out: directory for the results.
    """

    monitors: tuple[Path, ...]
    file: Path
    out: Path
    epsilons: tuple[float | None, ...] = (None,)
    mapping: Mapping | None = None
    order: ScoringOrder = ScoringOrder()  # noqa: RUF009


class Scored(NamedTuple):
    """One scoring of several. label: what tells it from the others, "" where it is alone."""

    label: str
    monitor: Monitor
    recording: ScoredRecording


class Report(NamedTuple):
    """What came of it. assessed: whether anything could be."""

    text: str
    assessed: bool


def score_file(request: ScoreRequest, memory: MappingMemory | None = None) -> Report:
    """Score a file by each monitor at each epsilon; write tables, figures and the mapping.

    memory: of the aircraft's recorders: asked for a mapping unless one is given, which it keeps.
    Nothing is written before everything is scored.
    """
    monitors = [load(path) for path in request.monitors]
    for monitor in monitors:
        for epsilon in request.epsilons:
            monitor.check_epsilon(epsilon)
    with tempfile.TemporaryDirectory(prefix="forewarn-") as place:
        folder = Path(place) / "columns"
        contents = read_file(request.file, folder)
        columns = open_columns(folder)
        proposal = None if request.mapping else _proposed(columns, monitors[0], memory)
        mapping = request.mapping or (proposal.mapping if proposal else Mapping())
        try:
            scored = list(_score(request, monitors, apply_mapping(columns, mapping)))
        except TelemetryError as error:
            raise TelemetryError(f"{request.file}: {error}{_why(error, proposal)}") from None
    text = json.dumps(mapping.to_plain(), indent=2, ensure_ascii=False)
    files = {MAPPING: f"{text}\n".encode()}
    for one in scored:
        files |= _files(request.file.name, one)
    for name, content in files.items():
        (request.out / name).parent.mkdir(parents=True, exist_ok=True)
        write_whole(request.out / name, content)
    if memory and request.mapping:
        memory.keep(contents, request.mapping)
    lines = [
        *contents_lines(contents),
        *mapping_lines(mapping, proposal),
        *(line for one in scored for line in _lines(one, one is scored[0])),
        f"written: {', '.join(str(request.out / name) for name in files)}",
    ]
    return Report("\n".join(lines), any(_is_assessed(one) for one in scored))


def _proposed(columns: Columns, monitor: Monitor, memory: MappingMemory | None) -> Proposal:
    """What the signals most likely are, surfaces with the signs of the monitor's aircraft."""
    aircraft = plan_of(monitor).aircraft
    return propose(
        columns,
        memory.recall(columns.contents) if memory else None,
        aircraft=memory.aircraft if memory else "",
        expected=surface_signs(aircraft.uncertain_plant()) if aircraft else CONVENTION,
    )


def _why(error: TelemetryError, proposal: Proposal | None) -> str:
    """Why nothing was taken for the channels that are missing."""
    if proposal is None or not isinstance(error, MissingChannels):
        return ""
    guesses = [proposal.guesses.get(key) for key in error.keys]
    reasons = [guess.reasons[0] for guess in guesses if guess is not None and guess.reasons]
    return f" ({'; '.join(reasons)})" if reasons else ""


def _score(request: ScoreRequest, monitors: list[Monitor], traces: Traces) -> Iterator[Scored]:
    names = _distinct([path.stem for path in request.monitors])
    for name, monitor in zip(names, monitors, strict=True):
        for one in score_at_each(monitor, traces, request.order, request.epsilons):
            parts = [name] if len(monitors) > 1 else []
            parts += [f"epsilon-{one.epsilon:g}"] if len(request.epsilons) > 1 else []
            yield Scored("-".join(parts), monitor, one)


def _distinct(names: list[str]) -> list[str]:
    """The same names, with a number behind one that was there before."""
    before = [names[:k].count(name) for k, name in enumerate(names)]
    return [
        f"{name}-{count + 1}" if count else name for name, count in zip(names, before, strict=True)
    ]


def _files(file: str, one: Scored) -> dict[str, bytes]:
    """Table and figure, by their place in the directory of results."""
    scored, monitor = one.recording, one.monitor
    figure = whole_flight(
        scored.samples,
        [stretch.to_plain() for stretch in scored.stretches],
        plan_of(monitor).limits,
        scored.epsilon,
        monitor.lead,
        " ".join(["scored:", file, one.label]).strip(),
    )
    files = {"assessments.csv": export(scored.samples, {}, "csv")}
    files |= figures.render(figure, "scored")
    return {str(Path(one.label) / name): content for name, content in files.items()}


def _lines(one: Scored, is_first: bool) -> Iterator[str]:
    if is_first:
        yield from dict.fromkeys((*one.recording.quality.sentences(), *one.recording.notes))
    if one.label:
        yield f"== {one.label} =="
    yield from verdict(one.monitor, one.recording)


def _is_assessed(one: Scored) -> bool:
    samples = one.recording.samples
    return bool((np.isfinite(samples["p_value"]) | np.isfinite(samples["withdrawn"])).any())
