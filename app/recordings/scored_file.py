"""Score a recorded flight from its file by one or more monitors."""

from collections.abc import Iterator
from collections.abc import Mapping as Plain
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from app.assessment import MissingChannels, ScoredRecording, ScoringRecipe, score_at_each
from app.assessment.limits_history import LimitsHistory, SetHistory
from app.assessment.monitors_in_use import MonitorsInUse
from app.assessment.planned_test import planned_test
from app.recipes.recipes import read_plain
from app.recordings.files import digest_of
from app.recordings.mapped_recording import MappedRecording
from app.settings import Settings
from app.telemetry.contents import Columns, Contents
from app.telemetry.mapping.mapping import Mapping, TimeSource, mapping_template, rate_words
from app.telemetry.mapping.proposal import Proposal, propose
from app.telemetry.mapping.signs import CONVENTION
from app.telemetry.reading import columns_of
from app.telemetry.recording import TelemetryError
from app.telemetry.timing.repair import RepairedTraces
from core.channels import Channel
from core.conditions import ConditionKey, ranges_from_plain
from core.evaluation.certificate import UselessMonitor, check_use
from core.monitor import Monitor, load
from core.monitor.monitor_set import MonitorCase, MonitorSet
from core.simulation.attitude import surface_signs

if TYPE_CHECKING:
    from app.store.recordings import MappingRepository


class RequestedSet(NamedTuple):
    """A monitor set to score by. digest: SHA-256 of its first monitor."""

    in_use: MonitorsInUse
    digest: str


def stored_set(settings: Settings, name: str, declared: Plain[ConditionKey, float]) -> RequestedSet:
    """The stored monitor set of a name or id. ValueError without it; StoreError."""
    from app.recordings.scored import set_in_use
    from app.store.store import open_store  # slow to import, and only needed here

    store = open_store(settings.url, recover=False)
    try:
        infos = store.monitor_sets.all()
        info = next((info for info in infos if name in (info.name, info.id)), None)
        if info is None:
            known = ", ".join(info.name for info in infos)
            raise ValueError(
                f"no file and no stored monitor set is called {name}: "
                f"{f'give one of {known}' if known else 'none is stored, so give a file'}"
            )
        digest = store.monitors.info(info.cases[0].monitor).digest
        return RequestedSet(set_in_use(store, info, declared), digest)
    finally:
        store.close()


def set_of_file(path: Path, declared: Plain[ConditionKey, float]) -> RequestedSet:
    """The monitor set of a JSON file: as POST /monitor-sets takes it, but with monitor files.

    Their paths are relative to its folder. RecipeError, ValueError, MonitorFileError.
    """
    plain = read_plain(path)
    try:
        name = str(plain["name"])
        given = [
            (str(case["name"]), ranges_from_plain(case["ranges"]), path.parent / case["monitor"])
            for case in plain["cases"]
        ]
    except (AttributeError, KeyError, TypeError, ValueError):
        raise ValueError(
            f"{path} is no monitor set: it needs a name and cases, each with its name, ranges such "
            'as {"mach": [null, 0.8]} and monitor, the path of its file'
        ) from None
    files = [file for _, _, file in given]
    cases = tuple(MonitorCase(case, ranges, load(file)) for case, ranges, file in given)
    monitors = MonitorSet(cases)
    monitors.check()
    ids, names = tuple(map(str, files)), tuple(file.stem for file in files)
    in_use = MonitorsInUse(str(path), name, monitors, ids, names, declared)
    return RequestedSet(in_use, digest_of(files[0]))


@dataclass(frozen=True)
class ScoreRequest:
    """The request on the command line.

    monitors: files; none where a set is given.   epsilons: None for the monitor's own.
    mapping: None to use the proposed one.   rate: sample rate of groups without a time.
    group: flight to map, if the file has several.   accept_useless: score even if the alerts of
    the only monitor, or of one of the set, carry no information.
    """

    monitors: tuple[Path, ...]
    file: Path
    epsilons: tuple[float | None, ...] = (None,)
    mapping: Mapping | None = None
    rate: TimeSource | None = None
    group: str = ""
    recipe: ScoringRecipe = ScoringRecipe()  # noqa: RUF009
    accept_useless: bool = False
    by_set: RequestedSet | None = None


class Scored(NamedTuple):
    """One of several scorings. label: distinguishes it from the others, "" if there is only one.

    path, monitor: of a set, its id or name and its first monitor.
    """

    label: str
    path: Path
    monitor: Monitor
    recording: ScoredRecording
    by_set: RequestedSet | None = None


@dataclass(frozen=True, eq=False)
class ScoredFile:
    """A file with its mapping and scorings.

    proposal: None if the mapping was given.   accept_useless: as requested.
    """

    contents: Contents
    mapping: Mapping
    proposal: Proposal | None
    scored: tuple[Scored, ...]
    accept_useless: bool = False


class UnmappedFile(TelemetryError):
    """The proposed mapping is not sufficient. template: one to complete, as plain data."""

    def __init__(self, message: str, contents: Contents, template: dict[str, Any]) -> None:
        super().__init__(message)
        self.contents, self.template = contents, template


@dataclass(frozen=True)
class MappingMemory:
    """Stored mappings of one aircraft's recorders. StoreError if the store cannot be opened."""

    settings: Settings
    aircraft: str

    def recall(self, contents: Contents) -> Mapping | None:
        """The last mapping of this aircraft, preferably one for exactly these signals."""
        with self._mappings(contents) as (mappings, signature):
            remembered = mappings.find(self.aircraft, signature)
        return None if remembered is None else Mapping.from_plain(remembered.mapping)

    def remember(self, contents: Contents, mapping: Mapping) -> None:
        """Use this mapping for the aircraft's next recording."""
        with self._mappings(contents) as (mappings, signature):
            mappings.save(self.aircraft, signature, mapping.to_plain())

    @contextmanager
    def _mappings(self, contents: Contents) -> Iterator[tuple["MappingRepository", str]]:
        from app.recordings.mapped_columns import signature
        from app.store.store import open_store  # slow to import, and only needed here

        store = open_store(self.settings.url, recover=False)
        try:
            yield store.mappings, signature(contents)
        finally:
            store.close()


