"""People and their tokens."""

import asyncio
from typing import Annotated

from fastapi import Depends, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from app.access.people import People
from app.access.roles import allowed_to
from app.http.head_requests import Router
from app.http.problems import Problem, problem_responses
from app.routes.dependencies import PersonDep, StoreDep
from app.store.tokens import LINK_SECONDS, LONGEST_DAYS, Role, StoredToken, TokenError

router = Router(prefix="/api/v1", tags=["people"])


def _people(request: Request) -> People:
    return request.app.state.people


PeopleDep = Annotated[People, Depends(_people)]


class Me(BaseModel):
    """The person who sends the request."""

    name: str = Field(
        description="`server` with the token from the settings, `local` if no token is required"
    )
    role: Role
    allowed: list[str] = Field(
        description="requests allowed for the role, with path parameters as `{}`",
        examples=[["POST /api/v1/flights/{}/end"]],
    )


class TokenRequest(BaseModel):
    """A token for a person."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        json_schema_extra={"examples": [{"name": "Ann", "role": "operator", "days": 30}]},
    )

    name: str = Field(min_length=1, max_length=64)
    role: Role
    days: float | None = Field(
        default=None, gt=0, le=LONGEST_DAYS, description="days until it expires; null: never"
    )


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
    return Me(name=person.name, role=person.role, allowed=allowed_to(person.role))


@router.get("/tokens")
async def list_tokens(store: StoreDep) -> list[StoredToken]:
    """All tokens, newest first, without the secrets."""
    return await asyncio.to_thread(store.tokens.all)


@router.post("/tokens", status_code=201, responses=problem_responses(409, 422))
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
    try:
        made, secret = await asyncio.to_thread(
            store.tokens.add, wanted.name, wanted.role, wanted.days
        )
    except TokenError as error:
        raise Problem(422, str(error), "urn:forewarn:token") from error
    await people.refresh()
    response.headers["Location"] = f"{router.prefix}/tokens/{made.id}"
    return NewToken(id=made.id, name=made.name, role=made.role, expires=made.expires, token=secret)


@router.delete("/tokens/{token_id}", responses=problem_responses(404, 422))
async def revoke_token(token_id: str, store: StoreDep, people: PeopleDep) -> StoredToken:
    """Revoke a token permanently. Its sessions and WebSockets close; it stays in the list."""
    revoked = await asyncio.to_thread(store.tokens.revoke, token_id)
    await people.refresh()
    return revoked


@router.post("/tokens/{token_id}/link", responses=problem_responses(404, 409, 422))
async def make_link(token_id: str, store: StoreDep) -> LoginLink:
    """Make an address where the person can log in once without the token."""
    try:
        code = await asyncio.to_thread(store.tokens.make_link, token_id)
    except TokenError as error:
        raise Problem(409, str(error), "urn:forewarn:token") from error
    return LoginLink(path=f"/login?link={code}", seconds=LINK_SECONDS)
