"""What is said of a recording: what it holds, what that is taken for, how good it is."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from app.store.recordings import MappingState

Number = Annotated[float, Field(allow_inf_nan=False)]


class ListedRecording(BaseModel):
    """A recording as it is listed."""

    model_config = ConfigDict(from_attributes=True)

    id: str
    name: str = Field(examples=["flight_12.csv"])
    created: str = Field(description="UTC, ISO 8601")
    size: int = Field(description="of the file [bytes]")
    digest: str = Field(description="SHA-256 of the file")
    format: str = Field(description="key of a format in the catalog", examples=["csv"])
    aircraft: str | None = Field(examples=["PH-LAB"])
    duration: float | None = Field(description="[s]; null where the mapping cannot be applied")
    mapping_state: MappingState
    n_scorings: int


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
    start: str = Field(description="time zero in ISO 8601, empty where the file does not say")


class BadRow(BaseModel):
    """A row that was left out."""

    line: int
    reason: str
    text: str


class BadRows(BaseModel):
    """Rows that could not be read; the first ones are listed."""

    n: int
    share: float
    rows: list[BadRow]


class ChannelSource(BaseModel):
    """Where a channel comes from: value = sign * (signal in the target's unit) - bias.

    Either `signal` with its `unit`, or `derivation`.
    """

    model_config = ConfigDict(extra="forbid")

    signal: str = ""
    unit: str = ""
    sign: Literal[1, -1] = 1
    bias: Number = Field(default=0.0, description="in the target's unit")
    derivation: str = Field(default="", description="key of a derivation in the catalog")


class TimeSource(BaseModel):
    """The signal that is the time of a group."""

    model_config = ConfigDict(extra="forbid")

    signal: str
    unit: str = "s"


class Mapping(BaseModel):
    """Which signal is which channel; channels by key of the catalog's targets."""

    model_config = ConfigDict(extra="forbid")

    channels: dict[str, ChannelSource] = Field(
        default_factory=dict, examples=[{"Ny": {"signal": "ay", "unit": "g", "sign": -1}}]
    )
    times: dict[str, TimeSource] = Field(
        default_factory=dict,
        description="by name of group; a group without one is not used",
        examples=[{"": {"signal": "t", "unit": "s"}}],
    )


class Rationale(BaseModel):
    """How sure a proposal is."""

    confidence: float = Field(ge=0, le=1)
    reasons: list[str]


class Derivable(BaseModel):
    """A way to make a channel out of others."""

    key: str
    title: str
    needs: list[str]


class Recording(ListedRecording):
    """A recording with its contents and mapping."""

    same_as: str | None = Field(description="id of an earlier upload of the same bytes")
    contents: FileContents
    bad_rows: BadRows
    mapping: Mapping
    rationales: dict[str, Rationale] = Field(description="by channel, and `t:` with a group's name")
    alternatives: dict[str, list[str]] = Field(description="other signals that a channel may be")
    derivable: dict[str, list[Derivable]] = Field(description="by channel")
    missing: list[str] = Field(description="channels that nothing is mapped to")
    quality: dict[str, Any] | None = Field(description="of the times and channels as mapped")
    problem: str | None = Field(description="why the mapping cannot be applied")


class MappingRequest(BaseModel):
    """A mapping to use from now on."""

    model_config = ConfigDict(extra="forbid")

    mapping: Mapping
    aircraft: str | None = Field(default=None, min_length=1, max_length=200)
    remember: bool = Field(
        default=True,
        description="propose it for the next recording of this aircraft; without one named, "
        "nothing is remembered",
    )


class PreviewRequest(BaseModel):
    """A mapping to try."""

    model_config = ConfigDict(extra="forbid")

    mapping: Mapping
    bins: int = Field(default=120, ge=2, le=4000, description="of each channel, at most")


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


class Interval(BaseModel):
    """A manoeuvre of a recording."""

    model_config = ConfigDict(extra="forbid", from_attributes=True)

    start: Number = Field(description="[s]")
    end: Number = Field(description="[s]")
    name: str = Field(default="", max_length=200)
