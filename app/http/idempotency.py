"""Requests that come twice: `Idempotency-Key` on what creates (draft-ietf-httpapi-idempotency-key).

The first request of a key is noted before it is carried out, and its answer is kept for a day. The
same request again gets that answer, with `Idempotent-Replayed` as it is of then; another one of the
same key is 422; one that comes while the first is carried out is 409, as is one whose first was cut
off by the server's end: whether that was carried out is not known, and it is not done twice. A
request that was refused may come again. A key is its sender's own: another person's is another key.

Where what was created is deleted by then, it is 410. The draft says that the answer SHOULD be
repeated; but a client takes 201 for word that the thing is there.
"""

import asyncio
import hashlib
import logging
import re
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from starlette.datastructures import Headers
from starlette.responses import Response

from app.http.problems import Problem, problem_response, problem_responses
from app.store.answers import Answer, AnswerRepository
from app.store.store import StoreError

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
ASGIApp = Callable[[MutableMapping[str, Any], Receive, Send], Awaitable[None]]

LOG = logging.getLogger("forewarn")
NAME, REPLAYED = "Idempotency-Key", "Idempotent-Replayed"
CREATES = re.compile(
    r"/api/v1/(datasets|monitors|recordings|flights|studies|sweeps|recordings/[^/]+/(scorings|markers))"
)
KEY = re.compile(r"[!-~]{1,200}")
"""Printable ASCII without blanks; the quotes of a structured string may stand around it."""
KEPT_HEADERS = ("content-type", "location")
PARAMETER: dict[str, Any] = {
    "name": NAME,
    "in": "header",
    "required": False,
    "schema": {"type": "string", "minLength": 1, "maxLength": 200, "pattern": "^[!-~]+$"},
    "description": "the same key with the same request gives the same answer, for a day; 410 where "
    "what it created was deleted since",
}


