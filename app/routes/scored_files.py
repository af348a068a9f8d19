"""The report of a scored recording, and its samples as files for other programs."""

import asyncio
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import PurePath
from typing import Annotated, Any, BinaryIO, Literal
from urllib.parse import quote

from fastapi import Query, Response
from fastapi.responses import StreamingResponse

from app.http.head_requests import Router
from app.http.problems import problem_responses
from app.recordings.exports import EXPORTS, export
from app.recordings.files import reporting_full_disk
from app.report.page import report
from app.report.stored import stored_subject
from app.report.subject import about
from app.routes.dependencies import PAGE_TO_PRINT, ScoredDep

SENT_BYTES = 2**20
SAMPLES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "the samples",
        "content": {
            kind.media_type: {"schema": {"type": "string", "format": "binary"}}
            for kind in EXPORTS.values()
        },
    }
}
router = Router(
    prefix="/api/v1/recordings/{recording_id}/scorings/{scoring_id}", tags=["recordings"]
)


@router.get(
    "/report",
    responses=problem_responses(404, 422)
    | {200: {"description": "one HTML file", "content": {"text/html": {}}}},
    response_class=Response,
)
async def read_report(
    recording_id: str,
    scoring_id: str,
    scored: ScoredDep,
    download: Annotated[bool, Query(description="send as a download")] = False,
) -> Response:
    """The report as one self-contained HTML file to print."""

    def make() -> Response:
        subject = stored_subject(scored, recording_id, scoring_id)
        headers = dict(PAGE_TO_PRINT)
        if download:
            headers |= _as_file(f"{PurePath(subject.recording['name']).stem} report.html")
        return Response(report(subject), headers=headers, media_type="text/html")

    return await asyncio.to_thread(make)


@router.get(
    "/export",
    responses=problem_responses(404, 422) | SAMPLES,
    response_class=Response,
)
async def export_samples(
    recording_id: str,
    scoring_id: str,
    scored: ScoredDep,
    form: Annotated[Literal["csv", "parquet", "mat"], Query(alias="format")] = "csv",
) -> Response:
    """All samples with their assessments and units."""

    def make() -> Response:
        info = scored.store.scorings.info(recording_id, scoring_id)
        recording = scored.store.recordings.info(recording_id)
        samples, kind = scored.samples(info), EXPORTS[form]
        with ExitStack() as held:
            file = held.enter_context(scored.files.unnamed())
            with reporting_full_disk():
                export(samples, about(asdict(recording), asdict(info)), form, file)
                headers = {"Content-Length": str(file.tell())}
            headers |= _as_file(f"{PurePath(recording.name).stem} scored.{kind.ending}")
            held.pop_all()
        return StreamingResponse(_blocks(file), headers=headers, media_type=kind.media_type)

    return await asyncio.to_thread(make)


def _blocks(file: BinaryIO) -> Iterator[bytes]:
    """The file in blocks; it is closed afterwards."""
    with file:
        file.seek(0)
        while block := file.read(SENT_BYTES):
            yield block


def _as_file(name: str) -> dict[str, str]:
    """The header for a download under a name in any alphabet."""
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}"}
