"""Recordings: upload, map, preview, propose a training, delete."""

import asyncio
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, ConfigDict, Field, StrictBool, model_validator
from starlette.requests import ClientDisconnect

from app.http.problems import Problem, problem_responses
from app.json_codec import Whole
from app.recordings.answers import preview, recording_answer, signal_bands
from app.recordings.recordings import Abandoned, Upload
from app.recordings.training_proposal import training_proposal
from app.recordings.upload import plain_name
from app.report.figures import faults
from app.report.strip_chart import styled
from app.routes.dependencies import (
    PAGED,
    Described,
    Finite,
    PartDep,
    RecordingsDep,
    StoreDep,
    TimeInterval,
    declared_length,
    json_response,
    strictly,
)
from app.routes.sent_files import CONTENT, sent_file
from app.store.recordings import Marker, MarkerKind, RecordingInfo
from app.store.tables import new_id, now
from app.telemetry.contents import BadRow
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.proposal_builder import Rationale
from core.channels import Channel

router = APIRouter(prefix="/api/v1/recordings", tags=["recordings"])
LONGEST_NAME = 255
UNNAMED = "upload"
"""Name of a file sent without one."""


class SignalGroup(BaseModel):
    """Signals with common times."""

    name: str
    n_rows: int
    rate: float | None = Field(description="[Hz]; null if its time is not mapped")


class SignalSummary(BaseModel):
    """A recorded quantity under its name and in its unit in the file.

    The summary is in this unit; raw counts are scaled as the file declares.
    """

    name: str
    unit: str
    group: int = Field(description="index in `groups`")
    description: str
    scale: float = Field(description="of raw counts, as the file declares; 1 if it does not")
    offset: float = Field(description="of raw counts: the value at zero")
    n_bits: int = Field(description="of a raw word; 0 if unknown")
    n: int
    missing: int
    min: float | None
    max: float | None
    mean: float | None


class FileContents(Described):
    """Contents of the file."""

    groups: list[SignalGroup]
    signals: list[SignalSummary]
    ignored: list[str] = Field(description="ignored parts of the file with the reasons")
    notes: list[str]
    start: str
    """time zero in ISO 8601, empty if not in the file; 234:15:35:50.7 from a clock without a year,
    15:35:50.7 without a date, 35:50.7 without an hour"""


class BadRowSummary(BaseModel):
    """Rows that could not be read; the first ones are listed."""

    n: int
    share: float
    rows: list[BadRow]


class Derivable(BaseModel):
    """A derivation of a channel from others."""

    key: str
    title: str
    needs: list[str]


@dataclass(frozen=True, kw_only=True)
class Target(Channel):
    """A quantity that a signal can be mapped to: a channel, or an input of a derivation."""

    units: Annotated[list[str], Field(description="common units, its own first")]


ForMonitor = Annotated[
    str | None, Query(description="id of the monitor whose channels come first in the mapping")
]


@dataclass(frozen=True)
class RecordingDetails(RecordingInfo):
    """A recording as it is listed, with its contents and mapping."""

    contents: FileContents
    bad_rows: BadRowSummary
    mapping: Mapping
    rates: dict[str, str]
    """sample rates of `mapping.times` as a mapping reads them, by group"""
    rationales: dict[str, Rationale]
    """by channel, and by `t:` and the name of a group"""
    alternatives: dict[str, list[str]]
    """other possible signals, by channel"""
    derivable: dict[str, list[Derivable]]
    """possible derivations, by channel"""
    mapping_notes: list[str]
    """on the proposed mapping as a whole"""
    channels: list[str]
    """keys of the channels that the monitor needs from the file; without one, those of the
    dictionary that fits the mapping"""
    targets: list[Target]
    """channels to which signals can be mapped: `channels` first, then those of all dictionaries"""
    missing: list[str]
    """those of `channels` without a signal"""
    quality: dict[str, Any] | None
    """quality of the times and channels as mapped"""
    problem: str | None
    """why the mapping cannot be applied"""


MAPPING_EXAMPLE: dict[str, Any] = {
    "mapping": {
        "channels": {"beta": {"signal": "AOSS", "unit": "deg", "sign": -1}},
        "times": {"": {"signal": "TIME", "unit": "s"}},
    }
}


