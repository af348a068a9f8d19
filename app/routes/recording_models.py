"""Models of a recording: contents, mapping, quality, previews, training proposal."""

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, StrictBool, model_validator

from app.json_codec import Whole
from app.store.recordings import RecordingInfo
from app.telemetry.contents import BadRow
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.proposal_builder import Rationale

Number = Annotated[float, Field(allow_inf_nan=False)]


class SignalGroup(BaseModel):
    """Signals with common times."""

    name: str
    n_rows: int
    rate: float | None = Field(description="[Hz]; null if its time is not mapped")


class SignalSummary(BaseModel):
    """A recorded quantity under its name and in its unit in the file."""

    name: str
    unit: str
    group: int = Field(description="index in `groups`")
    description: str
    n: int
    missing: int
    min: float | None
    max: float | None
    mean: float | None


class FileContents(BaseModel):
    """Contents of the file."""

    groups: list[SignalGroup]
    signals: list[SignalSummary]
    ignored: list[str] = Field(description="ignored parts of the file with the reasons")
    notes: list[str]
    start: str = Field(
        description="time zero in ISO 8601, empty if not in the file; 234:15:35:50.7 from a clock "
        "without a year, 15:35:50.7 without a date, 35:50.7 without an hour"
    )


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


@dataclass(frozen=True)
class RecordingDetails(RecordingInfo):
    """A recording as it is listed, with its contents and mapping."""

    contents: FileContents
    bad_rows: BadRowSummary
    mapping: Mapping
    rationales: dict[str, Rationale]
    """by channel, and by `t:` and the name of a group"""
    alternatives: dict[str, list[str]]
    """other possible signals, by channel"""
    derivable: dict[str, list[Derivable]]
    """possible derivations, by channel"""
    missing: list[str]
    """channels without a signal"""
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

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [MAPPING_EXAMPLE]})

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
    remember: StrictBool = Field(
        default=True,
        description="propose it for the next recording of `aircraft`; ignored without one",
    )


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


class Preview(BaseModel):
    """Channels by a mapping; not stored."""

    channels: dict[str, Bands]
    quality: dict[str, Any] | None
    problem: str | None
    warnings: dict[str, list[str]] = Field(
        description="by channel: reasons against the mapping; it can still be confirmed"
    )


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

    model_config = ConfigDict(extra="forbid", strict=True, from_attributes=True)

    start: Number = Field(description="[s]")
    end: Number = Field(description="[s]")
    name: str = Field(default="", max_length=200)


class InputInterval(BaseModel):
    """The control input behind a proposal."""

    start: float = Field(description="[s]")
    end: float = Field(description="[s]")


class TrainingProposal(BaseModel):
    """A training recipe for the manoeuvre of a recording; a person completes it."""

    recipe: dict[str, Any] = Field(
        description="part of a body of `POST /monitors`: `dataset` with `maneuver`, `limits` and "
        "`dt`, `t_early`, and the `predictor` and `score` of a method that works without the "
        "missing channels; unknown parts are absent"
    )
    aircraft: None = Field(description="always null: a recording does not name its aircraft")
    reasons: list[str] = Field(description="where each proposal comes from, and what to check")
    channels: list[str] = Field(description="keys of the recorded channels")
    missing_channels: list[str]
    can_train: bool = Field(description="whether a monitor trained by this recipe can score it")
    manoeuvre: InputInterval | None
