"""Scorings: a recording as a monitor sees it, stored with all that decided it."""

import asyncio
from typing import Annotated, Any, Literal

from fastapi import Query, Response
from pydantic import BaseModel, ConfigDict, Field

from app.http.head_requests import Router
from app.http.problems import Problem, problem_responses
from app.messages import ChannelLimit, Frame
from app.recordings.scoring_answers import answers, detected_manoeuvres, frames, tiled
from app.routes.dependencies import RecordingsDep, ScoredDep, json_from, json_response
from app.routes.recording_models import ManoeuvreInterval, Number
from app.scoring import Interval, ScoringRecipe
from app.store.scorings import ScoringInfo
from app.telemetry.mapping.mapping import Mapping

router = Router(prefix="/api/v1/recordings/{recording_id}", tags=["recordings"])
Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]
MOST_FRAMES = 10_000
MOST_BINS = 10_000
MOST_MARKED = 1000


class ScoringRequest(BaseModel):
    """What a recording is to be scored by, and how."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        json_schema_extra={
            "examples": [
                {"monitor": "0123456789ab", "epsilon": 0.1},
                {
                    "monitor": "0123456789ab",
                    "trim": 2.0,
                    "manoeuvres": [{"start": 10.0, "end": 18.0, "name": "rudder doublet"}],
                },
            ]
        },
    )

    monitor: str = Field(description="id")
    epsilon: Annotated[float, Field(gt=0, lt=1)] | None = Field(
        default=None, description="accepted miss rate; the monitor's own if absent"
    )
    trim: Seconds | Literal["trim_segment"] | None = Field(
        default="trim_segment",
        description="what is subtracted from each manoeuvre: the mean of its trim segment, or of "
        "so many seconds before its first input; null subtracts nothing",
    )
    manoeuvres: (
        Literal["detected", "entire"]
        | Annotated[list[ManoeuvreInterval], Field(min_length=1, max_length=MOST_MARKED)]
    ) = Field(
        default="detected",
        description="those detected by control activity, the entire recording as one, or these",
    )


class Scoring(BaseModel):
    """A recording as a monitor scored it; samples by `assessments` and `tiles`."""

    id: str
    recording: str = Field(description="id")
    monitor: str = Field(description="id")
    monitor_name: str
    warnings: list[str] = Field(
        description="what the monitor's test flights say against relying on it at this epsilon, "
        "or that it was not tested"
    )
    monitor_digest: str = Field(description="SHA-256 of the portable monitor")
    epsilon: float
    alert_above: float = Field(description="risk above which a sample alerts")
    lead: float = Field(description="promised by the monitor [s]")
    dt: float = Field(description="[s]")
    created: str = Field(description="UTC, ISO 8601")
    version: str = Field(description="program that scored it")
    digest: str = Field(description="SHA-256 of the samples: the same request gives the same")
    verified: bool = Field(
        description="whether the samples are known to match that digest: just made, or read and "
        "compared since the server started; one scoring is answered only so, a list says false of "
        "those not read yet"
    )
    damage: str = Field(
        description="empty; in a list: why this is not what was stored, without its verdicts. One "
        "scoring is never answered so"
    )
    request: dict[str, Any] = Field(
        title="Parameters", description="epsilon, trim and manoeuvres as asked for"
    )
    mapping: Mapping = Field(description="that was used")
    channels: list[ChannelLimit]
    n_samples: int
    start: float = Field(description="[s]")
    end: float = Field(description="[s]")
    notes: list[str] = Field(description="what was assumed and done, oldest first")
    quality: dict[str, Any] | None = Field(
        description="of the recorded times and channels; `compatibility`: what kinematics says of "
        "each sensor against the others, scale, bias and delay with 95 % intervals"
    )
    manoeuvres: list[dict[str, Any]] = Field(
        description="one manoeuvre each, with its trim, validity, alerts, exceedance and outcome"
    )
    outside_exceedances: list[dict[str, Any]] = Field(
        description="exceedances outside every manoeuvre: t [s], channel and value of the first "
        "recorded sample of each time, from the trim of the manoeuvre before"
    )
    limits_in_force: list[dict[str, Any]] | None = Field(
        description="of a live flight with a limit set: limits by channel from start to end [s], "
        "by which exceedances are judged; null limits where nobody can tell which held; reason: "
        "why the monitor is not applicable under them, empty where it is. Null without a limit set"
    )


class ScoredFrame(Frame):
    """A frame of a scoring. withdrawn: risk of a sample where the monitor was not applicable."""

    withdrawn: float | None
    manoeuvre: int = Field(description="number of its manoeuvre; -1: between manoeuvres")


class ScoredFrames(BaseModel):
    """Frames in order; `next` is the number to ask for when there is more, else null."""

    first: int
    next: int | None
    frames: list[ScoredFrame]


class Extremes(BaseModel):
    """The least and the most of each bin; null where nothing is known."""

    low: list[float | None]
    high: list[float | None]


class Highs(BaseModel):
    """The most of each bin."""

    high: list[float | None]


class Tiles(BaseModel):
    """A manoeuvre of a scoring in bins of equal length, exact in their extremes.

    The bins begin where tiles do: a little before what was asked for, and end a little after it.
    """

    start: float | None = Field(description="[s] of the first bin; null where there is none")
    end: float | None = Field(description="[s] of the last sample in the last bin")
    step: float = Field(description="length of a bin [s]")
    samples: int = Field(description="of a bin")
    t: list[float] = Field(description="[s] of the first sample of each bin")
    channels: dict[str, Extremes]
    risk: Extremes
    withdrawn: Highs
    state: list[int] = Field(
        description="worst of each bin: 0 ok, 1 warming_up, 2 stale, 3 invalid"
    )
    alert: list[bool]


@router.get(
    "/manoeuvres",
    response_model=list[ManoeuvreInterval],
    responses=problem_responses(404, 422, 429),
)
async def find_manoeuvres(
    recording_id: str,
    monitor: Annotated[str, Query(description="id: its planned input says what to look for")],
    recordings: RecordingsDep,
):
    """Manoeuvres that control activity shows, as a scoring by this monitor would find them."""
    found = await recordings.workers.run(detected_manoeuvres, recordings, recording_id, monitor)
    return json_response(found)


@router.post(
    "/scorings",
    status_code=201,
    response_model=Scoring,
    responses=problem_responses(404, 422, 429, 507)
    | {200: {"model": Scoring, "description": "the same request was carried out before"}},
)
async def score_recording(
    recording_id: str, request: ScoringRequest, scored: ScoredDep
) -> Response:
    """Score a recording by a monitor, at once; stored with the monitor's digest and the mapping.

    The same request of the same file, mapping and monitor gives the same samples bit for bit: it is
    answered by what is stored, with 200.
    """
    marked = request.manoeuvres
    intervals = (
        marked
        if isinstance(marked, str)
        else tuple(Interval(interval.start, interval.end, interval.name) for interval in marked)
    )
    epsilon = await asyncio.to_thread(_epsilon, scored, request)
    recipe = ScoringRecipe(epsilon, request.trim, intervals)
    info, made = await scored.score(recording_id, request.monitor, recipe)
    location = {"Location": f"/api/v1/recordings/{recording_id}/scorings/{info.id}"}
    answered = await asyncio.to_thread(answers, scored, [info], verified=True)
    return json_response(answered[0], 201 if made else 200, location)


def _epsilon(scored: ScoredDep, request: ScoringRequest) -> float:
    try:
        return scored.store.monitors.get(request.monitor).check_epsilon(request.epsilon)
    except ValueError as error:
        raise Problem(422, str(error), "urn:forewarn:epsilon") from None


@router.get("/scorings", response_model=list[Scoring], responses=problem_responses(404))
async def list_scorings(recording_id: str, scored: ScoredDep):
    """All scorings of a recording, newest first."""

    def read() -> list[dict[str, Any]]:
        return answers(scored, scored.store.scorings.of(recording_id))

    return await json_from(read)


@router.get("/scorings/{scoring_id}", response_model=Scoring, responses=problem_responses(404))
async def read_scoring(recording_id: str, scoring_id: str, scored: ScoredDep):
    """One scoring with a verdict on each manoeuvre; 500 where the samples behind it are damaged."""

    def read() -> dict[str, Any]:
        info = scored.store.scorings.info(recording_id, scoring_id)
        scored.samples(info)
        return answers(scored, [info], verified=True)[0]

    return await json_from(read)


@router.delete("/scorings/{scoring_id}", status_code=204, responses=problem_responses(404, 409))
async def delete_scoring(recording_id: str, scoring_id: str, scored: ScoredDep) -> None:
    """Delete a scoring; 409 while it is flown."""
    await asyncio.to_thread(scored.delete, recording_id, scoring_id)


@router.get(
    "/scorings/{scoring_id}/assessments",
    response_model=ScoredFrames,
    responses=problem_responses(404, 422),
)
async def read_scored_samples(
    recording_id: str,
    scoring_id: str,
    scored: ScoredDep,
    first: Annotated[int, Query(ge=0, le=2**53, description="number of the first sample")] = 0,
    last: Annotated[
        int | None,
        Query(ge=0, le=2**53, description=f"of the last one; at most {MOST_FRAMES} frames come"),
    ] = None,
):
    """Samples and what the monitor says of each, as frames of a flight.

    `next` is the first number to ask for when there is more, else null.
    """

    def read() -> dict[str, Any]:
        info = scored.store.scorings.info(recording_id, scoring_id)
        end = min(first + MOST_FRAMES, info.n_samples, (last if last is not None else 2**53) + 1)
        asked = info.n_samples if last is None else min(last + 1, info.n_samples)
        return {
            "first": first,
            "next": end if first < end < asked else None,
            "frames": frames(info, scored.samples(info)[first:end], first),
        }

    return await json_from(read)


@router.get(
    "/scorings/{scoring_id}/tiles", response_model=Tiles, responses=problem_responses(404, 422)
)
async def read_tiles(
    recording_id: str,
    scoring_id: str,
    scored: ScoredDep,
    start: Annotated[Number | None, Query(description="[s]; the scoring's if absent")] = None,
    end: Annotated[Number | None, Query(description="[s]; the scoring's if absent")] = None,
    bins: Annotated[int, Query(ge=1, le=MOST_BINS, description="at most so many")] = 1000,
):
    """Any manoeuvre of a scoring in bins, from tiles that were made once: quick at any length."""

    def read() -> dict[str, Any]:
        info: ScoringInfo = scored.store.scorings.info(recording_id, scoring_id)
        window = (info.start if start is None else start, info.end if end is None else end)
        return tiled(info, *scored.window(info, *window, bins))

    return await json_from(read)
