"""Datasets: simulated trajectories with labels, or rollouts of any simulator."""

import asyncio
import io
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field
from starlette.requests import ClientDisconnect

from app.access.guard import too_large
from app.catalog import amplitude_request_schema, dataset_request_schema
from app.http.problems import Problem, content_type, problem_responses
from app.jobs.jobs import Jobs
from app.jobs.kinds import add_rollouts
from app.jobs.kinds import simulate_dataset as run
from app.jobs.requests import amplitude_suggestion, dataset_request
from app.recipes.recipes import RecipeError, to_plain
from app.recordings.flown_flights import check_sent, sent_rollouts
from app.recordings.recordings import Recordings
from app.recordings.rollouts import SentRollouts, preview_of
from app.routes.dependencies import (
    JobsDep,
    PlainBody,
    RecordingsDep,
    SettingsDep,
    StoreDep,
    body_of,
    declared_length,
    file_of,
    json_response,
    parse_object,
    refused,
)
from app.routes.jobs import accepted, queued
from app.routes.sent_files import BINARY, FORM, sent_fields
from app.settings import Settings
from app.store.datasets import DatasetInfo
from app.store.jobs import JobInfo
from app.store.store import Store
from core.channels import Dictionary

router = APIRouter(prefix="/api/v1/datasets", tags=["datasets"])
Outcome = Literal["unsafe", "safe"]
MOST_ROLLOUTS = 500


class Rollout(BaseModel):
    """One simulated flight up to its failure; telemetry as arrays in SI units."""

    n: int = Field(description="number in the dataset; unsafe rollouts are numbered first")
    outcome: Outcome
    fail_index: int | None = Field(description="first sample that exceeds a limit; null if none")
    theta: dict[str, float] = Field(description="parameters of the aircraft, by name")
    telemetry: dict[str, list[float | None]] = Field(
        description="t [s] and each channel [rad, rad/s, g]", examples=[{"t": [0.0], "Ny": [0.0]}]
    )


class SuggestedAmplitude(BaseModel):
    """An amplitude, and the result of a pilot run at it."""

    amplitude_deg: float = Field(description="amplitude, or the peak of a table [deg]")
    share: float = Field(description="share of the pilot rollouts that exceeded a limit")
    n_rollouts: int
    maneuver: dict[str, Any] = Field(
        description="the manoeuvre with this amplitude, for use in a recipe"
    )


class ChannelRange(BaseModel):
    """Values of a channel in all flights, in its unit."""

    low: float | None
    high: float | None
    rest: float | None = Field(description="in trimmed flight: the median first value")


class RolloutPreview(BaseModel):
    """Contents of files of rollouts."""

    dictionary: dict[str, Any] = Field(description="name and channels, as `dictionary` takes them")
    ranges: dict[str, ChannelRange] = Field(description="by channel")
    n_flights: int
    n_samples: int = Field(description="of the longest flight")
    dt: float = Field(description="sample interval [s]")
    n_failing: int | None = Field(description="flights labelled as failing; null without labels")
    n_flown: int = Field(description="flown ones, of recordings")
    findings: list[str] = Field(description="what is left out of recordings")
    theta_names: list[str] = Field(description="parameters of each flight")


_FIELDS = {
    "name": "of the dataset; that of the first file if absent",
    "dictionary": "channels as JSON or CSV; made from the files if absent",
    "channel": "computed: KEY [UNIT] = FORMULA, one a line, or sent several times",
    "limit": "KEY=LOW..HIGH, or a requirement such as `always (Nz < 4.9 or alpha < 0.2)`; one a "
    "line, or sent several times",
    "dt": "sample interval [s], if the files do not give it",
    "recording": "id of a recording, whose manoeuvres become rollouts, or RECORDING/SCORING for "
    "those of a scoring; one a line, or sent several times",
    "label": "RECORDING=safe, or RECORDING=TIME of failure [s], several with commas; one a line, "
    "or sent several times",
    "dataset": "id of stored rollouts that the recordings join",
}
_FILES = {
    "description": "arrays or a table of many flights; or, sent several times, one file for each "
    "flight",
    "anyOf": [BINARY, {"type": "array", "items": BINARY}],
}
_ROLLOUTS: dict[str, Any] = {
    FORM: {
        "schema": {
            "title": "Rollouts in a form",
            "type": "object",
            "properties": {"file": _FILES}
            | {name: {"type": "string", "description": text} for name, text in _FIELDS.items()},
        },
        "example": {"file": "doublets.npz", "limit": "Nz=-1.1..2.9g"},
    }
}
_BODY = body_of(
    dataset_request_schema(),
    {
        "name": "F-16 rudder doublet",
        "aircraft": {"kind": "f16_sl_h0_v502"},
        "maneuver": {"kind": "rudder_doublet", "amplitude_deg": 9.5},
        "limits": {"Ny": 0.5},
        "dt": 0.05,
        "n_unsafe": 50,
        "seed": 1,
    },
)
_BODY["requestBody"]["content"] |= _ROLLOUTS


