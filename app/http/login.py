"""Logging in and out: a page that asks for a token, links for one use, the session's cookies."""

import asyncio
import logging
import math
import time
from urllib.parse import parse_qs

from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from app.http.audit import Audit
from app.http.people import Admission, People
from app.http.problems import Problem, problem_response
from app.http.sessions import Sessions
from app.store.store import Store, StoreError

LOG = logging.getLogger("forewarn")
COOKIE = "forewarn"
COOKIE_OF_PAGE = "forewarn-page"
"""Tells the page that there is a session to end; it lets nobody in."""
PATHS = ("/login", "/logout")
LARGEST_LOGIN = 4096
LOGGED_EVERY_S = 1.0

LOGIN_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Forewarn</title>
<meta name="viewport" content="width=device-width">
<style>body{{font:16px system-ui;background:#10151b;color:#e6edf3;display:grid;place-content:center;
min-height:90vh}}input,button{{font:inherit;padding:.4em .6em}}</style>
<form method="post" action="/login"><p><label for="token">Token of this Forewarn server</label></p>
<p><input id="token" name="token" type="password" required autofocus>
<button>Enter</button></p><p role="alert">{message}</p></form></html>"""


class Login:
    """What is answered at /login and /logout."""

    def __init__(self, people: People, sessions: Sessions, audit: Audit) -> None:
        self._people = people
        self._sessions = sessions
        self._audit = audit
        self._logged = -math.inf

    async def answer(self, request: Request) -> Response:
        """Answer a request for one of PATHS."""
        if request.scope["path"] == "/logout":
            return self._log_out(request)
        if request.method == "POST":
            return await self._take_token(request)
        if request.method not in ("GET", "HEAD"):
            return problem_response(Problem(405, "GET or POST a token"), {"Allow": "GET, POST"})
        if "token" in request.query_params:
            return _asking("A token is not taken from an address: enter it here.", 400)
        link = request.query_params.get("link")
        if link is None or request.method == "HEAD":
            return _asking()
        return await self._take_link(request, link)

    async def _take_token(self, request: Request) -> Response:
        given = await _posted_token(request)
        if admission := self._people.find(given):
            return self._entered(request, admission)
        if given:
            self.log_wrong_token(request)
        return _asking("That is not a token of this server.", 401)

    def log_wrong_token(self, connection: HTTPConnection) -> None:
        """Log the address of a wrong token, never the token; one line in LOGGED_EVERY_S."""
        now = time.monotonic()
        if now - self._logged >= LOGGED_EVERY_S:
            self._logged = now
            address = connection.client.host if connection.client else "an unknown address"
            LOG.warning("wrong token from %s", address)

    async def _take_link(self, request: Request, link: str) -> Response:
        if self._sessions.use_link(link):
            return self._entered(request, self._people.server)
        store: Store = request.app.state.store
        try:
            digest = await asyncio.to_thread(store.tokens.use_link, link)
            await self._people.refresh()  # the token may have been made a moment ago
        except StoreError as error:
            return problem_response(Problem(503, str(error), "urn:forewarn:store"))
        if digest is not None and (admission := self._people.of_digest(digest)):
            return self._entered(request, admission)
        return _asking("That link was used, or is too old: enter the token.", 401)

    def _entered(self, request: Request, admission: Admission) -> Response:
        """Begin a session; its cookies end with the browser."""
        response, secure = RedirectResponse("/", 303), request.url.scheme == "https"
        key = self._sessions.begin(admission)
        response.set_cookie(COOKIE, key, httponly=True, samesite="strict", secure=secure)
        response.set_cookie(COOKIE_OF_PAGE, "1", samesite="strict", secure=secure)
        self._audit.note(request, admission.person, response.status_code)
        return response

    def _log_out(self, request: Request) -> Response:
        """End the session and ask for the token again."""
        if request.method != "POST":
            return problem_response(Problem(405, "POST to log out"), {"Allow": "POST"})
        response = RedirectResponse("/login", 303)
        if admission := self._sessions.end(request.cookies.get(COOKIE, "")):
            self._audit.note(request, admission.person, response.status_code)
        for cookie in (COOKIE, COOKIE_OF_PAGE):
            response.delete_cookie(cookie)
        return response


def _asking(message: str = "", status: int = 200) -> Response:
    """The page that asks for the token."""
    return HTMLResponse(LOGIN_PAGE.format(message=message), status)


async def _posted_token(request: Request) -> str:
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > LARGEST_LOGIN:
            return ""
    fields = parse_qs(body.decode("utf-8", "replace"))
    return fields.get("token", [""])[0].strip()
