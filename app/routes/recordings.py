"""Recordings: upload, map, preview, propose a training, delete."""

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
"""Name of a file sent without one."""


@router.post(
    "",
    status_code=201,
    response_model=RecordingDetails,
    responses=problem_responses(408, 413, 415, 422, 429, 507)
    | {
        201: {
            "description": "read and stored",
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
        Query(
            min_length=1,
            max_length=LONGEST_NAME,
            description="name of the file; if absent, that of the form",
        ),
    ] = None,
    aircraft: Annotated[
        str | None,
        Query(
            min_length=1, max_length=200, description="propose the stored mapping of this aircraft"
        ),
    ] = None,
):
    """Upload a telemetry file in any format of the catalog, in a form or as the body.

    `curl -F file=@flight.csv URL`, or `curl --data-binary @flight.csv 'URL?name=flight.csv'` with
    any content type. The server reads it at once and proposes a mapping of its signals: check it
    before scoring.
    """
    sent = await sent_file(request)
    sent_name = name or sent.name[-LONGEST_NAME:] or UNNAMED
    if not (file_name := plain_name(sent_name)):
        raise Problem(
            422,
            f"{sent_name!r} is not a file name: give a name with letters or digits",
            "urn:forewarn:request",
        )
    length = request.headers.get("content-length", "")
    upload = Upload(
        file_name,
        aircraft,
        int(length) if length.isdigit() else None,
        sent.content,
        request.is_disconnected,
    )
    try:
        recording_id = await recordings.receive(upload)
    except (ClientDisconnect, Abandoned):
        raise Problem(
            408, "the upload was interrupted and not stored: send the file again"
        ) from None
    location = {"Location": f"/api/v1/recordings/{recording_id}"}
    answer = await asyncio.to_thread(recording_answer, recordings, recording_id)
    return json_response(answer, 201, location)


@router.get("")
async def list_recordings(recordings: RecordingsDep) -> list[RecordingInfo]:
    """All recordings, newest first."""
    return await asyncio.to_thread(recordings.store.recordings.all)


@router.get("/{recording_id}", response_model=RecordingDetails, responses=problem_responses(404))
async def read_recording(recording_id: str, recordings: RecordingsDep):
    """One recording with its contents and mapping."""
    return await json_from(recording_answer, recordings, recording_id)


@router.delete("/{recording_id}", status_code=204, responses=problem_responses(404, 409))
async def delete_recording(recording_id: str, recordings: RecordingsDep) -> None:
    """Delete a recording, its scorings and markers; 409 if it is flown or kept permanently."""
    await asyncio.to_thread(recordings.delete, recording_id)


@router.put(
    "/{recording_id}/mapping",
    response_model=RecordingDetails,
    responses=problem_responses(404, 422),
)
async def confirm_mapping(recording_id: str, request: MappingRequest, recordings: RecordingsDep):
    """Confirm the mapping of signals to channels.

    It is proposed for the next recording of the aircraft. Earlier scorings keep their mapping. 422
    if the mapping cannot be applied.
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
    """Try a mapping without storing it: each channel in bins, and the quality.

    If the mapping cannot be applied, `problem` has the reason and there are no channels.
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
    """A signal of the file in bins. index: its place in the signals of the contents."""
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
