"""The report subject of a stored scoring."""

from dataclasses import asdict
from typing import Any

from app.recordings.scored import ScoredRecordings
from app.report.subject import PROPOSED, ReportSubject, of_contents
from app.store.recordings import MappedColumns, MappingState
from app.store.scorings import ScoringInfo

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
