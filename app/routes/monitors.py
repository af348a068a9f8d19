"""Monitors: train, combine, upload, evaluate, and score telemetry."""

import asyncio
from dataclasses import asdict
from pathlib import PurePath
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import HTMLResponse
from pydantic import BaseModel, Field
from scipy.special import betaincinv

from app.catalog import (
    choice_request_schema,
    combination_request_schema,
    monitor_request_schema,
)
from app.http.problems import Problem, content_type, problem_responses
from app.jobs import kinds
from app.jobs.requests import choice_request, combination_request, monitor_request
from app.recipes.recipes import limits_named, to_plain
from app.recordings.recordings import Recordings
from app.report.certificate import certificate_page
from app.routes.dependencies import (
    PAGE_TO_PRINT,
    Described,
    JobsDep,
    PersonDep,
    PlainBody,
    RecordingsDep,
    SettingsDep,
    StoreDep,
    body_of,
    file_of,
    json_response,
    plain_body,
)
from app.routes.jobs import ACCEPTED, accepted, queued
from app.routes.sent_files import BINARY, CONTENT, OCTETS, sent_file
from app.scene.own_airframe import LARGEST, check_airframe
from app.store.jobs import JobInfo
from app.store.monitors import AirframeInfo, MonitorInfo
from core.evaluation.certificate import calibrated_on, warnings_of, with_power_of_quiet
from core.evaluation.rates import EPSILONS
from core.monitor import Monitor
from core.monitor.calibration import rank, threshold
from core.monitor.combination import members_of

router = APIRouter(prefix="/api/v1/monitors", tags=["monitors"])
GLB_CONTENT = {OCTETS: {"schema": BINARY, "example": "(the .glb file)"}}


class GroupCalibration(BaseModel):
    """Calibration on the failures of one group."""

    name: str
    rule: str = Field(description="rule that groups failing flights")
    alphas: list[float | None]
    n_unsafe: int = Field(description="failures in this group; the same in each group")
    n_early: int
    alert_above: float


class CalibrationRule(Described):
    """How the monitor alerts to keep a miss rate."""

    epsilon: float
    rank: int = Field(description="number of failures that alert; scores are sorted")
    alert_above: float = Field(description="risk above which it alerts: the same rule")
    scores: list[float | None]
    """highest score that alerts, in each group; null: every score does"""
    miss_rates: list[float]
    """5 and 95 % quantiles of the miss rate of monitors calibrated on as many failures"""


class CombinationMember(BaseModel):
    """A member of a combination, as it was trained."""

    lead: float = Field(description="[s]")
    n_unsafe: int = Field(description="failures of its own calibration")
    recipe: dict[str, Any]


class Calibration(Described):
    """Calibration of a monitor on its failing flights."""

    alphas: list[float | None]
    """sorted calibration scores of the failures of all groups; null: the failure comes too early
    for a warning"""
    n_unsafe: int = Field(description="failures behind the promise, per group")
    n_early: int
    smallest_epsilon: float
    epsilon: float
    guarantee: str
    alert_above: float
    lead: float = Field(description="[s]")
    rules: list[CalibrationRule]
    """at the miss rates of the evaluation and the monitor's own, in order"""
    groups: list[GroupCalibration] = Field(description="empty if all failures are pooled")
    members: list[CombinationMember]
    """members of a combination; empty for other monitors"""


_TRAINING_BODY = body_of(
    monitor_request_schema(),
    {
        "name": "0.25 s ahead",
        "dataset": {"aircraft": {"kind": "f16_sl_h0_v502"}, "n_unsafe": 50, "seed": 1},
        "t_early": 0.25,
        "predictor": {"kind": "linear"},
        "score": {"kind": "nearest_neighbor"},
        "calibration": "trajectory",
        "epsilon": 0.1,
    },
)
_TRAINING_BODY["requestBody"]["content"] |= CONTENT


@router.post(
    "",
    status_code=202,
    responses=ACCEPTED | {201: {"model": MonitorInfo, "description": "the uploaded monitor"}},
    openapi_extra=_TRAINING_BODY,
)
async def train_monitor(
    request: Request,
    store: StoreDep,
    jobs: JobsDep,
    settings: SettingsDep,
    recordings: RecordingsDep,
    name: Annotated[
        str | None, Query(min_length=1, max_length=200, description="name of an uploaded monitor")
    ] = None,
) -> JobInfo:
    """Train a monitor on a stored dataset or one simulated first, or upload a monitor.

    A JSON body starts a job that trains the monitor and evaluates it on `n_test` fresh flights;
    `t_early` is in seconds. A body of another type, or a form (`curl -F file=@monitor.fwm`), is a
    portable monitor from `forewarn train` or `GET /monitors/{id}/file`: it is stored at once and
    returned.
    """
    if content_type(request) != "application/json":
        sent = await sent_file(request)
        body = b"".join([chunk async for chunk in sent.content])
        if body.lstrip()[:1] == b"{":
            raise Problem(415, "the body looks like JSON: send it as application/json")
        title = name or PurePath(sent.file_name).stem or "uploaded monitor"
        return await _add_file(body, title[:200], recordings)
    plain = await plain_body(request)
    training = await asyncio.to_thread(monitor_request, plain, store, settings.max_array_bytes)
    details = {
        "name": training.name,
        "dataset": to_plain(training.dataset),
        "n_test": training.n_test,
    } | to_plain(training.recipe)
    return await accepted(jobs, "monitor", details, kinds.train_monitor, training, store)