@router.post("", **queued(408, 429, 507), openapi_extra=_BODY)
async def add_dataset(
    request: Request,
    store: StoreDep,
    jobs: JobsDep,
    settings: SettingsDep,
    recordings: RecordingsDep,
) -> JobInfo:
    """Simulate a planned test until `n_unsafe` rollouts are unsafe, or add rollouts; starts a job.

    The defaults of a JSON body are those of `forewarn train`: the catalog's default with the noise,
    jitter and imperfections of flight; `"imperfections": "none"` omits these. Angles are in
    radians, N_y is in g, and names ending in `_deg` are in degrees.

    A form has files of rollouts of any simulator:
    `curl -F file=@doublets.npz -F limit=Nz=-1.1..2.9g URL`. They may be npz, MATLAB or HDF5 arrays,
    a long table with a column `flight`, or one file for each flight. Recordings join by themselves,
    beside files, or beside a stored dataset, with its channels and limits:
    `curl -F recording=ID -F recording=ID -F dataset=ID URL`. Each of their manoeuvres is a rollout,
    on the grid and from trim as scoring takes it. Files up to 32 MB are checked at once, larger
    ones by the job. Its result has the dataset's id and `findings`: what was left out, or looks
    implausible.
    """
    for key in request.query_params:
        raise RecipeError(f"the address has {key}=: give it in the body")
    if content_type(request) == "application/json":
        plain = await _recipe_of(request, settings)
        return await _simulate(plain, store, jobs, settings)
    sent = await _received(request, recordings)
    work = sent, recordings, settings.max_array_bytes
    drop = partial(recordings.drop_rollouts, sent)
    try:
        with refused(422, "rollouts", ValueError):
            await recordings.readers.run(check_sent, *work)
    except BaseException:
        await asyncio.to_thread(drop)
        raise
    return await accepted(jobs, "dataset", sent.as_plain(), add_rollouts, *work, release=drop)


@router.post(
    "/preview",
    responses=problem_responses(408, 429, 507),
    openapi_extra={"requestBody": {"required": True, "content": _ROLLOUTS}},
)
async def preview_rollouts(
    request: Request, settings: SettingsDep, recordings: RecordingsDep
) -> RolloutPreview:
    """Read files of rollouts, or recordings, without storing them: channels, units and ranges.

    Set roles and limits by these, then send the files with `dictionary` and `limit`.
    """
    sent = await _received(request, recordings)
    try:
        about = sent, recordings, settings.max_array_bytes
        return json_response(await recordings.readers.run(_preview, *about))
    finally:
        await asyncio.to_thread(recordings.drop_rollouts, sent)


def _preview(sent: SentRollouts, recordings: Recordings, most_bytes: int) -> dict[str, Any]:
    read, findings = sent_rollouts(sent, recordings, most_bytes).joined()
    return preview_of(read) | {"findings": findings}


async def _received(request: Request, recordings: Recordings) -> SentRollouts:
    if (kind := content_type(request)) != FORM:
        raise Problem(415, f"the body has content type {kind or 'none'}: send JSON, or a form")
    try:
        return await recordings.receive_rollouts(sent_fields(request), declared_length(request))
    except ClientDisconnect:
        text = "the upload was interrupted and nothing is stored: send the files again"
        raise Problem(408, text) from None


