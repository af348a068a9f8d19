"""Scorings of a file as subjects of reports: what `forewarn report` is made of."""

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
    """Each scoring of a file, ready to report."""
    recording = {
        "name": request.file.name,
        "digest": _digest(request.file),
        "size": request.file.stat().st_size,
        "aircraft": aircraft,
        "format": scored_file.contents.format,
    } | of_contents(scored_file.contents)
    rationales = scored_file.proposal.rationales if scored_file.proposal else {}
    for one in scored_file.scored:
        scoring = _scoring(one, scored_file.mapping)
        yield (
            one,
            ReportSubject(
                recording=recording,
                scoring=scoring,
                monitor=one.monitor,
                monitor_name=scoring["monitor_name"],
                monitor_digest=scoring["monitor_digest"],
                evaluation=one.monitor.evaluation,
                samples=one.recording.samples,
                mapped=PROPOSED if scored_file.proposal else GIVEN,
                rationales={key: asdict(rationale) for key, rationale in rationales.items()},
            ),
        )


def _scoring(one: Scored, mapping: Mapping) -> dict[str, Any]:
    """A scoring as the store would keep it."""
    scored, t = one.recording, one.recording.samples["t"]
    return {
        "monitor_name": one.path.stem,
        "monitor_digest": _digest(one.path),
        "created": now(),
        "version": __version__,
        "epsilon": scored.epsilon,
        "lead": one.monitor.lead,
        "dt": scored.dt,
        "mapping": mapping.to_plain(),
        "n_samples": len(t),
        "start": float(t[0]),
        "end": float(t[-1]),
        "notes": list(scored.notes),
        "quality": quality_of(scored),
        "manoeuvres": [plain(manoeuvre.to_plain()) for manoeuvre in scored.manoeuvres],
        "outside_exceedances": [asdict(exceedance) for exceedance in scored.outside_exceedances],
        "limits_in_force": scored.limits_in_force,
        "digest": digest(scored.samples),
    }


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
