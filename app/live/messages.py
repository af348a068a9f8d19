"""What goes over the uplink of a live flight's source: batches up, what became of them down."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from app.messages import End, Message

Values = float | None | list[float | None]


class Welcome(Message):
    """First message: what has come, and what a batch holds."""

    type: Literal["welcome"] = "welcome"
    flight: str
    last_sequence: int | None = Field(
        description="largest number of a batch that came; null before the first. A source that has "
        "kept nothing goes on with the next; one that has repeats all that was not `stored`"
    )
    names: list[str] = Field(description="of what a batch holds, time first")


class Stored(Message):
    """Batches that are durable: they are not lost, whatever happens to the server."""

    type: Literal["stored"] = "stored"
    sequences: list[int]
    repeated: list[int] = Field(description="those of them that had come before")
    unread: list[str] = Field(default_factory=list, description="names in them that nothing reads")
    count: int = Field(description="batches in all, those without a number included")


class Refused(Message):
    """A message that was not taken."""

    type: Literal["refused"] = "refused"
    sequence: int | None = Field(description="number of the batch; null where it has none")
    status: Literal[409, 422, 503] = Field(
        description="as over REST. 409: the number was used for another batch; 422: this is no "
        "batch, it was left out; 503: the disk takes nothing, repeat it later"
    )
    reason: str


class SentBatch(BaseModel):
    """A number, null or a list of them for the time and each channel; objects within by `a/b`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Values | dict[str, Values]]  # pyright: ignore[reportIncompatibleVariableOverride]

    sequence: int | None = Field(
        default=None, ge=0, description="numbers the batch: repeated, it is taken once"
    )


UPLINK_DOWN: tuple[type[Message], ...] = (Welcome, Stored, Refused, End)
"""What the server sends on a flight's uplink."""
UPLINK_UP: tuple[type[BaseModel], ...] = (SentBatch,)
"""What a source sends."""
