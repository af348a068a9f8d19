"""Dependencies of the routes: parts of the running application, and request bodies."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Annotated, Any, NamedTuple

from fastapi import Body, Depends, Query, Request, Response
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from app import json_codec
from app.access.people import Person
from app.campaigns.point import CampaignError
from app.flights.flights import Flights, TooManyFlights
from app.flights.sources.live import SequenceConflict
from app.flights.transport import NotPossible, TransportError
from app.http.problems import ErrorAnswers, Problem, content_type, wrong_type
from app.jobs.jobs import Jobs, NotRunning, QueueFull
from app.recordings.archives import ArchiveError
from app.recordings.recordings import Recordings
from app.recordings.scored import ScoredRecordings
from app.settings import Settings
from app.store.campaigns import CampaignChanged
from app.store.flights import FlightInProgress
from app.store.people import LOCAL, TokenError
from app.store.store import Store
from app.store.tables import time_text
from app.telemetry.journal import JournalFull, Journals
from core.conditions import ConditionKey

PAGE_TO_PRINT = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    "frame-ancestors 'self'"
}
"""Headers of a page that needs no other file; its styles are inline."""


def part(name: str) -> Any:
    """Dependency on a part of the running application, by its name in the application's state."""

    async def read(request: Request) -> Any:
        return getattr(request.app.state, name)

    return Depends(read)


async def _person(request: Request) -> Person:
    return request.scope["person"]


PAGED: dict[int | str, dict[str, Any]] = {
    200: {
        "headers": {
            "Link": {
                "description": 'the next part, as `<ADDRESS>; rel="next"`; absent at the end',
                "schema": {"type": "string"},
            }
        }
    }
}
"""Response of a list that is sent in parts."""


def utc(text: str | None) -> str | None:
    """A day or time as stored; without a zone it is UTC. ValueError."""
    if text is None:
        return None
    try:
        time = datetime.fromisoformat(text)
        return time_text(time.astimezone(UTC) if time.tzinfo else time.replace(tzinfo=UTC))
    except (ValueError, OverflowError):
        raise ValueError(
            f"{text!r} is not a time: give 2026-05-04 or 2026-05-04T12:31:05 (UTC)"
        ) from None


Moment = Annotated[
    str | None,
    AfterValidator(utc),
    Query(description="day or time in ISO 8601; UTC unless it names a zone"),
]


class ListPart(NamedTuple):
    """The part of a list that a client asks for.   limit: most entries."""

    limit: int
    cursor: str
    request: Request
    response: Response

    def link_to(self, cursor: str) -> None:
        """Link to the next part of the list, if there is one."""
        if cursor:
            query = self.request.url.include_query_params(cursor=cursor, limit=self.limit).query
            self.response.headers["Link"] = f'<{self.request.url.path}?{query}>; rel="next"'


def _part_of_list(
    request: Request,
    response: Response,
    limit: Annotated[int, Query(ge=1, le=1000, description="most entries")] = 50,
    cursor: Annotated[
        str, Query(pattern="^(.+~.+)?$", description="end of the part before, from its `Link`")
    ] = "",
) -> ListPart:
    return ListPart(limit, cursor, request, response)


PartDep = Annotated[ListPart, Depends(_part_of_list)]


def declared_length(request: Request) -> int:
    """Bytes of the body that the client announces; 0 if it does not."""
    length = request.headers.get("content-length", "")
    return int(length) if length.isdigit() else 0


StoreDep = Annotated[Store, part("store")]
JobsDep = Annotated[Jobs, part("jobs")]
SettingsDep = Annotated[Settings, part("settings")]
RecordingsDep = Annotated[Recordings, part("recordings")]
JournalsDep = Annotated[Journals, part("journals")]
ScoredDep = Annotated[ScoredRecordings, part("scored")]
FlightsDep = Annotated[Flights, part("flights")]
PersonDep = Annotated[Person, Depends(_person)]


By = Annotated[
    str, Field(min_length=1, max_length=200, description="ignored where a person is logged in")
]
Finite = Annotated[float, Field(allow_inf_nan=False)]


MOST_FRAMES = 10_000
First = Annotated[int, Query(ge=0, le=2**53, description="sample number of the first frame")]
Last = Annotated[
    int | None,
    Query(
        ge=0, le=2**53, description=f"sample number of the last frame; at most {MOST_FRAMES} frames"
    ),
]


def last_frame(first: int, last: int | None) -> int:
    """The last frame to send of those requested."""
    most = first + MOST_FRAMES - 1
    return most if last is None else min(last, most)


