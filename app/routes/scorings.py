"""Scorings: recordings assessed by a monitor, with their report and their samples as files."""

import asyncio
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import PurePath
from typing import Annotated, Any, BinaryIO, Literal
from urllib.parse import quote

from fastapi import APIRouter, Query, Response
from fastapi.responses import HTMLResponse, StreamingResponse
from pydantic import BaseModel, Field, model_validator

from app.assessment import Interval, ScoringRecipe
from app.assessment.comparison import Assessed, difference
from app.flights.compared import Differences, differences_of
from app.http.problems import problem_responses
from app.messages import ChannelLimit, Frame
from app.recordings.exports import EXPORTS, export
from app.recordings.files import reporting_full_disk
from app.recordings.scored import SetRequest
from app.recordings.scoring_answers import answers, detected_manoeuvres, frames, tiled
from app.report.page import report
from app.report.subject import about, stored_subject
from app.routes.dependencies import (
    PAGE_TO_PRINT,
    Described,
    Finite,
    First,
    Last,
    RecordingsDep,
    ScoredDep,
    frame_range,
    json_response,
    refused,
    strictly,
)
from app.routes.flights import FramesPart
from app.routes.recordings import ManoeuvreInterval
from app.store.scorings import ScoringInfo
from app.telemetry.mapping.mapping import Mapping
from core.conditions import ConditionKey, check_declared

router = APIRouter(prefix="/api/v1/recordings/{recording_id}", tags=["recordings"])
Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]
MOST_BINS = 10_000
MOST_MARKED = 1000


class ScoringRequest(BaseModel):
    """Monitor and parameters to score a recording with."""

    model_config = strictly(
        {"monitor": "0123456789ab", "epsilon": 0.1},
        {
            "monitor": "0123456789ab",
            "trim": 2.0,
            "manoeuvres": [{"start": 10.0, "end": 18.0, "name": "rudder doublet"}],
        },
    )

    monitor: str | None = Field(default=None, description="id. Give either this or `monitor_set`")
    monitor_set: str | None = None
    """id of a monitor set: each sample is assessed by the monitor of its flight condition as in a
    live flight, at its own epsilon and limits"""
    condition: dict[ConditionKey, float] = Field(default_factory=dict)
    """with a monitor set: values of the flight condition that were not recorded, in SI units; those
    of the flight if absent"""
    epsilon: Annotated[float, Field(gt=0, lt=1)] | None = None
    """accepted miss rate; the monitor's own if absent"""
    trim: Seconds | Literal["trim_segment"] | None = "trim_segment"
    """subtract from each manoeuvre the mean of its trim segment, or of this many seconds before its
    first input; null subtracts nothing"""
    manoeuvres: (
        Literal["detected", "entire"]
        | Annotated[list[ManoeuvreInterval], Field(min_length=1, max_length=MOST_MARKED)]
    ) = Field(
        default="detected",
        description="manoeuvres detected by control activity, the entire recording, or a list",
    )

    @model_validator(mode="after")
    def check_set(self) -> "ScoringRequest":
        if (self.monitor is None) == (self.monitor_set is None):
            given = "no monitor" if self.monitor is None else "both a monitor and a monitor_set"
            raise ValueError(f"{given} was given: give the id of one, as monitor or monitor_set")
        if self.monitor_set is not None and self.epsilon is not None:
            raise ValueError("a monitor set uses each monitor at its own epsilon: leave it out")
        if self.monitor_set is None and self.condition:
            raise ValueError("a condition needs a monitor_set: give its id")
        return self


ASSESSED = ("t", "p_value", "alert", "state")


class ScoringComparison(Differences):
    """Two scorings of one recording on the same samples."""

    n_first: int = Field(description="samples that the first one assessed")
    n_second: int = Field(description="samples that the second one assessed")


class ScoringFacts(Described):
    """A recording as a monitor scored it."""

    monitor_digest: str = Field(description="SHA-256 of the portable monitor")
    epsilon: float
    alert_above: float = Field(description="risk above which a sample alerts")
    lead: float = Field(description="promised by the monitor [s]")
    dt: float = Field(description="[s]")
    created: str = Field(description="UTC, ISO 8601")
    version: str = Field(description="version of the program that scored it")
    request: dict[str, Any] = Field(title="Parameters")
    """requested epsilon, trim and manoeuvres"""
    channels: list[ChannelLimit]
    n_samples: int
    time_zero: str
    """zero of the times, in ISO 8601 or as in the recording's contents; empty if the file does not
    give it"""
    notes: list[str] = Field(description="assumptions and processing steps, in order")
    quality: dict[str, Any] | None
    """quality of the recorded times and channels; `compatibility`: scale, bias and delay of each
    sensor by kinematics from the others, with 95 % intervals"""
    manoeuvres: list[dict[str, Any]]
    """manoeuvres with trim, validity, alerts, exceedance and outcome"""
    outside_exceedances: list[dict[str, Any]]
    """exceedances outside manoeuvres: t [s], channel and value of the first sample of each,
    relative to the trim of the manoeuvre before"""
    limits_in_force: list[dict[str, Any]] | None
    """for a live flight with a limit set: limits in force by channel from start to end [s], null if
    unknown; `reason`: why the monitor is not applicable under them, empty if it is. Null without a
    limit set"""


