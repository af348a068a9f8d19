"""The input of a report, from a stored scoring or a scored file; metadata of exported samples."""

import hashlib
from collections.abc import Iterator, Sequence
from collections.abc import Mapping as Plain
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy.typing as npt

from app.recordings.mapped_columns import plain, quality_of
from app.recordings.samples import digest
from app.recordings.scored import ScoredRecordings
from app.recordings.scored_file import Scored, ScoredFile, ScoreRequest
from app.store.recordings import MappedColumns, MappingState
from app.store.scorings import ScoringInfo
from app.store.tables import now
from app.telemetry.contents import Contents
from app.telemetry.mapping.mapping import Mapping
from core import __version__
from core.monitor import Monitor

PROPOSED = "proposed by the program, not confirmed"
"""Origin of a mapping without confirmation."""


@dataclass(frozen=True, eq=False)
class ReportSubject:
    """Everything a report needs; plain data except for the monitor and the samples.

    recording: name, digest, size, format, aircraft, and the fields of `of_contents`.
    scoring: as app.store.scorings.ScoringInfo, its mapping and manoeuvres plain.
    evaluation: the monitor's test on fresh flights; None if it was not tested.
    samples: as stored.   mapped: origin of the mapping, in words; "" where unknown.
    rationales: confidence and reasons of a proposed mapping, by key of TARGETS.
    markers: of the user: t, end, kind, text.
    """

    recording: Plain[str, Any]
    scoring: Plain[str, Any]
    monitor: Monitor
    monitor_name: str
    monitor_digest: str
    evaluation: Plain[str, Any] | None
    samples: npt.NDArray
    mapped: str = ""
    rationales: Plain[str, Plain[str, Any]] = field(default_factory=dict)
    markers: Sequence[Plain[str, Any]] = field(default=())


def of_contents(contents: Contents) -> dict[str, Any]:
    """The fields of a report about the file's contents."""
    return {
        "start": contents.start,
        "n_bad_rows": contents.n_bad_rows,
        "bad_rows": [asdict(row) for row in contents.bad_rows],
        "ignored": list(contents.ignored),
        "notes": list(contents.notes),
    }


def about(recording: Plain[str, Any], scoring: Plain[str, Any]) -> dict[str, Any]:
    """Metadata of exported samples: their origin, and the verdicts on them."""
    return {
        "recording": recording["name"],
        "recording_sha256": recording["digest"],
        "aircraft": recording["aircraft"],
        "monitor": scoring["monitor_name"],
        "monitor_sha256": scoring["monitor_digest"],
        "epsilon": scoring["epsilon"],
        "lead_s": scoring["lead"],
        "dt_s": scoring["dt"],
        "samples_sha256": scoring["digest"],
        "mapping": scoring["mapping"],
        "manoeuvres": scoring["manoeuvres"],
        "limits_in_force": scoring.get("limits_in_force"),
        "notes": scoring["notes"],
        "program": scoring["version"],
    }


MAPPED: dict[MappingState, str] = {
    "proposed": PROPOSED,
    "remembered": "as confirmed for an earlier recording",
    "confirmed": "confirmed by the user",
}


def stored_subject(scored: ScoredRecordings, recording_id: str, scoring_id: str) -> ReportSubject:
    """Load the subject. Raises NotFound or StoreError."""
    store = scored.store
    info = store.scorings.info(recording_id, scoring_id)
    recording = store.recordings.info(recording_id)
    monitor = store.monitors.get(info.monitor_id)
    contents = scored.recordings.columns(recording_id).contents
    mapped, rationales = _mapped(info, store.recordings.mapped_columns(recording_id))
    return ReportSubject(
        recording=asdict(recording) | of_contents(contents),
        scoring=asdict(info),
        monitor=monitor,
        monitor_name=info.monitor_name,
        monitor_digest=info.monitor_digest,
        evaluation=monitor.evaluation,
        samples=scored.samples(info),
        mapped=mapped,
        rationales=rationales,
        markers=[asdict(marker) for marker in store.markers.of(recording_id)],
    )


def _mapped(info: ScoringInfo, now: MappedColumns) -> tuple[str, dict[str, Any]]:
    """Origin of the scoring's mapping, and the rationales if the program proposed it."""
    if info.mapping != now.mapping:
        return "another mapping is in use now", {}
    proposed = now.mapping_state == "proposed"
    words = MAPPED[now.mapping_state]
    if warnings := now.confirmed_over:
        texts = "; ".join(f"{key}: {text}" for key, texts in warnings.items() for text in texts)
        words = f"{words} despite a warning ({texts})"
    return words, now.proposal.get("rationales", {}) if proposed else {}


GIVEN = "as given"


def file_subjects(
    request: ScoreRequest, scored_file: ScoredFile, aircraft: str | None
) -> Iterator[tuple[Scored, ReportSubject]]:
    """The report subject of each scoring of a file."""
    recording = {
        "name": request.file.name,
        "digest": _digest(request.file),
        "size": request.file.stat().st_size,
        "aircraft": aircraft,
        "format": scored_file.contents.format,
    } | of_contents(scored_file.contents)
    rationales = scored_file.proposal.rationales if scored_file.proposal else {}
    for scored in scored_file.scored:
        scoring = _scoring(scored, scored_file.mapping)
        yield (
            scored,
            ReportSubject(
                recording=recording,
                scoring=scoring,
                monitor=scored.monitor,
                monitor_name=scoring["monitor_name"],
                monitor_digest=scoring["monitor_digest"],
                evaluation=scored.monitor.evaluation,
                samples=scored.recording.samples,
                mapped=PROPOSED if scored_file.proposal else GIVEN,
                rationales={key: asdict(rationale) for key, rationale in rationales.items()},
            ),
        )


def _scoring(scored: Scored, mapping: Mapping) -> dict[str, Any]:
    """A scoring with the fields of a stored one."""
    recording, t = scored.recording, scored.recording.samples["t"]
    return {
        "monitor_name": scored.path.stem,
        "monitor_digest": _digest(scored.path),
        "created": now(),
        "version": __version__,
        "epsilon": recording.epsilon,
        "lead": scored.monitor.lead,
        "dt": recording.dt,
        "mapping": mapping.to_plain(),
        "n_samples": len(t),
        "start": float(t[0]),
        "end": float(t[-1]),
        "notes": list(recording.notes),
        "quality": quality_of(recording),
        "manoeuvres": [plain(manoeuvre.to_plain()) for manoeuvre in recording.manoeuvres],
        "outside_exceedances": [asdict(exceedance) for exceedance in recording.outside_exceedances],
        "limits_in_force": recording.limits_in_force,
        "digest": digest(recording.samples),
    }


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