async def _recipe_of(request: Request, settings: Settings) -> dict[str, Any]:
    """A JSON body, which is smaller than files may be."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > settings.max_body_bytes:
            raise too_large(settings.max_body_bytes)
    return await asyncio.to_thread(parse_object, bytes(body))


async def _simulate(plain: dict[str, Any], store: Store, jobs: Jobs, settings: Settings) -> Any:
    name, recipe = await asyncio.to_thread(dataset_request, plain, settings.max_array_bytes)
    details = {"name": name} | to_plain(recipe)
    return await accepted(jobs, "dataset", details, run, name, recipe, store)


@router.post(
    "/amplitude",
    openapi_extra=body_of(
        amplitude_request_schema(),
        {"aircraft": {"kind": "attas_id_16kft"}, "limits": {"Ny": 0.2}, "share": 0.25},
    ),
)
def read_suggested_amplitude(plain: PlainBody, settings: SettingsDep) -> SuggestedAmplitude:
    """Suggest the amplitude at which a given share of the rollouts exceeds a limit.

    A short pilot run finds it. The body is that of a dataset; only the sign of its amplitude is
    used, and a table is scaled as a whole. The same seed suggests the same amplitude. 422 with the
    reason if no amplitude fits. `"auto"` as `amplitude_deg` in a dataset recipe requests this
    amplitude.
    """
    suggestion, maneuver = amplitude_suggestion(plain, settings.max_array_bytes)
    return json_response(asdict(suggestion) | {"maneuver": to_plain(maneuver)})


@router.get("")
def list_datasets(store: StoreDep) -> list[DatasetInfo]:
    """All datasets, newest first."""
    return store.datasets.all()


@router.get("/{dataset_id}")
def read_dataset(dataset_id: str, store: StoreDep) -> DatasetInfo:
    """One dataset, without its arrays."""
    return store.datasets.info(dataset_id)


@router.delete("/{dataset_id}", status_code=204, responses=problem_responses(409))
def delete_dataset(dataset_id: str, store: StoreDep) -> None:
    """Delete a dataset; 409 with their names if monitors were trained on it."""
    store.datasets.delete(dataset_id)


@router.get(
    "/{dataset_id}/arrays",
    response_class=Response,
    responses=file_of("application/octet-stream", "npz archive of the dataset"),
)
def read_arrays(dataset_id: str, store: StoreDep) -> Response:
    """The dataset's arrays as npz: unsafe, fail_index, safe, safe_times, theta_unsafe and others.

    `channels` and `units` name the columns of `unsafe` and `safe`; dt is in seconds.
    """
    body = _arrays(store, dataset_id)
    headers = {"Content-Disposition": f'attachment; filename="dataset-{dataset_id}.npz"'}
    return Response(body, 200, headers, "application/octet-stream")


def _arrays(store: Store, dataset_id: str) -> bytes:
    dataset = store.datasets.get(dataset_id)
    archive = io.BytesIO()
    np.savez(
        archive,
        allow_pickle=False,
        unsafe=dataset.unsafe,
        fail_index=dataset.fail_index,
        safe=dataset.safe,
        safe_times=dataset.safe_times,
        theta_unsafe=dataset.theta_unsafe,
        theta_safe=dataset.theta_safe,
        dt=np.float64(dataset.dt),
        theta_names=np.array(dataset.theta_names, dtype=np.str_),
        channels=np.array(dataset.dictionary.keys, dtype=np.str_),
        units=np.array([channel.unit for channel in dataset.dictionary.channels], dtype=np.str_),
    )
    return archive.getvalue()


@router.get("/{dataset_id}/rollouts")
def list_rollouts(
    dataset_id: str,
    store: StoreDep,
    outcome: Annotated[Outcome, Query(description="which rollouts")] = "unsafe",
    first: Annotated[
        int, Query(ge=0, le=2**31, description="index of the first one, among those of the outcome")
    ] = 0,
    count: Annotated[
        int, Query(ge=1, le=MOST_ROLLOUTS, description="maximum number of rollouts")
    ] = 20,
    channel: Annotated[
        list[str] | None, Query(description="only these channels; all if absent")
    ] = None,
) -> list[Rollout]:
    """Rollouts of one outcome, starting at index `first`."""
    info = store.datasets.info(dataset_id)
    n = info.n_unsafe if outcome == "unsafe" else info.n_safe
    answer = [
        _rollout(store, dataset_id, outcome, index, channel)
        for index in range(first, min(first + count, n))
    ]
    return json_response(answer)


@router.get("/{dataset_id}/rollouts/{n}")
def read_rollout(dataset_id: str, n: int, store: StoreDep) -> Rollout:
    """One rollout by number; unsafe rollouts are numbered first, then safe ones."""
    info = store.datasets.info(dataset_id)
    total = info.n_unsafe + info.n_safe
    if not 0 <= n < total:
        raise Problem(404, f"the dataset has rollouts 0 to {total - 1}, not {n}")
    safe = n - info.n_unsafe
    rollout = ("unsafe", n) if safe < 0 else ("safe", safe)
    return json_response(_rollout(store, dataset_id, *rollout))


def _rollout(
    store: Store,
    dataset_id: str,
    outcome: Outcome,
    index: int,
    channels: Sequence[str] | None = None,
) -> dict[str, Any]:
    info = store.datasets.info(dataset_id)
    y, theta, fail_index = store.datasets.rollout(dataset_id, outcome, index)
    t, keys = np.arange(len(y)) * info.dt, Dictionary.from_stored(info.dictionary).keys
    columns = zip(keys, y.T.tolist(), strict=True)
    wanted = {key: column for key, column in columns if channels is None or key in channels}
    return {
        "n": index if outcome == "unsafe" else info.n_unsafe + index,
        "outcome": outcome,
        "fail_index": fail_index,
        "theta": theta,
        "telemetry": {"t": t.tolist()} | wanted,
    }
