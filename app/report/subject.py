"""The input of a report, from a stored scoring or a scored file; metadata of exported samples."""

from collections.abc import Iterator, Sequence
from collections.abc import Mapping as Plain
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy.typing as npt

from app.recordings.files import digest_of
from app.recordings.samples import digest
from app.recordings.scored import ScoredRecordings, scoring_fields
from app.recordings.scored_file import Scored, ScoredFile, ScoreRequest
from app.store.recordings import MappedColumns, MappingState
from app.store.scorings import ScoringInfo
from app.telemetry.contents import Contents
from core.monitor import Monitor

PROPOSED = "proposed by the program, not confirmed"
"""Origin of a mapping without confirmation."""


@dataclass(frozen=True, eq=False)
class ReportSubject:
    """Everything a report needs; plain data except for the monitor and the samples.

    recording: name, digest, size, format, aircraft, and the fields of `of_contents`.
    scoring: as app.store.scorings.ScoringInfo, its mapping and manoeuvres plain.
    samples: as stored.   mapped: origin of the mapping, in words; "" where unknown.
    rationales: confidence and reasons of a proposed mapping, by key of TARGETS.
    markers: of the user: t, end, kind, text.
    """

    recording: Plain[str, Any]
    scoring: Plain[str, Any]
    monitor: Monitor
    samples: npt.NDArray
    mapped: str = ""
    rationales: Plain[str, Plain[str, Any]] = field(default_factory=dict)
    markers: Sequence[Plain[str, Any]] = field(default=())


def of_contents(contents: Contents) -> dict[str, Any]:
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
    contents = scored.recordings.columns(recording_id).contents
    mapped, rationales = _mapped(info, store.recordings.mapped_columns(recording_id))
    return ReportSubject(
        recording=asdict(recording) | of_contents(contents),
        scoring=asdict(info),
        monitor=store.monitors.get(info.monitor_id),
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


def file_subjects(
    request: ScoreRequest, scored_file: ScoredFile, aircraft: str | None
) -> Iterator[tuple[Scored, ReportSubject]]:
    """The report subject of each scoring of a file."""
    recording = {
        "name": request.file.name,
        "digest": digest_of(request.file),
        "size": request.file.stat().st_size,
        "aircraft": aircraft,
        "format": scored_file.contents.format,
    } | of_contents(scored_file.contents)
    rationales = scored_file.proposal.rationales if scored_file.proposal else {}
    mapping = scored_file.mapping.to_plain()
    for scored in scored_file.scored:
        by_set, fields = scored.by_set, scoring_fields(scored.recording, scored.monitor, mapping)
        scoring = {
            "digest": digest(scored.recording.samples),
        } | fields
        if by_set:
            scoring |= {
                "monitor_name": f"monitor set {by_set.in_use.name}",
                "monitor_digest": by_set.digest,
                "request": {"monitor_set": by_set.in_use.to_plain()},
            }
        else:
            scoring |= {"monitor_name": scored.path.stem, "monitor_digest": digest_of(scored.path)}
        subject = ReportSubject(
            recording=recording,
            scoring=scoring,
            monitor=scored.monitor,
            samples=scored.recording.samples,
            mapped=PROPOSED if scored_file.proposal else "as given",
            rationales={key: asdict(rationale) for key, rationale in rationales.items()},
        )
        yield scored, subject