class Scoring(ScoringFacts):
    """A scoring of a recording; `assessments` and `tiles` have its samples."""

    id: str
    recording: str = Field(description="id")
    monitor: str = Field(description="id")
    monitor_name: str
    warnings: list[str]
    """reasons not to rely on the monitor at this epsilon, from its test flights or because it was
    not tested"""
    digest: str
    """SHA-256 of the samples; the same request gives the same digest"""
    damage: str
    """in lists: how the stored scoring is damaged, without its verdicts; empty if intact. A damaged
    single scoring is refused"""
    mapping: Mapping = Field(description="mapping used")
    start: float = Field(description="[s]")
    end: float = Field(description="[s]")


class ScoredFrame(Frame):
    """A frame of a scoring. withdrawn: risk where the monitor was not applicable."""

    withdrawn: float | None
    manoeuvre: int = Field(description="number of the manoeuvre; -1 between manoeuvres")


class ScoredFrames(FramesPart):
    """Frames of a scoring, in order."""

    frames: list[ScoredFrame]  # pyright: ignore[reportIncompatibleVariableOverride]


class Extremes(BaseModel):
    """Extremes of each bin; null without values."""

    low: list[float | None]
    high: list[float | None]


class Highs(BaseModel):
    """Largest value of each bin; null without values."""

    high: list[float | None]


class Tiles(Described):
    """An interval of a scoring in bins of equal length with exact extremes.

    The bins start shortly before the requested interval and end shortly after it.
    """

    start: float | None = Field(description="start of the first bin [s]; null without bins")
    end: float | None = Field(description="time of the last sample in the last bin [s]")
    step: float = Field(description="length of a bin [s]")
    samples: int = Field(description="samples per bin")
    t: list[float] = Field(description="time of the first sample of each bin [s]")
    channels: dict[str, Extremes]
    risk: Extremes
    withdrawn: Highs
    state: list[int]
    """worst state in each bin: 0 ok, 1 warming_up, 2 stale, 3 invalid"""
    alert: list[bool]


@router.get("/manoeuvres", responses=problem_responses(429))
async def find_manoeuvres(
    recording_id: str,
    monitor: Annotated[str, Query(description="id; its planned input is what to look for")],
    recordings: RecordingsDep,
) -> list[ManoeuvreInterval]:
    """Manoeuvres that a scoring by this monitor would detect by control activity."""
    run = recordings.workers.run
    return json_response(await run(detected_manoeuvres, recordings, recording_id, monitor))


@router.post(
    "/scorings",
    status_code=201,
    responses=problem_responses(429, 507)
    | {200: {"model": Scoring, "description": "the stored scoring of an identical request"}},
)
async def score_recording(recording_id: str, request: ScoringRequest, scored: ScoredDep) -> Scoring:
    """Score a recording by a monitor; stored with the monitor's digest and the mapping.

    An identical request for the same file, mapping and monitor returns the stored scoring with 200,
    since it would give the same samples bit for bit.
    """
    marked = request.manoeuvres
    intervals = (
        marked
        if isinstance(marked, str)
        else tuple(Interval(interval.start, interval.end, interval.name) for interval in marked)
    )
    by_set = await asyncio.to_thread(_set, scored, request)
    monitor_id = str(by_set.info.cases[0].monitor if by_set else request.monitor)
    epsilon = await asyncio.to_thread(_epsilon, scored, monitor_id, request.epsilon)
    recipe = ScoringRecipe(epsilon, request.trim, intervals)
    info, made = await scored.score(recording_id, monitor_id, recipe, by_set)
    location = {"Location": f"/api/v1/recordings/{recording_id}/scorings/{info.id}"}
    answered = await asyncio.to_thread(answers, scored, [info])
    return json_response(answered[0], 201 if made else 200, location)


def _epsilon(scored: ScoredDep, monitor_id: str, epsilon: float | None) -> float:
    with refused(422, "epsilon", ValueError):
        return scored.store.monitors.get(monitor_id).check_epsilon(epsilon)


def _set(scored: ScoredDep, request: ScoringRequest) -> SetRequest | None:
    """The monitor set of a request, None for one monitor."""
    if request.monitor_set is None:
        return None
    with refused(422, "condition", ValueError):
        check_declared(request.condition)
    return SetRequest(scored.store.monitor_sets.info(request.monitor_set), request.condition)


