"""What is said of a recording: what it holds, what that is taken for, how good it is."""

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
    """Signals that were sampled together."""

    name: str
    n_rows: int
    rate: float | None = Field(description="[Hz]; null where its time is not mapped")


class SignalSummary(BaseModel):
    """One recorded quantity as the file names it; numbers in the file's own unit."""

    name: str
    unit: str
    group: int = Field(description="number in `groups`")
    description: str
    n: int
    missing: int
    min: float | None
    max: float | None
    mean: float | None


class FileContents(BaseModel):
    """What the file holds."""

    groups: list[SignalGroup]
    signals: list[SignalSummary]
    ignored: list[str] = Field(description="what was left out, with the reason")
    notes: list[str]
    start: str = Field(
        description="time zero in ISO 8601, empty where the file does not say; 234:15:35:50.7 of a "
        "clock without a year, 15:35:50.7 of one without a date, 35:50.7 of one without an hour"
    )


class BadRowSummary(BaseModel):
    """Rows that could not be read; the first ones are listed."""

    n: int
    share: float
    rows: list[BadRow]


class Derivable(BaseModel):
    """A way to make a channel out of others."""

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
    """by channel, and `t:` with a group's name"""
    alternatives: dict[str, list[str]]
    """other signals that a channel may be"""
    derivable: dict[str, list[Derivable]]
    """by channel"""
    missing: list[str]
    """channels that nothing is mapped to"""
    quality: dict[str, Any] | None
    """of the times and channels as mapped"""
    problem: str | None
    """why the mapping cannot be applied"""


MAPPING_EXAMPLE: dict[str, Any] = {
    "mapping": {
        "channels": {"beta": {"signal": "AOSS", "unit": "deg", "sign": -1}},
        "times": {"": {"signal": "TIME", "unit": "s"}},
    }
}


class OfMapping(BaseModel):
    """A request with a mapping, or a mapping file as it is: what the command line writes."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [MAPPING_EXAMPLE]})

    mapping: Mapping

    @model_validator(mode="before")
    @classmethod
    def _file(cls, body: Any) -> Any:
        """Take a body of `channels` and `times` for the mapping itself."""
        if isinstance(body, dict) and "mapping" not in body and {"channels", "times"} & set(body):
            return {"mapping": body}
        return body


class MappingRequest(OfMapping):
    """A mapping to use from now on."""

    aircraft: str | None = Field(default=None, min_length=1, max_length=200)
    remember: StrictBool = Field(
        default=True,
        description="propose it for the next recording of this aircraft; without one named, "
        "nothing is remembered",
    )


class PreviewRequest(OfMapping):
    """A mapping to try."""

    bins: Whole = Field(default=120, ge=2, le=4000, description="of each channel, at most")


class Bands(BaseModel):
    """A channel in a few bins: the least and the most of each."""

    t: list[float] = Field(description="[s] of each bin")
    low: list[float | None]
    high: list[float | None]
    unit: str
    min: float | None
    max: float | None


class Preview(BaseModel):
    """What comes of a mapping; nothing is kept."""

    channels: dict[str, Bands]
    quality: dict[str, Any] | None
    problem: str | None
    warnings: dict[str, list[str]] = Field(
        description="by channel: what speaks against it; it can be confirmed all the same"
    )


class SignalPreview(BaseModel):
    """A signal as the file holds it, in equal numbers of rows."""

    name: str
    unit: str
    n: int
    rows: int = Field(description="of each bin but the last")
    low: list[float | None]
    high: list[float | None]


class ManoeuvreInterval(BaseModel):
    """A manoeuvre of a recording."""

    model_config = ConfigDict(extra="forbid", strict=True, from_attributes=True)

    start: Number = Field(description="[s]")
    end: Number = Field(description="[s]")
    name: str = Field(default="", max_length=200)


class InputInterval(BaseModel):
    """The control input that a proposal is made from."""

    start: float = Field(description="[s]")
    end: float = Field(description="[s]")


class TrainingProposal(BaseModel):
    """A training recipe for the manoeuvre of a recording; a person completes it."""

    recipe: dict[str, Any] = Field(
        description="part of a body of `POST /monitors`: `dataset` with `maneuver`, `limits` and "
        "`dt`, `t_early`, and the `predictor` and `score` of a method that works without the "
        "missing channels, each where it is known"
    )
    aircraft: None = Field(description="always null: a recording does not name its aircraft")
    reasons: list[str] = Field(description="where each proposal comes from, and what to check")
    channels: list[str] = Field(description="keys of the channels that are recorded")
    missing_channels: list[str]
    can_train: bool = Field(description="whether a monitor trained by this recipe can score it")
    manoeuvre: InputInterval | None
