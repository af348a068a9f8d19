"""Score recordings by monitors, and store the samples with all inputs that determine them.

The samples are in the recording's folder; their row in the database is stored last. Equal requests
give equal samples, so a repeated request returns the stored scoring.
"""

import hashlib
import json
from collections import abc
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

from app.assessment import ScoredRecording, ScoringRecipe, score
from app.assessment.limits_history import (
    InForceTimeline,
    LimitsHistory,
    SetHistory,
    limits_over_time,
)
from app.assessment.monitors_in_use import MonitorsInUse
from app.recordings.mapped_columns import plain, quality_of
from app.recordings.recordings import Recordings
from app.recordings.samples import (
    Samples,
    digest,
    open_samples,
    open_tiles,
    remove,
    save_samples,
)
from app.recordings.tiles import Window, window_between
from app.store.condition_sets import MonitorSetInfo
from app.store.scorings import ScoringInfo
from app.store.store import Store
from app.store.tables import new_id, now
from app.telemetry.mapping.mapping import Mapping
from core import __version__
from core.conditions import ConditionKey
from core.flight_events import FLIGHT_MARKERS
from core.kernels.compiled import threads
from core.monitor import Monitor
from core.monitor.monitor_set import MonitorCase, MonitorSet


class SetRequest(NamedTuple):
    """A monitor set to score by. declared: values of the flight condition, over recorded ones."""

    info: MonitorSetInfo
    declared: abc.Mapping[ConditionKey, float]

    def to_plain(self) -> dict[str, Any]:
        """For the scoring, since the set may be deleted."""
        return {
            "id": self.info.id,
            "name": self.info.name,
            "cases": [asdict(case) for case in self.info.cases],
            "condition": dict(self.declared),
        }