@router.get("/scorings")
def list_scorings(recording_id: str, scored: ScoredDep) -> list[Scoring]:
    """All scorings of a recording, newest first."""
    return json_response(answers(scored, scored.store.scorings.of(recording_id)))


@router.get("/scorings/{scoring_id}")
def read_scoring(recording_id: str, scoring_id: str, scored: ScoredDep) -> Scoring:
    """One scoring with a verdict on each manoeuvre; 500 if its samples are damaged."""
    info = scored.store.scorings.info(recording_id, scoring_id)
    scored.samples(info)
    return json_response(answers(scored, [info])[0])


@router.delete("/scorings/{scoring_id}", status_code=204, responses=problem_responses(409))
def delete_scoring(recording_id: str, scoring_id: str, scored: ScoredDep) -> None:
    """Delete a scoring; 409 while it is flown."""
    scored.delete(recording_id, scoring_id)


@router.get("/scorings/{scoring_id}/assessments")
def read_scored_samples(
    recording_id: str,
    scoring_id: str,
    scored: ScoredDep,
    first: First = 0,
    last: Last = None,
) -> ScoredFrames:
    """Samples and assessments of a scoring as frames of a flight.

    `next` is the number of the next frame to request, null at the end.
    """
    info = scored.store.scorings.info(recording_id, scoring_id)
    stop, following = frame_range(first, last, info.n_samples)
    answer = {
        "first": first,
        "next": following,
        "frames": frames(info, scored.samples(info)[first:stop], first),
    }
    return json_response(answer)


@router.get("/scorings/{scoring_id}/tiles")
def read_tiles(
    recording_id: str,
    scoring_id: str,
    scored: ScoredDep,
    start: Annotated[Finite | None, Query(description="[s]; that of the scoring if absent")] = None,
    end: Annotated[Finite | None, Query(description="[s]; that of the scoring if absent")] = None,
    bins: Annotated[int, Query(ge=1, le=MOST_BINS, description="most bins")] = 1000,
) -> Tiles:
    """An interval of a scoring in bins, computed from stored tiles."""
    info: ScoringInfo = scored.store.scorings.info(recording_id, scoring_id)
    window = (info.start if start is None else start, info.end if end is None else end)
    keys = scored.recordings.dictionary_of(info.monitor_id).keys
    return json_response(tiled(info.dt, keys, *scored.window(info, *window, bins)))


@router.get("/scorings/{scoring_id}/comparison")
def compare_scorings(
    recording_id: str,
    scoring_id: str,
    scored: ScoredDep,
    scoring: Annotated[str, Query(description="id of the second scoring, of this recording")],
) -> ScoringComparison:
    """Two scorings of one recording compared sample by sample."""
    find = scored.store.scorings.info
    infos = [find(recording_id, each) for each in (scoring_id, scoring)]
    samples = [scored.samples(info) for info in infos]
    first, second = (Assessed(*(each[name] for name in ASSESSED)) for each in samples)
    differences = differences_of(difference(first, second)).model_dump()
    return ScoringComparison(n_first=first.n_assessed, n_second=second.n_assessed, **differences)


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


@router.get("/scorings/{scoring_id}/report", response_class=HTMLResponse)
def read_report(recording_id: str, scoring_id: str, scored: ScoredDep) -> HTMLResponse:
    """The report as one self-contained HTML file to print."""
    subject = stored_subject(scored, recording_id, scoring_id)
    return HTMLResponse(report(subject), headers=PAGE_TO_PRINT)


@router.get("/scorings/{scoring_id}/export", responses=SAMPLES, response_class=Response)
def export_samples(
    recording_id: str,
    scoring_id: str,
    scored: ScoredDep,
    form: Annotated[Literal["csv", "parquet", "mat"], Query(alias="format")] = "csv",
) -> Response:
    """All samples with their assessments and units."""
    info = scored.store.scorings.info(recording_id, scoring_id)
    recording = scored.store.recordings.info(recording_id)
    samples, kind = scored.samples(info), EXPORTS[form]
    dictionary = scored.recordings.dictionary_of(info.monitor_id)
    with ExitStack() as held:
        file = held.enter_context(scored.files.unnamed())
        with reporting_full_disk():
            export(samples, about(asdict(recording), asdict(info)), form, file, dictionary)
            headers = {"Content-Length": str(file.tell())}
        name = quote(f"{PurePath(recording.name).stem} scored.{form}")
        headers["Content-Disposition"] = f"attachment; filename*=UTF-8''{name}"
        held.pop_all()
    return StreamingResponse(_blocks(file), headers=headers, media_type=kind.media_type)


def _blocks(file: BinaryIO) -> Iterator[bytes]:
    """The file in blocks; it is closed afterwards."""
    with file:
        file.seek(0)
        while block := file.read(SENT_BYTES):
            yield block