@router.post(
    "/combinations",
    **queued(),
    openapi_extra=body_of(
        combination_request_schema(),
        {"monitors": ["0f3a", "77c1"], "lead": 0.5, "n_unsafe": 200, "epsilon": 0.1},
    ),
)
async def combine_monitors(plain: PlainBody, store: StoreDep, jobs: JobsDep, settings: SettingsDep):
    """Combine several monitors of one planned test; starts a job.

    The risk of the combination is the highest of its members. It is calibrated as a whole on
    `n_unsafe` fresh failing flights, so it can be the alarm authority of a flight. `lead` in
    seconds is that of one member, whose validity decides where the combination is withdrawn.
    """
    request = await asyncio.to_thread(combination_request, plain, store, settings.max_array_bytes)
    name, monitors, recipe = request
    details = {"name": name, "monitors": monitors} | to_plain(recipe)
    return await accepted(jobs, "monitor", details, kinds.combine_monitors, *request, store)


async def _add_file(body: bytes, name: str, recordings: Recordings) -> Any:
    info = await recordings.workers.run(recordings.store.monitors.add_file, body, name)
    return json_response(
        limits_named(asdict(info)), 201, {"Location": f"/api/v1/monitors/{info.id}"}
    )


@router.get("")
def list_monitors(store: StoreDep) -> list[MonitorInfo]:
    """All monitors, newest first."""
    return store.monitors.all()


@router.get("/{monitor_id}")
def read_monitor(
    monitor_id: str,
    store: StoreDep,
    epsilon: Annotated[
        float | None,
        Query(gt=0, lt=1, description="miss rate for `warnings`; the monitor's if absent"),
    ] = None,
) -> MonitorInfo:
    """One monitor, without its arrays."""
    return store.monitors.info(monitor_id, epsilon)


@router.delete("/{monitor_id}", status_code=204, responses=problem_responses(409))
def delete_monitor(monitor_id: str, store: StoreDep) -> None:
    """Delete a monitor; 409 if it is in use."""
    store.monitors.delete(monitor_id)


@router.get("/{monitor_id}/calibration")
def read_calibration(monitor_id: str, store: StoreDep) -> Calibration:
    """Sorted calibration scores, the smallest epsilon they allow, and the monitor's epsilon.

    `alert_above` is the risk above which the monitor alerts to keep its `guarantee` at its epsilon.
    """
    monitor = store.monitors.get(monitor_id)
    answer = {
        "alphas": monitor.alphas,
        "n_unsafe": monitor.n_unsafe,
        "n_early": monitor.n_early,
        "smallest_epsilon": monitor.smallest_epsilon,
        "epsilon": monitor.recipe.epsilon,
        "guarantee": monitor.recipe.guarantee,
        "alert_above": monitor.alert_above(),
        "lead": monitor.lead,
        "rules": _rules(monitor),
        "groups": _groups(monitor),
        "members": [
            {"lead": m.lead, "n_unsafe": m.n_unsafe, "recipe": to_plain(m.recipe)}
            for m in members_of(monitor)
        ],
    }
    return json_response(answer)


def _rules(monitor: Monitor) -> list[dict[str, Any]]:
    evaluated = monitor.evaluation["curves"]["epsilon"] if monitor.evaluation else EPSILONS.tolist()
    served = [epsilon for epsilon in evaluated if epsilon >= monitor.smallest_epsilon]
    return [_rule(monitor, epsilon) for epsilon in sorted({*served, monitor.recipe.epsilon})]


def _rule(monitor: Monitor, epsilon: float) -> dict[str, Any]:
    above, n = monitor.alert_above(epsilon), monitor.n_unsafe
    k = rank(above, n)
    alphas = [monitor.alphas] if monitor.groups is None else monitor.groups.alphas
    return {
        "epsilon": epsilon,
        "rank": k,
        "alert_above": above,
        "scores": [threshold(above, of_group) for of_group in alphas],
        "miss_rates": betaincinv(n + 1 - k, k, [0.05, 0.95]),
    }


def _groups(monitor: Monitor) -> list[dict[str, Any]]:
    groups = monitor.groups
    if groups is None:
        return []
    return [
        {
            "name": name,
            "rule": groups.rule.kind,
            "alphas": alphas,
            "n_unsafe": len(alphas),
            "n_early": int(np.isposinf(alphas).sum()),
            "alert_above": monitor.alert_above(),
        }
        for name, alphas in zip(groups.rule.names, groups.alphas, strict=True)
    ]


