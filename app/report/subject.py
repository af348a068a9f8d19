"""What a report and an export are made of: a stored scoring with all that it hangs on."""

from dataclasses import asdict
from typing import Any

from app.entries import ScoringInfo
from app.report.page import ReportSubject
from app.scored_recordings import ScoredRecordings
from app.telemetry.contents import Contents


def stored_subject(scored: ScoredRecordings, recording_id: str, scoring_id: str) -> ReportSubject:
    """A stored scoring, ready to report. NotFound; StoreError."""
    store = scored.store
    info = store.scoring(recording_id, scoring_id)
    recording = store.recording_info(recording_id)
    contents = scored.recordings.columns(recording_id).contents
    return ReportSubject(
        recording=asdict(recording) | of_contents(contents),
        scoring=asdict(info),
        monitor=store.monitor(info.monitor_id),
        monitor_name=info.monitor_name,
        monitor_digest=info.monitor_digest,
        evaluation=store.evaluation(info.monitor_id),
        samples=scored.samples(info),
        markers=[asdict(marker) for marker in store.markers(recording_id)],
    )


def of_contents(contents: Contents) -> dict[str, Any]:
    """What a report says of the file's contents."""
    return {
        "start": contents.start,
        "n_bad_rows": contents.n_bad_rows,
        "bad_rows": [asdict(row) for row in contents.bad_rows],
        "notes": contents.notes,
    }


def about(scored: ScoredRecordings, info: ScoringInfo) -> dict[str, Any]:
    """What is kept beside exported samples: where they come from, and what they are worth."""
    recording = scored.store.recording_info(info.recording_id)
    return {
        "recording": recording.name,
        "recording_sha256": recording.digest,
        "aircraft": recording.aircraft,
        "monitor": info.monitor_name,
        "monitor_sha256": info.monitor_digest,
        "epsilon": info.epsilon,
        "lead_s": info.lead,
        "dt_s": info.dt,
        "samples_sha256": info.digest,
        "mapping": info.mapping,
        "manoeuvres": info.stretches,
        "notes": info.notes,
        "program": info.version,
    }