class ScoredRecordings:
    """Scorings of the recordings of a server."""

    def __init__(self, recordings: Recordings) -> None:
        self.recordings = recordings
        self.store, self.files = recordings.store, recordings.files

    async def score(
        self,
        recording_id: str,
        monitor_id: str,
        recipe: ScoringRecipe,
        by_set: SetRequest | None = None,
    ) -> tuple[ScoringInfo, bool]:
        """Score a recording; return the stored scoring, and whether it is new.

        by_set: each sample by the monitor in use, of which `monitor_id` is the first.
        NotFound, also if the recording is deleted meanwhile; EpsilonError; TelemetryError;
        NoSpace; Busy.
        """
        work = self.recordings.workers.run
        return await work(self._score, recording_id, monitor_id, recipe, by_set)

    def samples(self, info: ScoringInfo) -> Samples:
        """The samples of a scoring, memory-mapped. NotFound; StoreError."""
        with self.recordings.present(info.recording_id):
            folder = self.files.scorings(info.recording_id)
            return open_samples(folder, info.id, info.digest, self.files.verified)

    def window(
        self, info: ScoringInfo, start: float, end: float, bins: int
    ) -> tuple[Samples, Window]:
        """The samples, and those from start to end [s] in at most `bins` bins. NotFound."""
        with self.recordings.present(info.recording_id):
            folder = self.files.scorings(info.recording_id)
            about = folder, info.id, info.digest, self.files.verified
            samples, tiles = open_samples(*about), open_tiles(*about)
        return samples, window_between(samples, tiles, start, end, bins)

    def delete(self, recording_id: str, scoring_id: str) -> None:
        """Delete a scoring with its samples. NotFound; InUse during a flight."""
        self.store.scorings.delete(recording_id, scoring_id)
        remove(self.files.scorings(recording_id), scoring_id)

    def _score(
        self,
        recording_id: str,
        monitor_id: str,
        recipe: ScoringRecipe,
        by_set: SetRequest | None,
    ) -> tuple[ScoringInfo, bool]:
        monitor, info = self.store.monitors.get(monitor_id), self.store.monitors.info(monitor_id)
        recipe = replace(recipe, epsilon=monitor.check_epsilon(recipe.epsilon))
        plain = self.store.recordings.mapped_columns(recording_id).mapping
        digest_of_file = self.store.recordings.info(recording_id).digest
        request = recipe.to_plain() | ({} if by_set is None else {"monitor_set": by_set.to_plain()})
        calls = self._calls(recording_id)
        request |= {"calls": calls} if calls else {}
        inputs = [digest_of_file, plain, info.id, info.digest, request, __version__]
        inputs_digest = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()
        if stored := self.store.scorings.find(recording_id, inputs_digest):
            self.samples(stored)
            return stored, False
        mapping = Mapping.from_plain(plain)
        recorded = self.recordings.mapped(recording_id, mapping).scorable()
        history = self._history(recording_id, mapping, by_set)
        scored = score(monitor, recorded, recipe, history, digest_of_file, calls)
        folder, scoring_id = self.files.scorings(recording_id), new_id()
        self.files.require(2 * scored.samples.nbytes)
        hashed = threads().submit(digest, scored.samples)
        try:
            with self.recordings.present(recording_id):
                save_samples(folder, scoring_id, scored.samples)
            scoring = ScoringInfo(
                id=scoring_id,
                recording_id=recording_id,
                monitor_id=info.id,
                monitor_name=info.name,
                monitor_digest=info.digest,
                specification=info.specification,
                request_digest=inputs_digest,
                request=request,
                digest=hashed.result(),
                **scoring_fields(scored, monitor, plain),
            )
            stored = self.store.scorings.add(scoring)
        except BaseException:
            remove(folder, scoring_id)
            raise
        if stored.id != scoring_id:
            remove(folder, scoring_id)
        return stored, stored.id == scoring_id

    def limits_timeline(
        self, info: ScoringInfo, monitors: Sequence[Monitor]
    ) -> InForceTimeline | None:
        """Limits in force over time for monitors, see `limits_over_time`."""
        history = self._history(info.recording_id, Mapping.from_plain(info.mapping))
        return limits_over_time(history, monitors)

    def _calls(self, recording_id: str) -> list[float]:
        """Times of ABORT and KNOCK IT OFF among the markers of a recording [s]."""
        words = FLIGHT_MARKERS["abort"].word, FLIGHT_MARKERS["knock_it_off"].word
        markers = self.store.markers.of(recording_id)
        return [marker.t for marker in markers if marker.text.startswith(words)]

    def _history(
        self, recording_id: str, mapping: Mapping, by_set: SetRequest | None = None
    ) -> LimitsHistory | SetHistory | None:
        with self.recordings.present(recording_id):
            columns = self.recordings.columns(recording_id)
            if by_set is None:
                return LimitsHistory.of(columns, mapping)
            in_use = set_in_use(self.store, by_set.info, by_set.declared)
            return SetHistory.of(columns, mapping, in_use)


def set_in_use(
    store: Store, info: MonitorSetInfo, declared: abc.Mapping[ConditionKey, float]
) -> MonitorsInUse:
    """A stored set with its monitors; slow, for a thread. NotFound."""
    cases = tuple(
        MonitorCase(case.name, case.ranges, store.monitors.get(case.monitor)) for case in info.cases
    )
    ids = tuple(case.monitor for case in info.cases)
    names = tuple(case.monitor_name for case in info.cases)
    return MonitorsInUse(info.id, info.name, MonitorSet(cases), ids, names, declared)


def scoring_fields(
    scored: ScoredRecording, monitor: Monitor, mapping: dict[str, Any]
) -> dict[str, Any]:
    """The fields of a ScoringInfo that the result alone gives. mapping: plain."""
    t, in_force = scored.samples["t"], scored.limits_in_force
    return {
        "created": now(),
        "version": __version__,
        "epsilon": scored.epsilon,
        "lead": monitor.lead,
        "dt": scored.dt,
        "mapping": mapping,
        "n_samples": len(t),
        "start": float(t[0]),
        "end": float(t[-1]),
        "notes": list(scored.notes),
        "quality": quality_of(scored),
        "manoeuvres": [plain(asdict(manoeuvre)) for manoeuvre in scored.manoeuvres],
        "outside_exceedances": [asdict(exceedance) for exceedance in scored.outside_exceedances],
        "limits_in_force": None if in_force is None else list(in_force),
    }
