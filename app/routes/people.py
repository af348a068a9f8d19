"""People, their tokens, and the log of their changes."""

import asyncio
import csv
import io
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, fields
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field

from app import json_codec
from app.access.audit import Audit
from app.access.people import People
from app.access.roles import allowed_to
from app.http.problems import Problem, problem_responses
from app.routes.dependencies import Described, Moment, PersonDep, StoreDep, part, refused, strictly
from app.store.people import LINK_SECONDS, LONGEST_DAYS, AuditEntry, Role, StoredToken, TokenError
from app.store.store import StoreError
from app.store.tables import now
from core import __version__

router = APIRouter(prefix="/api/v1", tags=["people"])


PeopleDep = Annotated[People, part("people")]


class Me(Described):
    """The person who sends the request."""

    name: str
    """`server` with the token from the settings, `local` if no token is required"""
    role: Role
    version: str = Field(description="of the program")
    server_time: str = Field(description="UTC, ISO 8601")
    allowed: list[str] = Field(examples=[["POST /api/v1/flights/{}/end"]])
    """requests allowed for the role, with path parameters as `{}`"""


class TokenRequest(BaseModel):
    """A token for a person."""

    model_config = strictly({"name": "Ann", "role": "operator", "days": 30})

    name: str = Field(min_length=1, max_length=64)
    role: Role
    days: float | None = Field(default=None, gt=0, le=LONGEST_DAYS)
    """days until it expires; null: never"""


class NewToken(BaseModel):
    """A new token; it is not shown again."""

    id: str
    name: str
    role: Role
    expires: str | None = Field(description="UTC, ISO 8601; null: never")
    token: str


class LoginLink(BaseModel):
    """An address for one login."""

    path: str = Field(examples=["/login?link=..."])
    seconds: float = Field(description="time until it expires [s]")


@router.get("/me")
async def read_me(person: PersonDep) -> Me:
    """Name, role and permissions of the person who sends the request."""
    return Me(
        name=person.name,
        role=person.role,
        version=__version__,
        server_time=now(),
        allowed=allowed_to(person.role),
    )


@router.get("/tokens")
def list_tokens(store: StoreDep, people: PeopleDep) -> list[StoredToken]:
    """All tokens, newest first, without the secrets."""
    return [people.with_use(token) for token in store.tokens.all()]


@router.post("/tokens", status_code=201, responses=problem_responses(409))
async def make_token(
    wanted: TokenRequest, store: StoreDep, people: PeopleDep, response: Response
) -> NewToken:
    """Make a token for a person. A name has at most one valid token.

    409 while the server requires no token: make the first one with `forewarn token create`, since
    from then on every request needs one.
    """
    if not people.needs_token:
        text = "the server requires no token yet: make the first with `forewarn token create`"
        raise Problem(409, text, "urn:forewarn:token")
    add = store.tokens.add
    made, secret = await asyncio.to_thread(add, wanted.name, wanted.role, wanted.days)
    await people.refresh()
    response.headers["Location"] = f"{router.prefix}/tokens/{made.id}"
    return NewToken(id=made.id, name=made.name, role=made.role, expires=made.expires, token=secret)


@router.delete("/tokens/{token_id}")
async def revoke_token(token_id: str, store: StoreDep, people: PeopleDep) -> StoredToken:
    """Revoke a token permanently. Its sessions and WebSockets close; it stays in the list."""
    revoked = await asyncio.to_thread(store.tokens.revoke, token_id)
    await people.refresh()
    return revoked


@router.post("/tokens/{token_id}/link", responses=problem_responses(409))
def make_link(token_id: str, store: StoreDep) -> LoginLink:
    """Make an address where the person can log in once without the token."""
    with refused(409, "token", TokenError):
        code = store.tokens.make_link(token_id)
    return LoginLink(path=f"/login?link={code}", seconds=LINK_SECONDS)


JSON_LINES, CSV = "application/x-ndjson", "text/csv"


def as_csv(entries: Iterable[AuditEntry]) -> Iterator[str]:
    file = io.StringIO()
    writer = csv.DictWriter(file, [each.name for each in fields(AuditEntry)], lineterminator="\n")
    writer.writeheader()
    for entry in entries:
        writer.writerow(asdict(entry))
        yield file.getvalue()
        file.seek(0)
        file.truncate()
    yield file.getvalue()


def as_json_lines(entries: Iterable[AuditEntry]) -> Iterator[str]:
    for entry in entries:
        yield json_codec.encode(asdict(entry)).decode() + "\n"


@router.get(
    "/audit",
    response_class=Response,
    responses={
        200: {
            "content": {
                JSON_LINES: {"schema": {"type": "string"}},
                CSV: {"schema": {"type": "string"}},
            }
        },
    },
)
async def export_audit(
    request: Request,
    store: StoreDep,
    since: Moment = None,
    until: Moment = None,
    who: Annotated[str | None, Query(description="name of a person")] = None,
    kind: Annotated[
        Literal["jsonl", "csv"], Query(alias="format", description="JSON lines or CSV")
    ] = "jsonl",
) -> Response:
    """The audit log, oldest first: changes, logins, and requests that a role did not allow.

    For samples of a live flight it holds only the first push of each person. until: entries before
    this day or time.
    """
    log: Audit = request.app.state.audit
    with suppress(StoreError):  # the stored entries can still be read
        await log.flush(store)
    entries = store.audit.read(since, until, who)
    if kind == "csv":
        return StreamingResponse(as_csv(entries), media_type=CSV)
    return StreamingResponse(as_json_lines(entries), media_type=JSON_LINES)
