"""A recorded flight scored from its file: read, mapped, and scored by every monitor asked for."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path
from typing import Any, NamedTuple

from app.recordings.mapping_memory import MappingMemory
from app.scoring import MissingChannels, ScoredRecording, ScoringRecipe, score_at_each
from app.scoring.limits_history import LimitsHistory
from app.scoring.planned_test import planned_test
from app.telemetry.contents import Columns, Contents
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.mapping import Mapping, TimeSource
from app.telemetry.mapping.motion.signs import CONVENTION
from app.telemetry.mapping.proposal import Proposal, propose
from app.telemetry.mapping.template import mapping_template
from app.telemetry.mapping.typed_rate import rate_words
from app.telemetry.reading import columns_of
from app.telemetry.recording import TelemetryError
from app.telemetry.timing.repair import RepairedTraces, repair
from core.evaluation.certificate import UselessMonitor, check_use
from core.monitor import Monitor, load
from core.simulation.attitude import surface_signs


@dataclass(frozen=True)
class ScoreRequest:
    """What is asked for on the command line.

    epsilons: None for a monitor's own.   mapping: what the signals are; None: as proposed.
    rate: of the rows of groups that have no time otherwise.   accept_useless: score by a monitor
    whose alerts tell nothing although it is the only one.
    """

    monitors: tuple[Path, ...]
    file: Path
    epsilons: tuple[float | None, ...] = (None,)
    mapping: Mapping | None = None
    rate: TimeSource | None = None
    recipe: ScoringRecipe = ScoringRecipe()  # noqa: RUF009
    accept_useless: bool = False


class Scored(NamedTuple):
    """One scoring of several. label: what tells it from the others, "" where it is alone."""

    label: str
    path: Path
    monitor: Monitor
    recording: ScoredRecording


@dataclass(frozen=True, eq=False)
class ScoredFile:
    """A file with all that was said of it.

    proposal: why it was mapped so; None: as given.   accept_useless: as was asked for.
    """

    contents: Contents
    mapping: Mapping
    proposal: Proposal | None
    scored: tuple[Scored, ...]
    accept_useless: bool = False


class UnmappedFile(TelemetryError):
    """A file of which the proposed mapping does not do. template: one to fill in, as plain data."""

    def __init__(self, message: str, contents: Contents, template: dict[str, Any]) -> None:
        super().__init__(message)
        self.contents, self.template = contents, template


def score_file(request: ScoreRequest, memory: MappingMemory | None = None) -> ScoredFile:
    """Score a file by each monitor at each epsilon.

    memory: of the aircraft's recorders: asked for a mapping unless one is given, which it keeps
    once everything is scored. UselessMonitor unless that is accepted.
    """
    monitors = [load(path) for path in request.monitors]
    for monitor in monitors:
        for epsilon in request.epsilons:
            checked = monitor.check_epsilon(epsilon)
            if len(monitors) == 1 and not request.accept_useless:
                _check_use(request.monitors[0], monitor, checked)
    with columns_of(request.file) as columns:
        contents = columns.contents
        proposal = None if request.mapping else _proposed(columns, request, monitors[0], memory)
        mapping = proposal.mapping if proposal else _as_given(contents, request)
        if request.rate and request.rate not in mapping.times.values():
            raise TelemetryError(
                f"--rate {rate_words(request.rate)}: every group of {request.file} has a time; "
                "give a --mapping with the rate in its `times` to use that instead"
            )
        applied = False
        try:
            recorded = repair(apply_mapping(columns, mapping))
            applied = True
            history = LimitsHistory.of(columns, mapping)
            scored = tuple(_score(request, monitors, recorded, history))
        except TelemetryError as error:
            message = f"{request.file}: {error}{_why(error, proposal)}"
            if proposal and (not applied or isinstance(error, MissingChannels)):
                missing = error.keys if isinstance(error, MissingChannels) else proposal.missing
                template = mapping_template(mapping, contents, missing)
                raise UnmappedFile(message, contents, template) from None
            raise TelemetryError(message) from None
    if memory and request.mapping:
        memory.keep(contents, request.mapping)
    return ScoredFile(contents, mapping, proposal, scored, request.accept_useless)


def _check_use(path: Path, monitor: Monitor, epsilon: float) -> None:
    try:
        check_use(monitor.evaluation, epsilon)
    except UselessMonitor as error:
        raise UselessMonitor(f"{path}: {error}: --accept-useless") from None


def _as_given(contents: Contents, request: ScoreRequest) -> Mapping:
    """The mapping that was given, with the rate for groups of which it says no time."""
    given = request.mapping or Mapping()
    if request.rate is None:
        return given
    return replace(given, times={g.name: request.rate for g in contents.groups} | given.times)


def _proposed(
    columns: Columns, request: ScoreRequest, monitor: Monitor, memory: MappingMemory | None
) -> Proposal:
    """What the signals most likely are, surfaces with the signs of the monitor's aircraft."""
    aircraft = planned_test(monitor).aircraft
    return propose(
        columns,
        memory.recall(columns.contents) if memory else None,
        aircraft=memory.aircraft if memory else "",
        expected=surface_signs(aircraft.uncertain_plant()) if aircraft else CONVENTION,
        rate=request.rate,
    )


def _why(error: TelemetryError, proposal: Proposal | None) -> str:
    """Why nothing was taken for the channels that are missing."""
    if proposal is None or not isinstance(error, MissingChannels):
        return ""
    rationales = [proposal.rationales.get(key) for key in error.keys]
    reasons = [found.reasons[0] for found in rationales if found is not None and found.reasons]
    return f" ({'; '.join(reasons)})" if reasons else ""


def labels(request: ScoreRequest) -> list[str]:
    """What tells each scoring from the others, in their order; "" for one that is alone."""
    several = [len(request.monitors) > 1, len(request.epsilons) > 1]
    parts = [
        [name, f"epsilon-{epsilon:g}" if epsilon is not None else ""]
        for name in _distinct([path.stem for path in request.monitors])
        for epsilon in request.epsilons
    ]
    return ["-".join(compress(part, several)) for part in parts]


def _score(
    request: ScoreRequest,
    monitors: list[Monitor],
    recorded: RepairedTraces,
    history: LimitsHistory | None,
) -> Iterator[Scored]:
    label = iter(labels(request))
    for path, monitor in zip(request.monitors, monitors, strict=True):
        for scored in score_at_each(monitor, recorded, request.recipe, request.epsilons, history):
            yield Scored(next(label), path, monitor, scored)


def _distinct(names: list[str]) -> list[str]:
    """The same names, with a number behind one that was there before."""
    before = [names[:k].count(name) for k, name in enumerate(names)]
    return [
        f"{name}-{count + 1}" if count else name for name, count in zip(names, before, strict=True)
    ]
