"""What the server lets in: its own host and origin, bodies of a size, bearers of the token.

One ASGI layer around everything, HTTP and WebSocket alike, so that no route can forget it.
"""

import asyncio
import math
import re
import socket
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from app.http.problems import Problem, problem_response
from app.http.sessions import Sessions
from app.settings import Settings

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

COOKIE = "forewarn"
COOKIE_OF_PAGE = "forewarn-page"
"""Tells the page that there is a session to end; it lets nobody in."""
HOST = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([0-9A-Za-z._-]+))(?::[0-9]{0,5})?")
OPEN_PATHS = ("/healthz", "/login")
"""Answered without a token: a probe learns nothing from them."""
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
LARGEST_LOGIN = 4096
REFUSED, SESSION_OVER = 4403, 4401
"""WebSocket close codes; before the handshake they become HTTP 403."""

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self'; connect-src 'self'; frame-src 'self'; "
    "media-src 'self' data: blob:; worker-src 'self'; manifest-src 'self'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'"
)
API_POLICY = "default-src 'none'; frame-ancestors 'none'"
POLICIES = (("/api/", API_POLICY), ("/scene/", API_POLICY), ("/", PAGE_POLICY))
"""Content security policy by the start of the path, the first that fits; what a route says itself
(the scene's client, which needs inline code) stays."""

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
}

