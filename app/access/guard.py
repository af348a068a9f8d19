"""Access control by host, origin, token and role, and the size limit of bodies.

One ASGI layer surrounds everything, HTTP and WebSocket alike, so that no route can bypass it.
"""

import asyncio
import re
import socket
from collections.abc import Callable, Collection, Coroutine, Mapping
from dataclasses import replace
from functools import partial
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access import login
from app.access.audit import SAFE_METHODS, Audit, method_of
from app.access.login import Login
from app.access.people import Admission, People, Person
from app.access.roles import may, rule_of
from app.access.sessions import Sessions
from app.http.problems import Problem, problem_response
from app.settings import Settings

HOST = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([0-9A-Za-z._-]+))(?::[0-9]{0,5})?")
PUBLIC_PATHS = ("/healthz", "/openmct/forewarn.js")
"""Answered without a token: they reveal nothing."""
EVENTS_SUFFIX = "/events"
"""The path of every event stream ends with it."""
LOOK_EVERY_S = 0.5
"""[s] How often the end of a stream's session is looked for."""
REFUSED, SESSION_OVER = 4403, 4401
"""WebSocket close codes; before the handshake they become HTTP 403."""

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self'; connect-src 'self'; frame-src 'self'; "
    "media-src 'self' data: blob:; worker-src 'self'; manifest-src 'self'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'"
)
API_POLICY = "default-src 'none'; frame-ancestors 'none'"
SCENE_POLICY = "default-src 'none'; frame-ancestors 'self'"
"""For an unavailable scene: its frame must show the page the reason."""
POLICIES = (("/api/", API_POLICY), ("/scene/", SCENE_POLICY), ("/", PAGE_POLICY))
"""Content security policy by the start of the path; the first match counts. A route's own policy
(that of the scene's client, which needs inline code) has precedence."""

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
}
CORS_HEADERS = {
    "Access-Control-Allow-Headers": "Authorization",
    "Access-Control-Max-Age": "600",
}
"""For pages of allowed origins. Credentials are not allowed: a cookie never counts for them."""


def refusal(status: int, detail: str, kind: str, **extra: Any) -> Problem:
    return Problem(status, detail, f"urn:forewarn:{kind}", **extra)


