"""Recordings of flown flights as rollouts, alone or with simulated ones."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from app.assessment.flown_rollouts import Beside, FlownFlight, Marked, flown_rollouts
from app.recordings.files import digest_of
from app.recordings.mapped_recording import MappedRecording
from app.recordings.recordings import Recordings
from app.recordings.rollouts import SentRollouts, failures_of
from app.store.scorings import ScoringInfo
from app.telemetry.limit_texts import extended, specified
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.proposal import propose
from app.telemetry.reading import columns_of
from app.telemetry.recording import TelemetryError
from app.telemetry.rollouts import MOST_BYTES, RolloutFile, empty_flights
from app.telemetry.targets import beyond_plausible
from app.telemetry.timing.repair import RepairedTraces
from core.channels import LATERAL, Dictionary
from core.computed import complete
from core.dataset import Dataset
from core.limits.limits import IntervalLimits, Limits
from core.limits.temporal import Requirement
from core.planned_test.planned_test import DatasetRecipe
from core.rollouts import UNLABELLED, LabelledFlights, RolloutsError, labels
from core.types import Array

MOST_CHECKED, MOST_FILES_CHECKED = 32 * 2**20, 100
"""Most bytes and files that are checked before a job reads them."""
Flown = Callable[[Dictionary], Iterable[FlownFlight]]
"""Gives recordings, mapped to the channels of a dictionary."""


@dataclass(frozen=True, eq=False)
class RolloutSources:
    """Rollouts of files, of a dataset and of recordings, before they are joined.

    read: of files or of a dataset; of no flight where the flown ones are alone.
    flown: None without recordings.   dataset: which `read` is, None for files.
    channels, limits: as the command line writes them.   findings: before they are read.
    most_bytes: of all together.
    """

    read: RolloutFile
    flown: Flown | None = None
    dataset: Dataset | None = None
    channels: Sequence[str] = ()
    limits: Sequence[str] = ()
    findings: Sequence[str] = ()
    most_bytes: int = MOST_BYTES

    def joined(self) -> tuple[RolloutFile, tuple[str, ...]]:
        """All rollouts, not yet checked, and the findings of reading them. ValueError."""
        if self.flown is None:
            return self.read, self.read.findings
        dictionary, *_ = extended(self.read.dictionary, self.channels, self.limits)
        read, findings = _joined(self, dictionary, self.flown)
        return read, (*self.read.findings, *self.findings, *findings)

    def to_dataset(self) -> tuple[Dataset, list[str]]:
        """The rollouts checked and labelled, and all findings. ValueError."""
        read, findings = self.joined()
        if self.dataset is not None:
            return _added(self.dataset, read, findings)
        channels = () if self.flown else self.channels  # which `joined` has added
        dictionary, limits, requirements = specified(read, channels, self.limits)
        if requirements:
            flights = _labelled(read, dictionary, requirements)
        else:
            flights = _checked(read, dictionary, limits)
        return Dataset.from_flights(flights), [*findings, *flights.findings]

    @classmethod
    def beside(cls, dataset: Dataset, flown: Flown) -> "RolloutSources":
        """Rollouts of a dataset and recordings."""
        flights = dataset.flights()
        fail_index = np.where(flights.fails, flights.fail_index, -1)
        about = dataset.dt, dataset.dictionary, fail_index, flights.theta, dataset.theta_names
        return cls(RolloutFile(flights.y, *about, flights.flown), flown, dataset)


def no_rollouts(dictionary: Dictionary, dt: float | None) -> RolloutFile:
    """A file without rollouts, for recordings alone.   dt: [s], the usual one if None."""
    none = np.empty((0, 1, len(dictionary.measured)))
    return RolloutFile(none, dt or DatasetRecipe().dt, dictionary)


def _added(base: Dataset, read: RolloutFile, findings: Sequence[str]) -> tuple[Dataset, list[str]]:
    """The dataset with flown flights, which come last and are labelled by its limits."""
    n, specification = len(base.unsafe) + len(base.safe), base.specification
    limits = None if isinstance(specification, str) else specification
    assert read.fail_index is not None
    labelled, disagreements = labels(read.y[n:], read.fail_index[n:], limits)
    fail_index = np.concatenate([read.fail_index[:n], labelled])
    flights = _checked(replace(read, fail_index=fail_index), base.dictionary, None)
    made = Dataset.from_flights(flights, base.safe_times.shape[1])
    made = replace(
        made,
        recipe=base.recipe | made.recipe,
        specification=specification,
        n_safe_met=len(made.safe) + base.n_safe_met - len(base.safe),
    )
    return made, [*findings, *disagreements, *flights.findings]


def _labelled(
    read: RolloutFile, dictionary: Dictionary, requirements: Sequence[Requirement]
) -> LabelledFlights:
    """Flights that fail where a requirement is violated, regardless of later samples."""
    y = complete(dictionary, read.y, read.dt)
    for requirement in requirements:
        requirement.check_can_fail(y.shape[1], read.dt)
    fails = [requirement.first_violation(y, read.dt) for requirement in requirements]
    flights = _checked(replace(read, fail_index=np.min(fails, axis=0)), dictionary, None)
    words = " and ".join(requirement.text for requirement in requirements)
    return replace(flights, specification=f"requirement {words}")


def _checked(
    read: RolloutFile, dictionary: Dictionary, limits: Limits | IntervalLimits | None
) -> LabelledFlights:
    flights = LabelledFlights.of(
        read.y,
        dt=read.dt,
        channels=dictionary,
        fail_index=read.fail_index,
        limits=limits,
        theta=read.theta,
        theta_names=read.theta_names,
        flown=read.flown,
    )
    beyond = beyond_plausible(dictionary, flights.y)
    return replace(flights, findings=(*flights.findings, *beyond))


def _joined(
    rollouts: RolloutSources, dictionary: Dictionary, flown: Flown
) -> tuple[RolloutFile, tuple[str, ...]]:
    """The rollouts, then the flown ones, with computed channels; and the findings."""
    read, dataset = rollouts.read, rollouts.dataset
    y = complete(dictionary, read.y, read.dt)
    beside = Beside.of(y, read.dt, dictionary, {} if dataset is None else dataset.recipe)
    added = flown_rollouts(flown(dictionary), beside)
    if not len(added.y):
        reasons = "".join(f"; {text}" for text in added.findings)
        raise RolloutsError(f"the recordings show no manoeuvre: mark some in a scoring{reasons}")
    n, n_samples = len(y), max(y.shape[1], added.y.shape[1])
    shape = n + len(added.y), n_samples, len(dictionary)
    whole = empty_flights("all flights", shape, rollouts.most_bytes)
    whole[:n, : y.shape[1]], whole[n:, : added.y.shape[1]] = y, added.y
    given = np.full(n, UNLABELLED) if read.fail_index is None else read.fail_index
    theta: Array | None = None
    if read.theta is not None:
        theta = np.full((len(whole), read.theta.shape[1]), np.nan)
        theta[:n] = read.theta
    joined = replace(
        read,
        y=whole,
        dictionary=dictionary,
        fail_index=np.concatenate([given, added.fail_index]),
        theta=theta,
        flown=(*(read.flown or (None,) * n), *added.flown),
    )
    return joined, added.findings


def sent_rollouts(sent: SentRollouts, recordings: Recordings, most_bytes: int) -> RolloutSources:
    """The rollouts as sent; files are read in a separate process.

    TelemetryError; NotFound; NoSpace.
    """
    flown = partial(_stored, sent, recordings) if sent.recordings else None
    about = sent.channels, sent.limits, _unconfirmed(sent, recordings), most_bytes
    if sent.files:
        return RolloutSources(sent.read(most_bytes), flown, None, *about)
    assert flown is not None
    if sent.dataset:
        dataset = recordings.store.datasets.get(sent.dataset)
        beside = RolloutSources.beside(dataset, flown)
        return replace(beside, findings=about[2], most_bytes=most_bytes)
    dictionary, dt = LATERAL, sent.dt
    if scoring := next((each for each in sent.recordings if "/" in each), None):
        info = recordings.store.scorings.info(*scoring.split("/", 1))
        dictionary, dt = recordings.dictionary_of(info.monitor_id), dt or info.dt
    if sent.dictionary is not None:
        dictionary = sent.dictionary.dictionary
    return RolloutSources(no_rollouts(dictionary, dt), flown, None, *about)


def check_sent(sent: SentRollouts, recordings: Recordings, most_bytes: int) -> None:
    """Raise the errors of the job that would add them, if the check is fast.

    TelemetryError; ValueError; NotFound; NoSpace.
    """
    if sent.dataset or sent.n_bytes > MOST_CHECKED or len(sent.files) > MOST_FILES_CHECKED:
        return
    rollouts = sent_rollouts(sent, recordings, most_bytes)
    if rollouts.flown is None:
        rollouts.to_dataset()
    else:
        extended(rollouts.read.dictionary, rollouts.channels, rollouts.limits)


def _unconfirmed(sent: SentRollouts, recordings: Recordings) -> list[str]:
    infos = [recordings.store.recordings.info(each.split("/")[0]) for each in sent.recordings]
    names = [info.name for info in infos if info.mapping_state == "proposed"]
    if not names:
        return []
    return [f"the mapping of {', '.join(dict.fromkeys(names))} is not confirmed: check it"]


def _stored(
    sent: SentRollouts, recordings: Recordings, dictionary: Dictionary
) -> Iterator[FlownFlight]:
    """Stored recordings, under the mapping that scoring uses or a proposed one."""
    store = recordings.store
    failures = failures_of(sent.labels, recordings.names_of(sent.recordings))
    for given in dict.fromkeys(sent.recordings):
        recording_id, _, scoring_id = given.partition("/")
        info, marked = store.recordings.info(recording_id), None
        plain = store.recordings.mapped_columns(recording_id).mapping
        if scoring_id:
            scoring = store.scorings.info(recording_id, scoring_id)
            keys = recordings.dictionary_of(scoring.monitor_id).keys
            plain, marked = scoring.mapping, _marked(scoring, keys)
        elif not plain.get("channels", {}).keys() >= set(dictionary.measured):
            plain = recordings.proposed_for(recording_id, dictionary).mapping
        mapped = recordings.mapped(recording_id, Mapping.from_plain(plain))
        about = info.digest, _scorable(mapped, info.name), recording_id, marked
        yield FlownFlight(info.name, *about, failures.get(given))


def _marked(scoring: ScoringInfo, keys: Sequence[str]) -> tuple[Marked, ...]:
    detected = scoring.request["manoeuvres"] == "detected"
    return tuple(
        Marked(
            *(each["name"], each["start"], each["end"]),
            trim=dict(zip(keys, each["trim"], strict=True)),
            detected=detected,
        )
        for each in scoring.manoeuvres
    )


def recorded_files(
    paths: Sequence[Path], mapping: Mapping | None, outcomes: Iterable[str]
) -> Flown:
    """Recordings in files. TelemetryError.

    mapping: None to propose one for each.   outcomes: labels, see `failures_of`, by file name.
    """
    names = [path.name for path in paths]
    failures = failures_of(outcomes, dict(zip(names, names, strict=True)))

    def flown(dictionary: Dictionary) -> Iterator[FlownFlight]:
        for path in paths:
            with columns_of(path) as columns:
                chosen = mapping or propose(columns, dictionary=dictionary).mapping
                repaired = _scorable(MappedRecording.of(columns, chosen), path.name)
                about = path.name, digest_of(path), repaired
                yield FlownFlight(*about, failures=failures.get(path.name))

    return flown


def _scorable(mapped: MappedRecording, name: str) -> RepairedTraces:
    try:
        return mapped.scorable()
    except TelemetryError as error:
        raise TelemetryError(f"{name}: {error}") from error
