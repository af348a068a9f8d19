"""Report subjects from the scorings of a file, for `forewarn report`."""

import hashlib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.recordings.mapped_columns import plain, quality_of
from app.recordings.samples import digest
from app.recordings.scored_file import Scored, ScoredFile, ScoreRequest
from app.report.subject import PROPOSED, ReportSubject, of_contents
from app.store.tables import now
from app.telemetry.mapping.mapping import Mapping
from core import __version__

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