class Guard:
    """ASGI layer that checks Host, Origin, token and role, and adds the security headers.

    It sets the scope's `person`.
    """

    def __init__(
        self,
        app: ASGIApp,
        settings: Settings,
        people: People,
        sessions: Sessions,
        audit: Audit,
    ) -> None:
        self.app = app
        self.settings = settings
        machine = () if settings.is_local else (socket.gethostname(),)
        names = ("localhost", settings.host, *machine, *settings.allowed_hosts)
        self.hosts = {name.lower() for name in names}
        self.people = people
        self.sessions = sessions
        self.audit = audit
        self.login = Login(people, sessions, audit)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            return await self.app(scope, receive, send)
        connection = HTTPConnection(scope)
        send = answer = _Answer(send, scope["path"])
        try:
            self.check_host(connection.headers)
            site = self.check_origin(scope, connection.headers)
            if site:
                answer.site = site
                if scope["type"] == "http" and scope["method"] == "OPTIONS":
                    return await Response(None, 204, CORS_HEADERS)(scope, receive, send)
            elif self.people.needs_token and _is_http(scope, login.PATHS):
                page = await self.login.answer(Request(scope, receive))
                return await page(scope, receive, send)
            if _is_http(scope, PUBLIC_PATHS):
                return await self.app(scope, receive, send)
            admission, session = self.check_token(scope, connection, site)
            person = admission.person
            if site:
                person = replace(person, role="viewer")
            scope["person"] = person
            self.check_role(connection, person)
        except Problem as problem:
            return await self._refuse(problem, scope, receive, send)
        answer.note = partial(self.audit.note_answer, connection, person)
        if scope["type"] == "http" and not scope["path"].endswith(EVENTS_SUFFIX):
            return await self.app(scope, receive, send)
        return await self._stream(self._wait_for_end(admission, session), scope, receive, send)

    def check_host(self, headers: Headers) -> None:
        """Refuse a foreign Host, against DNS rebinding.

        Numeric addresses cannot be rebound; they pass if other machines may connect.
        """
        hosts = headers.getlist("host")
        name = _host_name(hosts[0]) if len(hosts) == 1 else None
        if name is None:
            raise refusal(400, "the request needs exactly one valid host in `Host`", "host")
        if name in self.hosts or _is_address(name, self.settings):
            return
        raise refusal(
            400,
            f"{name} is not a host name of this server: use its address, or add the name to "
            "FOREWARN_ALLOWED_HOSTS",
            "host",
        )

    def check_origin(self, scope: Scope, headers: Headers) -> str:
        """Refuse requests that another site's page makes in a visitor's browser.

        Returns the site's origin if the settings allow it, else nothing.
        """
        origin = headers.get("origin")
        if origin in self.settings.allowed_origins and len(headers.getlist("origin")) == 1:
            return origin
        if origin is not None:
            parts = urlsplit(origin)
            same = parts.scheme in ("http", "https") and parts.netloc == headers["host"]
            if len(headers.getlist("origin")) > 1 or not same:
                raise refusal(403, f"the request comes from another site, {origin}", "origin")
        changes = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        if changes and headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            raise refusal(403, "the request comes from another site", "origin")
        return ""

    def check_token(
        self, scope: Scope, connection: HTTPConnection, site: str
    ) -> tuple[Admission, str]:
        """Refuse a connection without a valid token in header, cookie or (WebSocket) query.

        site: allowed origin of another site's page, whose cookies do not count.
        Returns the access, and the key of its session, if any. If the server needs no token, every
        client is `local`.
        """
        if not self.people.needs_token:
            return self.people.local, ""
        scheme, _, bearer = connection.headers.get("authorization", "").partition(" ")
        token = bearer.strip() if scheme.lower() == "bearer" else ""
        if scope["type"] == "websocket":
            token = token or connection.query_params.get("token", "")
        if token and (admission := self.people.find(token)):
            return admission, ""
        session = "" if site else connection.cookies.get(login.COOKIE, "")
        if admission := self.sessions.use(session):
            return admission, session
        if token:
            self.login.log_wrong_token(connection)
        text = "the token is missing, wrong or expired: send `Authorization: Bearer TOKEN`"
        raise refusal(401, text, "token")

    def check_role(self, connection: HTTPConnection, person: Person) -> None:
        """Refuse and log a request that the person's role does not allow."""
        method, path = method_of(connection), connection.scope["path"]
        needed = rule_of(method, path).role
        if may(person.role, needed):
            return
        self.audit.note(connection, person, 403)
        has = f"{person.name} has the role {person.role}"
        text = f"{method} {path} needs the role {needed}; {has}"
        raise refusal(403, text, "role", needed=needed, role=person.role)

    async def _stream(
        self, end: Coroutine[Any, Any, None], scope: Scope, receive: Receive, send: Send
    ) -> None:
        """Serve a stream of events or a WebSocket until its token or session ends."""
        is_open = False

        async def send_on(message: Message) -> None:
            nonlocal is_open
            is_open = message["type"] == "http.response.start" or message.get("more_body", False)
            await send(message)

        ended = asyncio.ensure_future(end)
        work = asyncio.ensure_future(self.app(scope, receive, send_on))
        try:
            await asyncio.wait((ended, work), return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (ended, work):
                task.cancel()
            await asyncio.wait((ended, work))
        if not work.cancelled():
            work.result()
        elif scope["type"] == "websocket":
            reason = "the session or its token has ended: log in again"
            await send({"type": "websocket.close", "code": SESSION_OVER, "reason": reason})
        elif is_open:
            await send({"type": "http.response.body", "body": b""})

    async def _wait_for_end(self, admission: Admission, session: str) -> None:
        while not admission.has_ended and (not session or self.sessions.is_open(session)):
            await asyncio.sleep(LOOK_EVERY_S)

    async def _refuse(self, problem: Problem, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": REFUSED, "reason": problem.detail})
            return
        headers = {"WWW-Authenticate": "Bearer"} if problem.status == 401 else {}
        response = problem_response(problem, headers)
        wants_page = "text/html" in Headers(scope=scope).get("accept", "")
        if problem.status == 401 and wants_page and scope["method"] == "GET":
            response = RedirectResponse("/login", 303)
        await response(scope, receive, send)


class BodyLimit:
    """ASGI layer that refuses a body above a size, declared or sent.

    FastAPI's `max_body_size` would answer a declared length in plain text, after the route has run.
    uploads: larger limits by method and path.
    """

    def __init__(
        self, app: ASGIApp, max_bytes: int, uploads: Mapping[tuple[str, str], int]
    ) -> None:
        self.app = app
        self.max_bytes = max_bytes
        self.uploads = uploads

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Count the bytes of the body; 413 before reading if the declared length is too large."""
        if scope["type"] != "http":
            return await self.app(scope, receive, send)
        most = self.uploads.get((scope["method"], scope["path"]), self.max_bytes)
        declared = Headers(scope=scope).get("content-length", "")
        if declared.isdigit() and int(declared) > most:
            return await problem_response(too_large(most))(scope, receive, send)
        read = 0

        async def receive_counted() -> Message:
            nonlocal read
            message = await receive()
            read += len(message.get("body", b""))
            if read > most:
                raise too_large(most)
            return message

        return await self.app(scope, receive_counted, send)


def too_large(most: int) -> Problem:
    """most: bytes of a body."""
    text = f"the body is too large: send at most {most} bytes"
    return Problem(413, text, "urn:forewarn:body", max_bytes=most)


def _host_name(host: str) -> str | None:
    """Name or address in a Host header, without port and brackets; None if invalid."""
    match = HOST.fullmatch(host)
    return match and (match[1] or match[2]).lower()


def _is_address(name: str, settings: Settings) -> bool:
    try:
        address = ip_address(name)
    except ValueError:
        return False
    return address.is_loopback or not settings.is_local


def _is_http(scope: Scope, paths: Collection[str]) -> bool:
    return scope["type"] == "http" and scope["path"] in paths


class _Answer:
    """Sends an answer with the security headers that its route has not set.

    site: another origin, whose page may read it.   note: receives the status; an accepted WebSocket
    counts as 101.
    """

    def __init__(self, send: Send, path: str) -> None:
        self._send, self._path = send, path
        self.site = ""
        self.note: Callable[[int], None] = lambda _: None

    async def __call__(self, message: Message) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            policy = next(policy for start, policy in POLICIES if self._path.startswith(start))
            headers.setdefault("Content-Security-Policy", policy)
            kept = "no-store" if "/api/" in self._path else "no-cache"
            headers.setdefault("Cache-Control", kept)
            if self.site:
                headers["Access-Control-Allow-Origin"] = self.site
                headers.add_vary_header("Origin")
        if message["type"] == "http.response.start":
            self.note(message["status"])
        elif message["type"] == "websocket.accept":
            self.note(101)
        await self._send(message)
