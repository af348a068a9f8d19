"""`Idempotency-Key` (draft-ietf-httpapi-idempotency-key): a repeated request creates nothing twice.

The first request with a key is noted before it runs, and its answer is stored for a day. Each
person has their own keys. A repeated request gets:

- the stored answer with `Idempotent-Replayed`, unless the requests differ: then 422;
- 409 while the first one runs, or if the server stopped during it: its outcome is unknown;
- 410 if what it created has been deleted. The draft says that the answer SHOULD be repeated, but a
  client takes 201 as proof that the resource exists.

A request that was refused may be sent again.
"""

import asyncio
import hashlib
import logging
import re
from typing import Any

from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.http.problems import Problem, problem_response, problem_responses
from app.store.answers import Answer, AnswerRepository
from app.store.store import StoreError

LOG = logging.getLogger("forewarn")
NAME, REPLAYED = "Idempotency-Key", "Idempotent-Replayed"
CREATES = re.compile(
    r"/api/v1/(datasets|monitors|recordings|flights|studies|sweeps|recordings/[^/]+/(scorings|markers))"
)
KEY = re.compile(r"[!-~]{1,200}")
"""Printable ASCII without blanks; quotes of a structured string are removed first."""
STORED_HEADERS = ("content-type", "location")
PARAMETER: dict[str, Any] = {
    "name": NAME,
    "in": "header",
    "required": False,
    "schema": {"type": "string", "minLength": 1, "maxLength": 200, "pattern": "^[!-~]+$"},
    "description": "the same key with the same request gives the same answer for a day; 410 if "
    "what it created has been deleted",
}


class Idempotent:
    """ASGI layer that carries out a request with a key once."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._in_progress: set[tuple[str, str]] = set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        key = _key(scope)
        if key is None:
            return await self.app(scope, receive, send)
        request = scope["path"], f"{scope['person'].name} {key}"
        try:
            if not KEY.fullmatch(key):
                raise _problem(422, "give 1 to 200 ASCII characters without blanks")
            if request in self._in_progress:
                text = "the first request with this key is in progress: wait for its answer"
                raise _problem(409, text)
            self._in_progress.add(request)
            try:
                await self._run_once(request, scope, receive, send)
            finally:
                self._in_progress.discard(request)
        except Problem as problem:
            await problem_response(problem)(scope, receive, send)
        except StoreError as error:
            await problem_response(_problem(503, str(error)))(scope, receive, send)

    async def _run_once(
        self, request: tuple[str, str], scope: Scope, receive: Receive, send: Send
    ) -> None:
        answers = scope["app"].state.store.answers
        body, response = _Body(scope, receive), _BufferedResponse(send)
        earlier = await asyncio.to_thread(answers.find, *request)
        if earlier is not None:
            await body.drain()
            is_gone = await asyncio.to_thread(answers.is_gone, request[0], earlier)
            repeated = _repeated(earlier, body.fingerprint, is_gone)
            return await repeated(scope, receive, send)
        await asyncio.to_thread(answers.start, *request)
        try:
            await self.app(scope, body.receive, response.send)
        finally:
            await asyncio.shield(asyncio.to_thread(_store, answers, request, response, body))
        return await response.forward()


def _store(
    answers: AnswerRepository,
    request: tuple[str, str],
    response: "_BufferedResponse",
    body: "_Body",
) -> None:
    """Store the answer to a request that was carried out; forget one that was refused."""
    try:
        if 200 <= response.status < 300:
            answers.finish(*request, response.answer(body.fingerprint))
        else:
            answers.forget(*request)
    except StoreError as error:
        LOG.warning("an answer was not stored, so a repeat of its request gets 409: %s", error)


class _Body:
    """The body of a request, hashed while it is read."""

    def __init__(self, scope: Scope, receive: Receive) -> None:
        self._receive, self._ended = receive, False
        kind = Headers(scope=scope).get("content-type", "")
        self._sha = hashlib.sha256(b"\0".join([scope["query_string"], kind.encode()]) + b"\0")

    async def receive(self) -> Message:
        message = await self._receive()
        if message["type"] == "http.request":
            self._sha.update(message.get("body", b""))
            self._ended = not message.get("more_body", False)
        else:
            self._ended = True
        return message

    async def drain(self) -> None:
        while not self._ended:
            await self.receive()

    @property
    def fingerprint(self) -> str:
        """SHA-256 of query, media type and body."""
        return self._sha.hexdigest()


class _BufferedResponse:
    """An answer that is sent only after it is stored."""

    def __init__(self, send: Send) -> None:
        self._send = send
        self._messages: list[Message] = []
        self.status = 500

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
        self._messages.append(message)

    def answer(self, fingerprint: str) -> Answer:
        headers = Headers(raw=self._messages[0]["headers"])
        stored = {name: headers[name] for name in STORED_HEADERS if name in headers}
        body = b"".join(message.get("body", b"") for message in self._messages[1:])
        return Answer(fingerprint, self.status, stored, body)

    async def forward(self) -> None:
        for message in self._messages:
            await self._send(message)


def _repeated(earlier: Answer, fingerprint: str, is_gone: bool) -> Response:
    """Answer a repeated key. Problem.   is_gone: what the first request created was deleted."""
    if earlier.status is None:
        raise _problem(
            409,
            "the server stopped during the first request with this key: check whether it was "
            "carried out, and if not, send it with a new key",
        )
    if earlier.fingerprint != fingerprint:
        raise _problem(422, "this key belongs to another request: use a new key")
    if is_gone:
        raise _problem(
            410,
            "this request was carried out, and what it created has been deleted: use a new key to "
            "create it again",
        )
    return Response(earlier.body, earlier.status, {**(earlier.headers or {}), REPLAYED: "true"})


def _problem(status: int, text: str) -> Problem:
    return Problem(status, f"{NAME}: {text}", "urn:forewarn:idempotency-key")


def _key(scope: Scope) -> str | None:
    """The key of a request that creates; None without one."""
    if scope["type"] != "http" or scope["method"] != "POST":
        return None
    if not CREATES.fullmatch(scope["path"]):
        return None
    key = Headers(scope=scope).get(NAME)
    if key is not None and len(key) > 2 and key[0] == key[-1] == '"':
        return key[1:-1]
    return key


def describe_keys(document: dict[str, Any]) -> None:
    for path, item in document["paths"].items():
        if "post" in item and CREATES.fullmatch(path):
            post = item["post"]
            post["parameters"] = [*post.get("parameters", []), PARAMETER]
            for status, response in problem_responses(409, 410, 422, 503).items():
                post["responses"].setdefault(str(status), response)