class Idempotent:
    """ASGI layer that carries a request with a key out once."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._under_way: set[tuple[str, str]] = set()

    async def __call__(self, scope: MutableMapping[str, Any], receive: Receive, send: Send) -> None:
        """Pass on, or answer as before."""
        key = _key(scope)
        if key is None:
            return await self.app(scope, receive, send)
        request = scope["path"], f"{scope['person'].name} {key}"
        if not KEY.fullmatch(key):
            return await _refuse(422, "a key is 1 to 200 characters without blanks", scope, send)
        if request in self._under_way:
            text = "the first request of this key is being carried out: wait for its answer"
            return await _refuse(409, text, scope, send)
        self._under_way.add(request)
        try:
            return await self._once(request, scope, receive, send)
        except Problem as problem:
            return await problem_response(problem)(scope, _nothing, send)
        except StoreError as error:
            return await _refuse(503, str(error), scope, send)
        finally:
            self._under_way.discard(request)

    async def _once(
        self,
        request: tuple[str, str],
        scope: MutableMapping[str, Any],
        receive: Receive,
        send: Send,
    ) -> None:
        answers = scope["app"].state.store.answers
        body, heard = _Body(scope, receive), _Heard(send)
        earlier = await asyncio.to_thread(answers.find, *request)
        if earlier is not None:
            await body.drain()
            is_gone = await asyncio.to_thread(answers.is_gone, request[0], earlier)
            return await _again(earlier, body.fingerprint, is_gone, scope, send)
        await asyncio.to_thread(answers.start, *request, "")
        try:
            await self.app(scope, body.receive, heard.send)
        finally:
            await asyncio.shield(asyncio.to_thread(_keep, answers, request, heard, body))
        return await heard.pass_on()


def _keep(
    answers: AnswerRepository, request: tuple[str, str], heard: "_Heard", body: "_Body"
) -> None:
    """Keep the answer to what was carried out; forget a request that was refused."""
    try:
        if 200 <= heard.status < 300:
            answers.finish(*request, heard.answer(body.fingerprint))
        else:
            answers.forget(*request)
    except StoreError as error:
        LOG.warning("an answer is not kept, its request will not be carried out again: %s", error)


class _Body:
    """The body of a request, hashed as it comes."""

    def __init__(self, scope: MutableMapping[str, Any], receive: Receive) -> None:
        self._receive, self._ended = receive, False
        kind = Headers(scope=scope).get("content-type", "")
        self._sha = hashlib.sha256(b"\0".join([scope["query_string"], kind.encode()]) + b"\0")

    async def receive(self) -> Message:
        """The next message."""
        message = await self._receive()
        if message["type"] == "http.request":
            self._sha.update(message.get("body", b""))
            self._ended = not message.get("more_body", False)
        else:
            self._ended = True
        return message

    async def drain(self) -> None:
        """Take what was not read."""
        while not self._ended:
            await self.receive()

    @property
    def fingerprint(self) -> str:
        """SHA-256 of query, media type and body."""
        return self._sha.hexdigest()


class _Heard:
    """An answer, held back until it is kept."""

    def __init__(self, send: Send) -> None:
        self._send = send
        self._messages: list[Message] = []
        self.status = 500

    async def send(self, message: Message) -> None:
        """Take a message of the answer."""
        if message["type"] == "http.response.start":
            self.status = message["status"]
        self._messages.append(message)

    def answer(self, fingerprint: str) -> Answer:
        """The whole answer."""
        headers = Headers(raw=self._messages[0]["headers"])
        kept = {name: headers[name] for name in KEPT_HEADERS if name in headers}
        body = b"".join(message.get("body", b"") for message in self._messages[1:])
        return Answer(fingerprint, self.status, kept, body)

    async def pass_on(self) -> None:
        """Send it."""
        for message in self._messages:
            await self._send(message)


async def _again(
    earlier: Answer,
    fingerprint: str,
    is_gone: bool,
    scope: MutableMapping[str, Any],
    send: Send,
) -> None:
    """Answer a request of a key that was used before.   is_gone: what it created is deleted."""
    if earlier.status is None:
        text = (
            "the server ended while the first request of this key was carried out: see whether it "
            "was, and send it with another key if not"
        )
        return await _refuse(409, text, scope, send)
    if earlier.fingerprint != fingerprint:
        text = "this key came with another request: a new request needs a new key"
        return await _refuse(422, text, scope, send)
    if is_gone:
        text = (
            "this request was carried out, and what it created was deleted since: send it with "
            "another key to create it anew"
        )
        return await _refuse(410, text, scope, send)
    headers = {**(earlier.headers or {}), REPLAYED: "true"}
    response = Response(earlier.body, earlier.status, headers)
    return await response(scope, _nothing, send)


async def _refuse(status: int, text: str, scope: MutableMapping[str, Any], send: Send) -> None:
    problem = Problem(status, f"{NAME}: {text}", "urn:forewarn:idempotency-key")
    await problem_response(problem)(scope, _nothing, send)


async def _nothing() -> Message:
    return {"type": "http.disconnect"}


def _key(scope: MutableMapping[str, Any]) -> str | None:
    """The key of a request that creates; None where there is none."""
    if scope["type"] != "http" or scope["method"] != "POST":
        return None
    if not CREATES.fullmatch(scope["path"]):
        return None
    given = Headers(scope=scope).get(NAME)
    if given is not None and len(given) > 2 and given[0] == given[-1] == '"':
        return given[1:-1]
    return given


def describe_keys(document: dict[str, Any]) -> None:
    """Say in an OpenAPI document where a key is honoured."""
    for path, item in document["paths"].items():
        if "post" in item and CREATES.fullmatch(path):
            post = item["post"]
            post["parameters"] = [*post.get("parameters", []), PARAMETER]
            for status, response in problem_responses(409, 410, 422, 503).items():
                post["responses"].setdefault(str(status), response)
