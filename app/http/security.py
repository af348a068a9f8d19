"""What the server lets in: its own host and origin, bodies of a size, people by token and role.

One ASGI layer around everything, HTTP and WebSocket alike, so that no route can forget it.
"""

import asyncio
import re
import socket
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine, Mapping, MutableMapping
from dataclasses import dataclass, field
from functools import partial
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import RedirectResponse

from app.http import login
from app.http.audit import SAFE_METHODS, Audit, method_of
from app.http.login import Login
from app.http.people import Admission, People, Person
from app.http.problems import Problem, problem_response
from app.http.roles import may, rule_of
from app.http.sessions import Sessions
from app.settings import Settings

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

HOST = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([0-9A-Za-z._-]+))(?::[0-9]{0,5})?")
HEALTH_PATH = "/healthz"
"""Answered without a token: a probe learns nothing from it."""
EVENTS = "/events"
"""How the path of a stream of events ends."""
REFUSED, SESSION_OVER = 4403, 4401
OVER = "the session or its token is over: log in again"
MOST_READ_AHEAD = 16
"""Messages of a WebSocket."""
"""WebSocket close codes; before the handshake they become HTTP 403."""

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self'; connect-src 'self'; frame-src 'self'; "
    "media-src 'self' data: blob:; worker-src 'self'; manifest-src 'self'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'"
)
API_POLICY = "default-src 'none'; frame-ancestors 'none'"
SCENE_POLICY = "default-src 'none'; frame-ancestors 'self'"
"""Of a scene that is not shown: the page whose frame it is in must be able to tell why."""
POLICIES = (("/api/", API_POLICY), ("/scene/", SCENE_POLICY), ("/", PAGE_POLICY))
"""Content security policy by the start of the path, the first that fits; what a route says itself
(the scene's client, which needs inline code) stays."""

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
}


@dataclass(frozen=True)
class Refusal(Exception):
    """Why a connection is not let in."""

    status: int
    reason: str
    kind: str
    extra: Mapping[str, str] = field(default_factory=dict)
    """Further members of the problem document."""