LOGIN_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Forewarn</title>
<meta name="viewport" content="width=device-width">
<style>body{{font:16px system-ui;background:#10151b;color:#e6edf3;display:grid;place-content:center;
min-height:90vh}}input,button{{font:inherit;padding:.4em .6em}}</style>
<form method="post" action="/login"><p><label for="token">Token of this Forewarn server</label></p>
<p><input id="token" name="token" type="password" required autofocus>
<button>Enter</button></p><p role="alert">{said}</p></form></html>"""


@dataclass(frozen=True)
class Refusal(Exception):
    """Why a connection is not let in."""

    status: int
    reason: str
    kind: str
    wait: int = 0
    """[s] until it may be tried again, where that is the reason."""


class Guard:
    """ASGI layer that checks Host, Origin and token, and adds the security headers."""

    def __init__(
        self, app: Application, settings: Settings, sessions: Sessions | None = None
    ) -> None:
        self.app = app
        self.settings = settings
        own = () if settings.is_local else (socket.gethostname(),)
        names = ("localhost", settings.host, *own, *settings.allowed_hosts)
        self.hosts = {name.lower() for name in names}
        self.sessions = sessions

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a connection through, or answer it here."""
        if scope["type"] not in ("http", "websocket"):
            return await self.app(scope, receive, send)
        connection = HTTPConnection(scope)
        send = _with_headers(send, scope)
        try:
            self.check_host(connection.headers)
            self.check_origin(scope, connection.headers)
            if self.sessions and scope["type"] == "http" and scope["path"] in ("/login", "/logout"):
                answer = self._logout if scope["path"] == "/logout" else self._login
                return await (await answer(Request(scope, receive), self.sessions))(
                    scope, receive, send
                )
            session = self.check_token(scope, connection)
        except Refusal as refusal:
            return await self._refuse(refusal, scope, receive, send)
        if self.sessions and session and scope["type"] == "websocket":
            over = asyncio.ensure_future(self.sessions.wait_for_end(session))
            try:
                return await self.app(scope, *_until(over, receive, send))
            finally:
                over.cancel()
        return await self.app(scope, receive, send)

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

    def check_token(self, scope: Scope, connection: HTTPConnection) -> str:
        """Refuse a connection without the token; by header, by cookie, by query on a WebSocket.

        Returns the key of the session that lets it in; empty where the token does.
        """
        session = connection.cookies.get(COOKIE, "")
        if self.sessions is None or scope["path"] in OPEN_PATHS:
            return ""
        if self.sessions.is_open(session):
            return session
        scheme, _, bearer = connection.headers.get("authorization", "").partition(" ")
        given = bearer.strip() if scheme.lower() == "bearer" else ""
        if scope["type"] == "websocket":
            given = given or connection.query_params.get("token", "")
        if given and (wait := _wait_of(self.sessions, connection)):
            self.sessions.turn_away(_address_of(connection))
            text = f"too many wrong tokens came from your address: try again in {wait} s"
            raise Refusal(429, text, "token", wait)
        if not given or not self.sessions.is_token(given, _address_of(connection)):
            raise Refusal(
                401, "the token is missing or wrong: send `Authorization: Bearer TOKEN`", "token"
            )
        return ""

    async def _refuse(self, refusal: Refusal, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": REFUSED, "reason": refusal.reason})
            return
        problem = Problem(refusal.status, refusal.reason, f"urn:forewarn:{refusal.kind}")
        headers = {"WWW-Authenticate": "Bearer"} if refusal.status == 401 else {}
        if refusal.wait:
            headers["Retry-After"] = str(refusal.wait)
        response = problem_response(problem, headers)
        wants_page = "text/html" in Headers(scope=scope).get("accept", "")
        if refusal.status == 401 and wants_page and scope["method"] == "GET":
            response = RedirectResponse("/login", 303)
        await response(scope, receive, send)

    async def _login(self, request: Request, sessions: Sessions) -> Response:
        """Let in by a link for one use or by the token that is posted; else ask for it."""
        if request.method not in ("GET", "HEAD", "POST"):
            return problem_response(Problem(405, "GET or POST a token"), {"Allow": "GET, POST"})
        if request.method == "POST":
            if wait := _wait_of(sessions, request):
                sessions.turn_away(_address_of(request))
                text = f"Too many wrong tokens came from here: try again in {wait} s."
                return _asking(text, 429, {"Retry-After": str(wait)})
            given = await _posted_token(request)
            if sessions.is_token(given, _address_of(request)):
                return _entered(request, sessions)
            return _asking("That is not this server's token.", 401)
        if "token" in request.query_params:
            return _asking("A token is not taken from an address: enter it here.", 400)
        link = request.query_params.get("link")
        if link is None or request.method == "HEAD":
            return _asking()
        if sessions.use_link(link):
            return _entered(request, sessions)
        return _asking("That link was used, or is too old: enter the token.", 401)

    async def _logout(self, request: Request, sessions: Sessions) -> Response:
        """End the session and ask for the token again."""
        if request.method != "POST":
            return problem_response(Problem(405, "POST to log out"), {"Allow": "POST"})
        sessions.end(request.cookies.get(COOKIE, ""))
        response = RedirectResponse("/login", 303)
        for cookie in (COOKIE, COOKIE_OF_PAGE):
            response.delete_cookie(cookie)
        return response


def _asking(
    said: str = "", status: int = 200, headers: Mapping[str, str] | None = None
) -> Response:
    """The page that asks for the token."""
    return HTMLResponse(LOGIN_PAGE.format(said=said), status, headers)


def _entered(request: Request, sessions: Sessions) -> Response:
    """Begin a session; its cookies end with the browser."""
    response, secure = RedirectResponse("/", 303), request.url.scheme == "https"
    response.set_cookie(COOKIE, sessions.begin(), httponly=True, samesite="strict", secure=secure)
    response.set_cookie(COOKIE_OF_PAGE, "1", samesite="strict", secure=secure)
    return response


def _wait_of(sessions: Sessions, connection: HTTPConnection) -> int:
    """How long no token of this address is looked at, since too many were wrong [s]."""
    return math.ceil(sessions.wait_of(_address_of(connection)))


def _address_of(connection: HTTPConnection) -> str:
    return connection.client.host if connection.client else ""


class BodyLimit:
    """ASGI layer that refuses a body above so many bytes, said or sent.

    FastAPI's `max_body_size` would answer a said length in plain text, after the route has run.
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
        said = Headers(scope=scope).get("content-length", "")
        if said.isdigit() and int(said) > most:
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


async def _posted_token(request: Request) -> str:
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > LARGEST_LOGIN:
            return ""
    fields = parse_qs(body.decode("utf-8", "replace"))
    return fields.get("token", [""])[0].strip()


def _until(over: asyncio.Future[None], receive: Receive, send: Send) -> tuple[Receive, Send]:
    """Receive and send of a WebSocket that is closed once its session is over.

    The application is told as if the client had left; what it sends then goes nowhere.
    """

    async def receiving() -> Message:
        coming = asyncio.ensure_future(receive())
        try:
            await asyncio.wait((coming, over), return_when=asyncio.FIRST_COMPLETED)
            message = coming.result() if coming.done() else {"type": ""}
            if not over.done() or message["type"] == "websocket.disconnect":
                return message
        finally:
            coming.cancel()
        reason = "the session is over: log in again"
        await send({"type": "websocket.close", "code": SESSION_OVER, "reason": reason})
        return {"type": "websocket.disconnect", "code": SESSION_OVER, "reason": reason}

    async def sending(message: Message) -> None:
        if not over.done():
            await send(message)

    return receiving, sending


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
