"""Messages on the uplink of a live flight: batches up, their results down."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from app.messages import End, Message

Values = float | None | list[float | None]


class Welcome(Message):
    """First message: what the server has received, and what a batch contains."""

    type: Literal["welcome"] = "welcome"
    flight: str
    last_sequence: int | None = Field(
        description="largest number of a received batch; null before the first. A source without a "
        "buffer continues with the next number; one with a buffer repeats all that was not `stored`"
    )
    names: list[str] = Field(description="names that a batch contains, time first")


class Stored(Message):
    """Batches that are durable: they survive a crash of the server."""

    type: Literal["stored"] = "stored"
    sequences: list[int]
    repeated: list[int] = Field(description="those of them that were repetitions")
    unread: list[str] = Field(default_factory=list, description="names in them that are not read")
    count: int = Field(description="batches in all, including those without a number")


class Refused(Message):
    """A message that was not accepted."""

    type: Literal["refused"] = "refused"
    sequence: int | None = Field(description="number of the batch; null if it has none")
    status: Literal[409, 422, 503] = Field(
        description="as over REST. 409: the number belongs to another batch; 422: not a valid "
        "batch, ignored; 503: the disk refuses writes, repeat it later"
    )
    reason: str


class SentBatch(BaseModel):
    """A number, null or a list of them per name; nested objects get names like `a/b`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Values | dict[str, Values]]  # pyright: ignore[reportIncompatibleVariableOverride]

    sequence: int | None = Field(
        default=None, ge=0, description="number of the batch; a repetition is used once"
    )


UPLINK_DOWN: tuple[type[Message], ...] = (Welcome, Stored, Refused, End)
"""What the server sends on a flight's uplink."""
UPLINK_UP: tuple[type[BaseModel], ...] = (SentBatch,)
"""What a source sends."""
