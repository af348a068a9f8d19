"""Login and logout: the page that asks for a token, one-time links, the session's cookies."""

import asyncio
import logging
import math
import time
from urllib.parse import parse_qs

from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from app.access.audit import Audit
from app.access.people import Admission, People
from app.access.sessions import Sessions
from app.http.problems import Problem, problem_response
from app.store.store import Store, StoreError

LOG = logging.getLogger("forewarn")
COOKIE = "forewarn"
PAGE_COOKIE = "forewarn-page"
"""Tells the page that a session can be ended; it gives no access."""
PATHS = ("/login", "/logout")
LARGEST_LOGIN = 4096
LOGGED_EVERY_S = 1.0

LOGIN_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Forewarn</title>
<meta name="viewport" content="width=device-width">
<style>:root{{color-scheme:light dark;font:max(16px,min(1vw,1.78vh)) system-ui;
background:light-dark(#fff,#090d12);color:light-dark(#0d141b,#f0f5fa)}}
body{{display:grid;place-content:center;min-height:90vh}}
label,button,[role=alert]{{font-weight:700}}
input,button{{font:inherit;padding:.5em .8em;border:1px solid #73879b;border-radius:.25em}}
input{{min-width:20em}}
button{{border:0;color:#fff;background:light-dark(#0a5a9c,#1f6fb2)}}
[role=alert]{{color:light-dark(#945a00,#d08c10)}}
[role=alert]:not(:empty)::before{{content:"◆ "}}</style>
<form method="post" action="/login"><h1>Forewarn</h1>
<p><label for="token">Token of this Forewarn server</label></p>
<p><input id="token" name="token" type="password" required autofocus>
<button>Enter</button></p><p role="alert">{message}</p>
<p>An admin makes a token: forewarn token create</p></form></html>"""


class Login:
    """Answers /login and /logout."""

    def __init__(self, people: People, sessions: Sessions, audit: Audit) -> None:
        self._people = people
        self._sessions = sessions
        self._audit = audit
        self._logged = -math.inf

    async def answer(self, request: Request) -> Response:
        if request.scope["path"] == "/logout":
            return self._log_out(request)
        if request.method == "POST":
            return await self._log_in_by_token(request)
        if request.method not in ("GET", "HEAD"):
            return problem_response(Problem(405, "use GET or POST"), {"Allow": "GET, POST"})
        if "token" in request.query_params:
            return _login_page("Enter the token here: links cannot carry it.", 400)
        link = request.query_params.get("link")
        if link is None or request.method == "HEAD":
            return _login_page()
        return await self._log_in_by_link(request, link)

    async def _log_in_by_token(self, request: Request) -> Response:
        token = await _posted_token(request)
        if admission := self._people.find(token):
            return self._start_session(request, admission)
        if token:
            self.log_wrong_token(request)
        return _login_page("This is not a token of this server.", 401)

    def log_wrong_token(self, connection: HTTPConnection) -> None:
        """Log the address of a wrong token, never the token; one line in LOGGED_EVERY_S."""
        now = time.monotonic()
        if now - self._logged >= LOGGED_EVERY_S:
            self._logged = now
            address = connection.client.host if connection.client else "an unknown address"
            LOG.warning("wrong token from %s", address)

    async def _log_in_by_link(self, request: Request, link: str) -> Response:
        store: Store = request.app.state.store
        try:
            digest = await asyncio.to_thread(store.tokens.use_link, link)
            await self._people.refresh()  # the token may be brand new
        except StoreError as error:
            return problem_response(Problem(503, str(error), "urn:forewarn:store"))
        if digest is not None and (admission := self._people.find_digest(digest)):
            return self._start_session(request, admission)
        return _login_page("This link has been used or has expired: enter the token.", 401)

    def _start_session(self, request: Request, admission: Admission) -> Response:
        """Start a session; its cookies end with the browser."""
        response, secure = RedirectResponse("/", 303), request.url.scheme == "https"
        key = self._sessions.start(admission)
        response.set_cookie(COOKIE, key, httponly=True, samesite="strict", secure=secure)
        response.set_cookie(PAGE_COOKIE, "1", samesite="strict", secure=secure)
        self._audit.note(request, admission.person, response.status_code)
        return response

    def _log_out(self, request: Request) -> Response:
        if request.method != "POST":
            return problem_response(Problem(405, "use POST"), {"Allow": "POST"})
        response = RedirectResponse("/login", 303)
        if admission := self._sessions.end(request.cookies.get(COOKIE, "")):
            self._audit.note(request, admission.person, response.status_code)
        for cookie in (COOKIE, PAGE_COOKIE):
            response.delete_cookie(cookie)
        return response


def _login_page(message: str = "", status: int = 200) -> Response:
    return HTMLResponse(LOGIN_PAGE.format(message=message), status)


async def _posted_token(request: Request) -> str:
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > LARGEST_LOGIN:
            return ""
    fields = parse_qs(body.decode("utf-8", "replace"))
    return fields.get("token", [""])[0].strip()