class Guard:
    """ASGI layer that checks Host, Origin, token and role, and adds the security headers.

    Who is let in is the `person` of the scope from there on.
    """

    def __init__(
        self,
        app: Application,
        settings: Settings,
        people: People,
        sessions: Sessions,
        audit: Audit,
    ) -> None:
        self.app = app
        self.settings = settings
        own = () if settings.is_local else (socket.gethostname(),)
        names = ("localhost", settings.host, *own, *settings.allowed_hosts)
        self.hosts = {name.lower() for name in names}
        self.people = people
        self.sessions = sessions
        self.audit = audit
        self.login = Login(people, sessions, audit)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a connection through, or answer it here."""
        if scope["type"] not in ("http", "websocket"):
            return await self.app(scope, receive, send)
        connection = HTTPConnection(scope)
        send = _with_headers(send, scope)
        try:
            self.check_host(connection.headers)
            self.check_origin(scope, connection.headers)
            if self.people.asks and scope["type"] == "http" and scope["path"] in login.PATHS:
                answer = await self.login.answer(Request(scope, receive))
                return await answer(scope, receive, send)
            if scope["type"] == "http" and scope["path"] == HEALTH_PATH:
                return await self.app(scope, receive, send)
            admission, session = self.check_token(scope, connection)
            scope["person"] = person = admission.person
            self.check_role(connection, person)
        except Refusal as refusal:
            return await self._refuse(refusal, scope, receive, send)
        send = _noted(send, partial(self.audit.note_answer, connection, person))
        if scope["type"] == "http":
            if not scope["path"].endswith(EVENTS):
                return await self.app(scope, receive, send)
            return await self._stream(self._wait_for_end(admission, session), scope, receive, send)
        over = asyncio.ensure_future(self._wait_for_end(admission, session))
        watched = _Watched(over, receive, send)
        try:
            return await self.app(scope, watched.receive, watched.send)
        finally:
            watched.close()

    def check_host(self, headers: Headers) -> None:
        """Refuse a Host that is not this server's: a name that was rebound to this address.

        Addresses written as numbers cannot be rebound; they pass where others may connect.
        """
        given = headers.getlist("host")
        name = _host_name(given[0]) if len(given) == 1 else None
        if name is None:
            raise Refusal(400, "the request names no host, or more than one", "host")
        if name in self.hosts or _is_address(name, self.settings):
            return
        raise Refusal(
            400,
            f"this server is not called {name}: use its address, or add the name to "
            "FOREWARN_ALLOWED_HOSTS",
            "host",
        )

    def check_origin(self, scope: Scope, headers: Headers) -> None:
        """Refuse what another site's page asks of this server in a visitor's browser."""
        origin = headers.get("origin")
        if origin is not None:
            parts = urlsplit(origin)
            same = parts.scheme in ("http", "https") and parts.netloc == headers["host"]
            if len(headers.getlist("origin")) > 1 or not same:
                raise Refusal(403, f"the request comes from another site, {origin}", "origin")
        changes = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        if changes and headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            raise Refusal(403, "the request comes from another site", "origin")

    def check_token(self, scope: Scope, connection: HTTPConnection) -> tuple[Admission, str]:
        """Refuse a connection without a token; by header, by cookie, by query on a WebSocket.

        Returns what lets it in, and the key of the session that does, if any. Where no token is
        asked for, everybody is `local`.
        """
        if not self.people.asks:
            return self.people.local, ""
        scheme, _, bearer = connection.headers.get("authorization", "").partition(" ")
        given = bearer.strip() if scheme.lower() == "bearer" else ""
        if scope["type"] == "websocket":
            given = given or connection.query_params.get("token", "")
        if given and (admission := self.people.find(given)):
            return admission, ""
        session = connection.cookies.get(login.COOKIE, "")
        if admission := self.sessions.use(session):
            return admission, session
        if given:
            self.login.log_wrong_token(connection)
        text = "the token is missing, wrong or over: send `Authorization: Bearer TOKEN`"
        raise Refusal(401, text, "token")

    def check_role(self, connection: HTTPConnection, person: Person) -> None:
        """Refuse what a person's role does not allow, and log that it was tried."""
        method, path = method_of(connection), connection.scope["path"]
        needed = rule_of(method, path).role
        if may(person.role, needed):
            return
        self.audit.note(connection, person, 403)
        has = f"{person.name} has the role {person.role}"
        text = f"the role {needed} is needed, {has}: {method} {path}"
        raise Refusal(403, text, "role", {"needed": needed, "role": person.role})

    async def _stream(
        self, end: Coroutine[Any, Any, None], scope: Scope, receive: Receive, send: Send
    ) -> None:
        """Pass on a stream of events, which ends when what let it in does."""
        is_open = False

        async def sending(message: Message) -> None:
            nonlocal is_open
            is_open = message["type"] == "http.response.start" or message.get("more_body", False)
            await send(message)

        over = asyncio.ensure_future(end)
        work = asyncio.ensure_future(self.app(scope, receive, sending))
        try:
            await asyncio.wait((over, work), return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (over, work):
                task.cancel()
            await asyncio.wait((over, work))
        if not work.cancelled():
            work.result()
        elif is_open:
            await send({"type": "http.response.body", "body": b""})

    async def _wait_for_end(self, admission: Admission, session: str) -> None:
        """Return once a token lets in no more, or the session that it began is over."""
        ends = [admission.wait_for_end()]
        if session:
            ends.append(self.sessions.wait_for_end(session))
        tasks = [asyncio.ensure_future(end) for end in ends]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()

    async def _refuse(self, refusal: Refusal, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": REFUSED, "reason": refusal.reason})
            return
        kind = f"urn:forewarn:{refusal.kind}"
        problem = Problem(refusal.status, refusal.reason, kind, **refusal.extra)
        headers = {"WWW-Authenticate": "Bearer"} if refusal.status == 401 else {}
        response = problem_response(problem, headers)
        wants_page = "text/html" in Headers(scope=scope).get("accept", "")
        if refusal.status == 401 and wants_page and scope["method"] == "GET":
            response = RedirectResponse("/login", 303)
        await response(scope, receive, send)


class BodyLimit:
    """ASGI layer that refuses a body above a size, declared or sent.

    FastAPI's `max_body_size` would answer a declared length in plain text, after the route ran.
    uploads: where a body may be larger, by method and path.
    """

    def __init__(
        self, app: Application, max_bytes: int, uploads: Mapping[tuple[str, str], int]
    ) -> None:
        self.app = app
        self.max_bytes = max_bytes
        self.uploads = uploads

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, counting what comes; 413 before reading where the length is said."""
        if scope["type"] != "http":
            return await self.app(scope, receive, send)
        most = self.uploads.get((scope["method"], scope["path"]), self.max_bytes)
        length = Headers(scope=scope).get("content-length", "")
        if length.isdigit() and int(length) > most:
            return await problem_response(_too_large(most))(scope, receive, send)
        read = 0

        async def counting() -> Message:
            nonlocal read
            message = await receive()
            read += len(message.get("body", b""))
            if read > most:
                raise _too_large(most)
            return message

        return await self.app(scope, counting, send)


def _too_large(most: int) -> Problem:
    """What is answered: how much is allowed."""
    text = f"the body is too large: this server takes {most} bytes at most"
    return Problem(413, text, "urn:forewarn:body", max_bytes=most)


def policy_of(path: str) -> str:
    """Content security policy of a path."""
    return next(policy for start, policy in POLICIES if path.startswith(start))


def _host_name(host: str) -> str | None:
    """Name or address in a Host header, without port and brackets; None if it is not one."""
    match = HOST.fullmatch(host)
    return match and (match[1] or match[2]).lower()


def _is_address(name: str, settings: Settings) -> bool:
    try:
        address = ip_address(name)
    except ValueError:
        return False
    return address.is_loopback or not settings.is_local


class _Watched:
    """Receive and send of a WebSocket that is closed once its session is over.

    The application is told as if the client had left; what either side sends then goes nowhere.
    One task reads for the whole connection: a task a message would cost more than the message.
    """

    def __init__(self, over: asyncio.Future[None], receive: Receive, send: Send) -> None:
        self._over, self._receive, self._send = over, receive, send
        self._messages: deque[Message] = deque()
        self._come, self._room = asyncio.Event(), asyncio.Event()
        self._reading: asyncio.Future[None] | None = None
        over.add_done_callback(lambda _: self._come.set())

    async def receive(self) -> Message:
        """The next message of the client, or that it is gone."""
        if self._reading is None:
            self._reading = asyncio.ensure_future(self._read())
        while not (self._messages or self._over.done()):
            self._come.clear()
            await self._come.wait()
        if self._messages:
            message = self._messages.popleft()
            self._room.set()
            if not self._over.done() or message["type"] == "websocket.disconnect":
                return message
        await self._send({"type": "websocket.close", "code": SESSION_OVER, "reason": OVER})
        return {"type": "websocket.disconnect", "code": SESSION_OVER, "reason": OVER}

    async def send(self, message: Message) -> None:
        """Send, as long as the session lasts."""
        if not self._over.done():
            await self._send(message)

    def close(self) -> None:
        """Read no more."""
        self._over.cancel()
        if self._reading is not None:
            self._reading.cancel()

    async def _read(self) -> None:
        while True:
            message = await self._receive()
            self._messages.append(message)
            self._come.set()
            if message["type"] == "websocket.disconnect":
                return
            while len(self._messages) >= MOST_READ_AHEAD:
                self._room.clear()
                await self._room.wait()


def _noted(send: Send, note: Callable[[int], None]) -> Send:
    """Note the status of an answer; an accepted WebSocket has 101."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            note(message["status"])
        elif message["type"] == "websocket.accept":
            note(101)
        await send(message)

    return sending


def _with_headers(send: Send, scope: Scope) -> Send:
    """Add the security headers to a response; a route's own ones stay."""
    path = scope["path"]

    async def sending(message: Message) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            headers.setdefault("Content-Security-Policy", policy_of(path))
            headers.setdefault("Cache-Control", "no-store" if "/api/" in path else "no-cache")
        await send(message)

    return sending
