"""Recordings: telemetry files that are uploaded, read, mapped and kept."""

import asyncio
from typing import Annotated, Any

from fastapi import Query, Request
from starlette.requests import ClientDisconnect

from app.http.head_requests import Router
from app.http.problems import Problem, problem_responses
from app.recordings.answers import preview, recording_answer, signal_bands
from app.recordings.recordings import Abandoned, Upload
from app.recordings.training_proposal import training_proposal
from app.recordings.upload import plain_name
from app.routes.dependencies import (
    RecordingsDep,
    json_from,
    json_response,
)
from app.routes.recording_models import (
    MappingRequest,
    Preview,
    PreviewRequest,
    RecordingDetails,
    SignalPreview,
    TrainingProposal,
)
from app.routes.sent_files import CONTENT, sent_file
from app.store.recordings import RecordingInfo
from app.telemetry.mapping.mapping import Mapping

router = Router(prefix="/api/v1/recordings", tags=["recordings"])
LONGEST_NAME = 255
UNNAMED = "upload"
"""What a file is called whose sender does not say."""


@router.post(
    "",
    status_code=201,
    response_model=RecordingDetails,
    responses=problem_responses(408, 413, 415, 422, 429, 507)
    | {
        201: {
            "description": "read and kept",
            "headers": {"Location": {"description": "the recording", "schema": {"type": "string"}}},
        }
    },
    openapi_extra={"requestBody": {"required": True, "content": CONTENT}},
)
async def upload_recording(
    request: Request,
    recordings: RecordingsDep,
    name: Annotated[
        str | None,
        Query(min_length=1, max_length=LONGEST_NAME, description="of the file; else the form's"),
    ] = None,
    aircraft: Annotated[
        str | None,
        Query(min_length=1, max_length=200, description="its mapping is proposed, if one is kept"),
    ] = None,
):
    """Upload a file of telemetry in a form or as the body itself, of any format in the catalog.

    `curl -F file=@flight.csv URL`, or `curl --data-binary @flight.csv 'URL?name=flight.csv'` with
    any content type. It is read at once and a mapping of its signals is proposed: check it before
    you score.
    """
    sent = await sent_file(request)
    given = name or sent.name[-LONGEST_NAME:] or UNNAMED
    if not (shown := plain_name(given)):
        raise Problem(422, f"the name {given!r} names no file", "urn:forewarn:request")
    length = request.headers.get("content-length", "")
    upload = Upload(
        shown,
        aircraft,
        int(length) if length.isdigit() else None,
        sent.content,
        request.is_disconnected,
    )
    try:
        recording_id = await recordings.receive(upload)
    except (ClientDisconnect, Abandoned):
        raise Problem(408, "the upload was interrupted: nothing of it is kept") from None
    location = {"Location": f"/api/v1/recordings/{recording_id}"}
    answer = await asyncio.to_thread(recording_answer, recordings, recording_id)
    return json_response(answer, 201, location)


@router.get("")
async def list_recordings(recordings: RecordingsDep) -> list[RecordingInfo]:
    """All recordings, newest first."""
    return await asyncio.to_thread(recordings.store.recordings.all)


@router.get("/{recording_id}", response_model=RecordingDetails, responses=problem_responses(404))
async def read_recording(recording_id: str, recordings: RecordingsDep):
    """One recording: what it holds, and what its signals are taken for."""
    return await json_from(recording_answer, recordings, recording_id)


@router.delete("/{recording_id}", status_code=204, responses=problem_responses(404, 409))
async def delete_recording(recording_id: str, recordings: RecordingsDep) -> None:
    """Delete a recording with its scorings and markers; 409 while it is flown or kept for ever."""
    await asyncio.to_thread(recordings.delete, recording_id)


@router.put(
    "/{recording_id}/mapping",
    response_model=RecordingDetails,
    responses=problem_responses(404, 422),
)
async def confirm_mapping(recording_id: str, request: MappingRequest, recordings: RecordingsDep):
    """Say which signal is which channel; it is proposed for the next recording of the aircraft.

    Scorings made before keep the mapping that they were made with. 422 where it cannot be applied.
    """

    def confirm() -> dict[str, Any]:
        mapping = Mapping.from_plain(request.mapping.to_plain())
        recordings.confirm_mapping(
            recording_id, mapping, request.aircraft, remember=request.remember
        )
        return recording_answer(recordings, recording_id)

    return await json_from(confirm)


@router.post(
    "/{recording_id}/preview", response_model=Preview, responses=problem_responses(404, 422)
)
async def preview_mapping(recording_id: str, request: PreviewRequest, recordings: RecordingsDep):
    """What comes of a mapping: each channel in a few bins, and its quality; nothing is kept.

    `problem` says why it cannot be applied; there are no channels then.
    """

    def answer() -> dict[str, Any]:
        mapping = Mapping.from_plain(request.mapping.to_plain())
        return preview(recordings, recording_id, mapping, request.bins)

    return await json_from(answer)


@router.get(
    "/{recording_id}/signals/{index}/preview",
    response_model=SignalPreview,
    responses=problem_responses(404, 422),
)
async def preview_signal(recording_id: str, index: int, recordings: RecordingsDep):
    """A signal as the file holds it, in a few bins; `index` counts the signals of the contents."""
    return await json_from(signal_bands, recordings, recording_id, index)


@router.get(
    "/{recording_id}/training-proposal",
    response_model=TrainingProposal,
    responses=problem_responses(404, 422, 429),
)
async def propose_training(
    recording_id: str,
    recordings: RecordingsDep,
    monitor: Annotated[
        str | None, Query(description="id of a monitor whose limits and lead are proposed")
    ] = None,
):
    """A partial body of `POST /monitors` for the manoeuvre of a recording.

    Use it where no monitor fits the recording. The largest control input is compared with the
    catalog's cards. Add the aircraft, which no recording names, at `recipe.dataset.aircraft`;
    `reasons` explains each proposal. Where `can_train` is false, no method works without
    `missing_channels`.
    """
    run = recordings.workers.run
    return json_response(await run(training_proposal, recordings, recording_id, monitor))