def load_monitors(request: ScoreRequest) -> list[Monitor]:
    """The monitors of a request. UselessMonitor unless accepted."""
    in_use = request.by_set and request.by_set.in_use
    monitors = in_use.members if in_use else [load(path) for path in request.monitors]
    names = in_use.names if in_use else tuple(map(str, request.monitors))
    for name, monitor in zip(names, monitors, strict=True):
        for epsilon in request.epsilons:
            checked = monitor.check_epsilon(epsilon)
            if (in_use or len(monitors) == 1) and not request.accept_useless:
                _check_use(name, monitor, checked)
    return monitors


def score_file(
    request: ScoreRequest,
    memory: MappingMemory | None = None,
    monitors: list[Monitor] | None = None,
) -> ScoredFile:
    """Score a file by each monitor at each epsilon.

    memory: provides the aircraft's mapping if none is given; otherwise stores the given one after
    scoring.   monitors: of the request, if they are loaded. UselessMonitor unless accepted.
    """
    monitors = load_monitors(request) if monitors is None else monitors
    with columns_of(request.file) as columns:
        contents = columns.contents
        proposal = None if request.mapping else _proposed(columns, request, monitors, memory)
        mapping = proposal.mapping if proposal else _as_given(contents, request)
        if request.rate and request.rate not in mapping.times.values():
            raise TelemetryError(
                f"--rate {rate_words(request.rate)} is not used: every group of {request.file} has "
                "a time; to use the rate instead, give a --mapping with it in `times`"
            )
        applied = False
        try:
            mapped = MappedRecording.of(columns, mapping)
            applied = mapped.applied is not None
            recorded = mapped.scorable()
            by_set = request.by_set
            history = (
                SetHistory.of(columns, mapping, by_set.in_use)
                if by_set
                else LimitsHistory.of(columns, mapping)
            )
            scored = tuple(_score(request, monitors, recorded, history))
        except TelemetryError as error:
            message = f"{request.file}: {error}{_why(error, proposal)}"
            if proposal and (not applied or isinstance(error, MissingChannels)):
                missing = error.keys if isinstance(error, MissingChannels) else proposal.missing
                template = mapping_template(mapping, contents, missing, _channels(monitors))
                raise UnmappedFile(message, contents, template) from None
            raise TelemetryError(message) from None
    if memory and request.mapping:
        memory.remember(contents, request.mapping)
    return ScoredFile(contents, mapping, proposal, scored, request.accept_useless)


def _check_use(name: str, monitor: Monitor, epsilon: float) -> None:
    try:
        check_use(monitor.evaluation, epsilon)
    except UselessMonitor as error:
        raise UselessMonitor(f"{name}: {error}: --accept-useless") from None


def _as_given(contents: Contents, request: ScoreRequest) -> Mapping:
    mapping = request.mapping or Mapping()
    if request.rate is None:
        return mapping
    rates = {group.name: request.rate for group in contents.groups}
    return replace(mapping, times=rates | mapping.times)


def _channels(monitors: list[Monitor]) -> list[Channel]:
    return [channel for monitor in monitors for channel in monitor.dictionary.channels]


def _proposed(
    columns: Columns, request: ScoreRequest, monitors: list[Monitor], memory: MappingMemory | None
) -> Proposal:
    """The mapping proposed for the first monitor, whose aircraft gives the signs of surfaces."""
    aircraft = planned_test(monitors[0]).aircraft
    return propose(
        columns,
        memory.recall(columns.contents) if memory else None,
        aircraft=memory.aircraft if memory else "",
        expected=surface_signs(aircraft.uncertain_plant()) if aircraft else CONVENTION,
        rate=request.rate,
        group=request.group,
        dictionary=monitors[0].dictionary,
        others=_channels(monitors),
    )


def _why(error: TelemetryError, proposal: Proposal | None) -> str:
    """Why channels are missing, from the proposal."""
    if proposal is None or not isinstance(error, MissingChannels):
        return ""
    rationales = [proposal.rationales.get(key) for key in error.keys]
    reasons = [
        rationale.reasons[0]
        for rationale in rationales
        if rationale is not None and rationale.reasons
    ]
    return f" ({'; '.join(reasons)})" if reasons else ""


def labels(request: ScoreRequest) -> list[str]:
    """Labels that distinguish the scorings, in order; "" for a single one."""
    if request.by_set:
        return [""]
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
    history: LimitsHistory | SetHistory | None,
) -> Iterator[Scored]:
    is_used = any("flown" in (monitor.evaluation or {}) for monitor in monitors)
    digest = digest_of(request.file) if is_used else ""
    label, by_set = iter(labels(request)), request.by_set
    paths = [Path(by_set.in_use.id)] if by_set else request.monitors
    for path, monitor in zip(paths, monitors, strict=by_set is None):
        about = request.recipe, request.epsilons, history, digest
        for scored in score_at_each(monitor, recorded, *about):
            yield Scored(next(label), path, monitor, scored, by_set)


def _distinct(names: list[str]) -> list[str]:
    """The names, with a number appended to repeated ones."""
    before = [names[:k].count(name) for k, name in enumerate(names)]
    return [
        f"{name}-{count + 1}" if count else name for name, count in zip(names, before, strict=True)
    ]