def frame_range(first: int, last: int | None, n: int) -> tuple[int, int | None]:
    """End of the frames to send of n, and the number of the next to request; None at the end."""
    end = n if last is None else min(last + 1, n)
    stop = max(first, min(last_frame(first, last) + 1, end))
    return stop, stop if first < stop < end else None


class Described(BaseModel):
    """Base of bodies: docstrings describe their fields."""

    model_config = ConfigDict(use_attribute_docstrings=True)


class TimeInterval(BaseModel):
    """An interval of a flight or a recording."""

    start: float = Field(description="[s]")
    end: float = Field(description="[s]")


def strictly(*examples: Any) -> ConfigDict:
    """Configuration of a request body: no other fields, no other types."""
    shown: Any = {"examples": list(examples)} if examples else None
    return ConfigDict(
        extra="forbid", strict=True, json_schema_extra=shown, use_attribute_docstrings=True
    )


class ConditionRanges(BaseModel):
    """The flight condition of a case of a limit set or a monitor set."""

    model_config = strictly()

    name: str = Field(min_length=1, max_length=200, description="name of the condition")
    ranges: dict[
        ConditionKey, Annotated[list[Finite | None], Field(min_length=2, max_length=2)]
    ] = Field(
        default_factory=dict,
        description="from the first number to below the second, in SI units; null for no bound. "
        "Channels without a range do not matter",
    )


class SignedRequest(BaseModel):
    """Name of the person who sends the request; ignored where a person is logged in."""

    model_config = strictly({"by": "Ann"})

    by: By = LOCAL


def signature(person: Person, given: str) -> str:
    """The name of the person who is logged in, else the given one."""
    return given if person.name == LOCAL else person.name


async def _signed(person: PersonDep, who: Annotated[SignedRequest | None, Body()] = None) -> str:
    return signature(person, who.by if who else LOCAL)


SignedBy = Annotated[str, Depends(_signed)]
"""Name of the person, from the login or from a body that may be absent."""


REFUSALS: ErrorAnswers = {
    ArchiveError: (409, "archive"),
    CampaignChanged: (409, "campaign"),
    CampaignError: (409, "campaign"),
    FlightInProgress: (409, "under-way"),
    JournalFull: (503, "not-durable"),
    NotPossible: (409, "not-possible"),
    NotRunning: (409, "not-running"),
    QueueFull: (429, "queue-full"),
    SequenceConflict: (409, "sequence"),
    TokenError: (422, "token"),
    TooManyFlights: (429, "too-many-flights"),
    TransportError: (422, "transport"),
}
"""Problems that answer an error, unless a route gives others."""


@contextmanager
def refused(status: int, kind: str, *errors: type[Exception]) -> Iterator[None]:
    """Answer these errors with a Problem of this status and kind."""
    try:
        yield
    except errors as error:
        raise Problem(status, str(error), f"urn:forewarn:{kind}") from error


async def plain_body(request: Request) -> dict[str, Any]:
    """The body as a JSON object, parsed in a thread; 422 for anything else."""
    if content_type(request) != "application/json":
        raise wrong_type(request)
    body = await request.body()
    return await asyncio.to_thread(parse_object, body)


def parse_object(body: bytes) -> dict[str, Any]:
    """Parse a JSON object; Problem 422 with the place of an error."""
    try:
        plain = json_codec.decode(body)
    except json_codec.NotJson as error:
        raise Problem(
            422,
            f"the body is not JSON ({error}): send a JSON object, with null, not NaN, for unknown "
            "numbers",
            "urn:forewarn:request",
        ) from None
    if not isinstance(plain, dict):
        raise Problem(
            422,
            f"the body is of type {type(plain).__name__}: send an object of parameters",
            "urn:forewarn:request",
        )
    return plain


PlainBody = Annotated[dict[str, Any], Depends(plain_body)]


def json_response(content: Any, status: int = 200, headers: dict[str, str] | None = None) -> Any:
    """JSON of plain data and numpy arrays; NaN becomes null. A route is annotated with its type."""
    return Response(json_codec.encode(content), status, headers, "application/json")


def body_of(schema: dict[str, Any], example: dict[str, Any]) -> dict[str, Any]:
    """OpenAPI's description of a JSON body that a route reads itself."""
    content = {"application/json": {"schema": schema, "example": example}}
    return {"requestBody": {"required": True, "content": content}}


def file_of(media_type: str, description: str) -> dict[int | str, dict[str, Any]]:
    """OpenAPI's description of an answer that is a file."""
    schema = {"type": "string", "format": "binary"}
    return {200: {"description": description, "content": {media_type: {"schema": schema}}}}