@router.get("/{monitor_id}/evaluation")
def read_evaluation(monitor_id: str, store: StoreDep) -> dict[str, Any]:
    """Results on fresh flights over epsilon, and the lead times.

    Miss rate, share of safe flights that stay valid and without a false alarm (power), and
    P(fail | alert). The first two exclude flights in which the monitor became invalid: failing
    flights before an alert (`withdrawn`) and safe flights without one (`safe_withdrawn`). The
    `warnings` at each epsilon name what is worse than promised. For a monitor of flown flights,
    `calibrated_on` counts the simulated and flown failures that calibrate, and `flown` lists the
    flights with what each was used for.
    404 for an uploaded monitor without an evaluation.
    """
    evaluation = store.monitors.evaluation(monitor_id)
    if evaluation is None:
        raise Problem(
            404, "this monitor was not evaluated on fresh flights: train it on this server"
        )
    evaluation = with_power_of_quiet(evaluation)
    curves = evaluation["curves"]
    curves["warnings"] = [warnings_of(evaluation, epsilon) for epsilon in curves["epsilon"]]
    evaluation["at_epsilon"]["warnings"] = warnings_of(evaluation, evaluation["epsilon"])
    if mixture := calibrated_on(evaluation):
        evaluation["calibrated_on"] = evaluation["calibrated_on"] | {"words": mixture}
    return evaluation


@router.post(
    "/{monitor_id}/epsilon",
    **queued(),
    openapi_extra=body_of(
        choice_request_schema(), {"most_missed": 0.1, "most_false_alarms": 0.2, "n_test": 10000}
    ),
)
async def choose_epsilon(monitor_id: str, plain: PlainBody, store: StoreDep, jobs: JobsDep):
    """Choose an epsilon by costs or by two targets; starts a job.

    Half of the fresh flights choose, the other half certify. The result holds the epsilon, the
    counts at it, and 95 % confidence bounds. The job fails if no epsilon meets both targets; its
    error may name the number of flights that could certify one.
    """
    monitor, recipe = await asyncio.to_thread(choice_request, plain, store, monitor_id)
    details = {"monitor": monitor_id} | to_plain(recipe)
    return await accepted(jobs, "epsilon", details, kinds.choose_epsilon, monitor, recipe)


@router.get("/{monitor_id}/certificate", response_class=HTMLResponse)
def read_certificate(monitor_id: str, store: StoreDep) -> HTMLResponse:
    """The certificate as a page to print; `/evaluation` has its numbers as JSON.

    404 for an uploaded monitor without an evaluation.
    """
    info, monitor = store.monitors.info(monitor_id), store.monitors.get(monitor_id)
    try:
        page = certificate_page(monitor, info.name, info.digest, info.created)
    except ValueError as error:
        raise Problem(404, str(error)) from None
    return HTMLResponse(page, headers=PAGE_TO_PRINT)


@router.get(
    "/{monitor_id}/file", response_class=Response, responses=file_of(OCTETS, "the portable monitor")
)
def read_monitor_file(monitor_id: str, store: StoreDep) -> Response:
    """The portable monitor, for `forewarn score` or another server."""
    body = store.monitors.file(monitor_id)
    headers = {"Content-Disposition": f'attachment; filename="monitor-{monitor_id}.fwm"'}
    return Response(body, 200, headers, OCTETS)


@router.get("/{monitor_id}/airframe")
def read_airframe(monitor_id: str, store: StoreDep) -> AirframeInfo | None:
    """The aircraft that was uploaded for the scenes of this monitor's flights; null for none."""
    return store.airframes.info(monitor_id)


@router.post(
    "/{monitor_id}/airframe",
    status_code=201,
    responses=problem_responses(415, 422),
    openapi_extra={"requestBody": {"required": True, "content": GLB_CONTENT}},
)
async def put_airframe(
    monitor_id: str, request: Request, store: StoreDep, person: PersonDep
) -> AirframeInfo:
    """Draw an own aircraft in the scenes of this monitor's flights, in place of any before.

    The body, or a form with a file, is binary glTF (.glb) of at most 8 MiB, with everything inside:
    no uri, no compression, +z forward and +y up. It is drawn with the span of the other aircraft,
    in the colours of its materials, without textures and with fixed surfaces. Flights in progress
    keep theirs.
    """
    sent = await sent_file(request)
    content = bytearray()
    async for chunk in sent.content:
        content += chunk
        if len(content) > LARGEST:
            break
    await asyncio.to_thread(check_airframe, bytes(content))
    return await asyncio.to_thread(store.airframes.put, monitor_id, bytes(content), person.name)


@router.delete("/{monitor_id}/airframe", status_code=204)
def remove_airframe(monitor_id: str, store: StoreDep) -> None:
    """Draw the usual aircraft again, from the next flight on."""
    store.airframes.remove(monitor_id)