class OfMapping(BaseModel):
    """A request with a mapping, or a mapping file of the command line as the whole body."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [MAPPING_EXAMPLE]},
        use_attribute_docstrings=True,
    )

    mapping: Mapping

    @model_validator(mode="before")
    @classmethod
    def _file(cls, body: Any) -> Any:
        """Accept a body of `channels` and `times` as the mapping."""
        if isinstance(body, dict) and "mapping" not in body and {"channels", "times"} & set(body):
            return {"mapping": body}
        return body


class MappingRequest(OfMapping):
    """A mapping to use from now on."""

    aircraft: str | None = Field(default=None, min_length=1, max_length=200)
    remember: StrictBool = True
    """propose it for the next recording of `aircraft`; ignored without one"""


class PreviewRequest(OfMapping):
    """A mapping to try."""

    bins: Whole = Field(default=120, ge=2, le=4000, description="most bins per channel")


class Bands(BaseModel):
    """A channel in bins, with the extremes of each."""

    t: list[float] = Field(description="[s] of each bin")
    low: list[float | None]
    high: list[float | None]
    unit: str
    min: float | None
    max: float | None


class Preview(Described):
    """Channels by a mapping; not stored."""

    channels: dict[str, Bands]
    quality: dict[str, Any] | None
    problem: str | None
    warnings: dict[str, list[str]]
    """by channel: reasons against the mapping; it can still be confirmed"""


class SignalPreview(BaseModel):
    """A signal of the file in bins of equal numbers of rows."""

    name: str
    unit: str
    n: int
    rows: int = Field(description="rows of each bin except the last")
    low: list[float | None]
    high: list[float | None]


class ManoeuvreInterval(BaseModel):
    """A manoeuvre of a recording."""

    model_config = ConfigDict(strictly(), from_attributes=True)

    start: Finite = Field(description="[s]")
    end: Finite = Field(description="[s]")
    name: str = Field(default="", max_length=200)


class TrainingProposal(Described):
    """A training recipe for the manoeuvre of a recording; a person completes it."""

    recipe: dict[str, Any]
    """part of a body of `POST /monitors`: `dataset` with `maneuver`, `limits` and `dt`, `t_early`,
    and the `predictor` and `score` of a method that works without the missing channels; unknown
    parts are absent"""
    reasons: list[str] = Field(description="where each proposal comes from, and what to check")
    missing_channels: list[str]
    can_train: bool = Field(description="whether a monitor trained by this recipe can score it")
    manoeuvre: TimeInterval | None = Field(description="the control input behind it")


@router.post(
    "",
    status_code=201,
    responses=problem_responses(408, 429, 507)
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
    monitor: ForMonitor = None,
) -> RecordingDetails:
    """Upload a telemetry file in any format of the catalog, in a form or as the body.

    `curl -F file=@flight.csv URL`, or `curl --data-binary @flight.csv 'URL?name=flight.csv'` with
    any content type. The server reads it at once and proposes a mapping of its signals: check it
    before scoring.
    """
    sent = await sent_file(request)
    sent_name = name or sent.file_name[-LONGEST_NAME:] or UNNAMED
    if not (file_name := plain_name(sent_name)):
        text = f"{sent_name!r} is not a file name: give a name with letters or digits"
        raise Problem(422, text, "urn:forewarn:request")
    length = declared_length(request)
    upload = Upload(file_name, aircraft, length, sent.content, request.is_disconnected, monitor)
    try:
        recording_id = await recordings.receive(upload)
    except (ClientDisconnect, Abandoned):
        text = "the upload was interrupted and not stored: send the file again"
        raise Problem(408, text) from None
    location = {"Location": f"/api/v1/recordings/{recording_id}"}
    answer = await asyncio.to_thread(recording_answer, recordings, recording_id, monitor)
    return json_response(_drawn(answer), 201, location)


@router.get("", responses=PAGED)
def list_recordings(
    recordings: RecordingsDep,
    part: PartDep,
    aircraft: Annotated[str, Query(description="name of the aircraft")] = "",
    text: Annotated[str, Query(description="part of the recording's name")] = "",
) -> list[RecordingInfo]:
    """Recordings, newest first, in parts."""
    page = recordings.store.recordings.listed(part.limit, part.cursor, aircraft, text)
    part.link_to(page.after)
    return page.entries


@router.get("/{recording_id}")
def read_recording(
    recording_id: str, recordings: RecordingsDep, monitor: ForMonitor = None
) -> RecordingDetails:
    """One recording with its contents and mapping.

    With a monitor, its channels are proposed besides a confirmed mapping; nothing is stored.
    """
    is_asked = monitor is not None
    answer = recording_answer(recordings, recording_id, monitor, proposed=is_asked)
    return json_response(_drawn(answer))


@router.delete("/{recording_id}", status_code=204, responses=problem_responses(409))
def delete_recording(recording_id: str, recordings: RecordingsDep) -> None:
    """Delete a recording, its scorings and markers; 409 if it is flown or kept permanently."""
    recordings.delete(recording_id)


@router.put("/{recording_id}/mapping")
def confirm_mapping(
    recording_id: str,
    request: MappingRequest,
    recordings: RecordingsDep,
    monitor: ForMonitor = None,
) -> RecordingDetails:
    """Confirm the mapping of signals to channels.

    It is proposed for the next recording of the aircraft. Earlier scorings keep their mapping. 422
    if the mapping cannot be applied.
    """
    mapping = Mapping.from_plain(request.mapping.to_plain())
    recordings.check_channels(mapping)
    recordings.dictionary_of(monitor)
    recordings.confirm_mapping(recording_id, mapping, request.aircraft, remember=request.remember)
    return json_response(_drawn(recording_answer(recordings, recording_id, monitor)))


@router.post("/{recording_id}/preview")
def preview_mapping(
    recording_id: str, request: PreviewRequest, recordings: RecordingsDep
) -> Preview:
    """Try a mapping without storing it: each channel in bins, and the quality.

    If the mapping cannot be applied, `problem` has the reason and there are no channels.
    """
    mapping = Mapping.from_plain(request.mapping.to_plain())
    recordings.check_channels(mapping)
    return json_response(_drawn(preview(recordings, recording_id, mapping, request.bins)))


def _drawn(answer: dict[str, Any]) -> dict[str, Any]:
    """The answer with the faults of its data as SVG; empty without faults."""
    figure = faults(answer["quality"])
    if answer["quality"] is None:
        return answer
    return answer | {"quality": answer["quality"] | {"figure": styled(figure) if figure else ""}}


@router.get("/{recording_id}/signals/{index}/preview")
def preview_signal(recording_id: str, index: int, recordings: RecordingsDep) -> SignalPreview:
    """A signal of the file in bins. index: its place in the signals of the contents."""
    return json_response(signal_bands(recordings, recording_id, index))


@router.get("/{recording_id}/training-proposal", responses=problem_responses(429))
async def propose_training(
    recording_id: str,
    recordings: RecordingsDep,
    monitor: Annotated[
        str | None, Query(description="id of a monitor whose limits and lead are proposed")
    ] = None,
) -> TrainingProposal:
    """A partial body of `POST /monitors` for the manoeuvre of a recording.

    Use it where no monitor fits the recording. The largest control input is compared with the
    catalog's cards. Add the aircraft, which no recording names, at `recipe.dataset.aircraft`;
    `reasons` explains each proposal. Where `can_train` is false, no method works without
    `missing_channels`.
    """
    run = recordings.workers.run
    return json_response(await run(training_proposal, recordings, recording_id, monitor))


class MarkerText(BaseModel):
    """A remark and its time."""

    model_config = strictly({"t": 12.5, "text": "gust"})

    t: Finite = Field(description="[s]")
    end: Finite | None = None
    """end of an interval [s]; null for a moment"""
    text: str = Field(min_length=1, max_length=2000)
    kind: MarkerKind = "marker"

    @model_validator(mode="after")
    def check_order(self) -> "MarkerText":
        if self.end is not None and self.end < self.t:
            raise ValueError(
                f"the end {self.end:g} s is before the start {self.t:g} s: give a later end"
            )
        return self


@router.get("/{recording_id}/markers")
def list_markers(recording_id: str, store: StoreDep) -> list[Marker]:
    """All markers and notes of a recording, in order of time."""
    return store.markers.of(recording_id)


@router.post("/{recording_id}/markers", status_code=201)
def add_marker(recording_id: str, text: MarkerText, store: StoreDep) -> Marker:
    """Add a marker or a note."""
    marker = Marker(id=new_id(), created=now(), **text.model_dump())
    return store.markers.add(recording_id, marker)


@router.put("/{recording_id}/markers/{marker_id}")
def change_marker(recording_id: str, marker_id: str, text: MarkerText, store: StoreDep) -> Marker:
    """Change a marker's text or time."""
    marker = Marker(id=marker_id, created="", **text.model_dump())
    return store.markers.update(recording_id, marker)


@router.delete("/{recording_id}/markers/{marker_id}", status_code=204)
def delete_marker(recording_id: str, marker_id: str, store: StoreDep) -> None:
    """Delete a marker."""
    store.markers.delete(recording_id, marker_id)
