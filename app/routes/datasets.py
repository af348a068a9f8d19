"""Datasets: simulated trajectories with labels."""

import asyncio
import io
from dataclasses import asdict
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, Field

from app.catalog import amplitude_request_schema, dataset_request_schema
from app.http.problems import Problem, problem_responses
from app.jobs.kinds import simulate_dataset as run
from app.jobs.requests import amplitude_suggestion, dataset_request
from app.recipes.recipes import to_plain
from app.routes.dependencies import (
    JobsDep,
    PlainBody,
    SettingsDep,
    StoreDep,
    body_of,
    file_of,
    json_response,
)
from app.routes.jobs import accepted, queued
from app.store.datasets import DatasetInfo
from app.store.store import Store
from core.channels import CHANNELS, KEYS

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


@router.post(
    "",
    **queued(),
    openapi_extra=body_of(
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
    ),
)
async def simulate_dataset(plain: PlainBody, store: StoreDep, jobs: JobsDep, settings: SettingsDep):
    """Simulate a planned test until `n_unsafe` rollouts are unsafe; starts a job.

    The defaults are those of `forewarn train`: the catalog's default with the noise, jitter and
    imperfections of flight; `"imperfections": "none"` omits these. Angles are in radians, N_y is in
    g, and names ending in `_deg` are in degrees.
    """
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
        channels=np.array(KEYS, dtype=np.str_),
        units=np.array([channel.unit for channel in CHANNELS], dtype=np.str_),
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
) -> list[Rollout]:
    """Rollouts of one outcome, starting at index `first`."""
    info = store.datasets.info(dataset_id)
    n = info.n_unsafe if outcome == "unsafe" else info.n_safe
    answer = [
        _rollout(store, dataset_id, outcome, index) for index in range(first, min(first + count, n))
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


def _rollout(store: Store, dataset_id: str, outcome: Outcome, index: int) -> dict[str, Any]:
    info = store.datasets.info(dataset_id)
    y, theta, fail_index = store.datasets.rollout(dataset_id, outcome, index)
    t = np.arange(len(y)) * info.dt
    return {
        "n": index if outcome == "unsafe" else info.n_unsafe + index,
        "outcome": outcome,
        "fail_index": fail_index,
        "theta": theta,
        "telemetry": {"t": t.tolist()} | dict(zip(KEYS, y.T.tolist(), strict=True)),
    }
