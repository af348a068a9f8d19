import asyncio
import socket
from typing import Any

import pytest
from starlette.websockets import WebSocketDisconnect

from app.access import login
from app.access.audit import Audit
from app.access.guard import (
    API_POLICY,
    PAGE_POLICY,
    PUBLIC_PATHS,
    REFUSED,
    SCENE_POLICY,
    SESSION_OVER,
    Guard,
)
from app.access.login import COOKIE
from app.access.people import Admission, People, Person
from app.access.sessions import Sessions
from app.settings import Settings
from tests.support.api import ADDRESS, api, problem

TOKEN = "a-token-of-a-good-length"
STREAM = "/api/v1/flights/nothing/stream"
OPEN_MCT = "http://openmct.range:8080"


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with api(tmp_path_factory.mktemp("data"), max_body_bytes=2048) as client:
        yield client


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    data = tmp_path_factory.mktemp("guarded")
    with api(data, host="0.0.0.0", token=TOKEN, allowed_hosts=("range.example",)) as client:
        yield client


@pytest.fixture(autouse=True)
def no_session_left(guarded):
    yield
    guarded.cookies.clear()


def refusal(client, path=STREAM, **headers):
    """The reason why the guard refuses a WebSocket; empty if the route answers."""
    try:
        with client.websocket_connect(path, headers={"host": "127.0.0.1:8000"} | headers):
            return ""
    except WebSocketDisconnect as error:
        return error.reason if error.code == REFUSED else ""


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.1:9999", "localhost:8000", "[::1]:8000"])
def test_names_of_this_machine_are_accepted(client, host):
    assert client.get("/healthz", headers={"host": host}).status_code == 200
    assert not refusal(client, host=host)


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8000",
        "127.0.0.1.evil.example",
        "192.168.1.5",
        "",
        "[",
        "evil.example@127.0.0.1",
        "127.0.0.1@evil.example",
        "evil.example:x@127.0.0.1:8000",
        "127.0.0.1/evil.example",
        "127.0.0.1?evil",
        "127.0.0.1#evil",
        "[::1]evil.example",
        "::1",
        "127.0.0.1:8000:8000",
        "127.0.0.1:port",
        "127.0.0.1\\evil.example",
        "127.0.0.1 evil",
    ],
)
def test_a_rebound_name_is_refused(client, host):
    problem(client.get("/healthz", headers={"host": host}), 400)
    assert "host" in refusal(client, host=host)


def test_two_hosts_are_refused(client):
    headers = [("host", "127.0.0.1"), ("host", "evil.example")]
    problem(client.get("/healthz", headers=headers), 400)


def test_a_shared_server_accepts_its_addresses_and_allowed_names(guarded):
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    for host in ("192.168.1.5:8000", "Range.example", "[fe80::1]:8000", socket.gethostname()):
        assert guarded.get("/readyz", headers=bearer | {"host": host}).status_code == 200
    problem(guarded.get("/readyz", headers=bearer | {"host": "evil.example"}), 400)


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "http://127.0.0.1:8001", "http://localhost:8000", "file://"],
)
def test_another_sites_page_is_refused(client, origin):
    for method in ("GET", "POST", "DELETE"):
        answer = client.request(method, "/api/v1/datasets", headers={"origin": origin})
        assert "another site" in problem(answer, 403)
    assert "another site" in refusal(client, origin=origin)


def test_the_servers_own_page_is_accepted(client):
    assert client.get("/healthz", headers={"origin": ADDRESS}).status_code == 200
    assert not refusal(client, origin=ADDRESS)


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A server with a token that lets the pages of one other origin read."""
    data = tmp_path_factory.mktemp("shared")
    with api(data, token=TOKEN, allowed_origins=(OPEN_MCT,)) as client:
        yield client


def test_a_page_of_an_allowed_origin_reads_with_a_token(shared):
    asked = {"origin": OPEN_MCT, "access-control-request-method": "GET"}
    preflight = shared.options("/api/v1/flights", headers=asked)
    assert preflight.status_code == 204
    assert preflight.headers["access-control-allow-headers"] == "Authorization"
    bearer = {"origin": OPEN_MCT, "authorization": f"Bearer {TOKEN}"}
    answers = [preflight, shared.get("/api/v1/flights", headers=bearer)]
    answers.append(shared.get("/openmct/forewarn.js", headers={"origin": OPEN_MCT}))
    assert [answer.status_code for answer in answers[1:]] == [200, 200]
    assert answers[2].headers["content-type"].startswith("text/javascript")
    for answer in answers:
        assert answer.headers["access-control-allow-origin"] == OPEN_MCT
        assert "Origin" in answer.headers["vary"]
        assert "access-control-allow-credentials" not in answer.headers
    assert not refusal(shared, f"{STREAM}?token={TOKEN}", origin=OPEN_MCT)


def test_a_page_of_an_allowed_origin_does_not_read_without_a_token(shared):
    logged_in(shared)
    cookie = {"cookie": f"{COOKIE}={shared.cookies[COOKIE]}"}
    assert shared.get("/api/v1/flights", headers=cookie).status_code == 200
    problem(shared.get("/api/v1/flights", headers=cookie | {"origin": OPEN_MCT}), 401)
    assert "token" in refusal(shared, origin=OPEN_MCT, **cookie)
    shared.cookies.clear()


def test_a_page_of_an_allowed_origin_changes_nothing_whatever_its_token(shared):
    bearer = {"origin": OPEN_MCT, "authorization": f"Bearer {TOKEN}"}
    for path in ("/api/v1/flights", "/api/v1/tokens", "/login", "/logout"):
        assert "viewer" in problem(shared.post(path, headers=bearer), 403)
    assert "viewer" in refusal(
        shared, f"/api/v1/flights/nothing/uplink?token={TOKEN}", origin=OPEN_MCT
    )


@pytest.mark.parametrize("origin", [f"{OPEN_MCT}0", "http://openmct.range", "null", "*"])
def test_only_the_allowed_origin_is_allowed(shared, origin):
    bearer = {"origin": origin, "authorization": f"Bearer {TOKEN}"}
    for method in ("GET", "OPTIONS"):
        answer = shared.request(method, "/api/v1/flights", headers=bearer)
        assert "another site" in problem(answer, 403)
        assert "access-control-allow-origin" not in answer.headers
    assert "another site" in refusal(shared, f"{STREAM}?token={TOKEN}", origin=origin)


def test_a_cross_site_form_without_origin_is_refused(client):
    for site in ("cross-site", "same-site"):
        headers = {"sec-fetch-site": site}
        problem(client.post("/api/v1/datasets", headers=headers), 403)
        assert client.get("/healthz", headers=headers).status_code == 200
        assert "another site" in refusal(client, **headers)


def test_everything_but_the_public_paths_needs_the_token(guarded):
    for path in ("/", "/api/v1/catalog", "/openapi.json", "/docs", "/metrics", "/readyz"):
        answer = guarded.get(path)
        problem(answer, 401)
        assert answer.headers["www-authenticate"] == "Bearer"
    for path in PUBLIC_PATHS:
        assert guarded.get(path).status_code == 200
    assert "token" in refusal(guarded)
    assert "token" in refusal(guarded, path="/scene/nothing")


@pytest.mark.parametrize("given", ["", TOKEN[:-1], TOKEN + "x", TOKEN.upper(), "Ωmega"])
def test_a_wrong_token_is_refused(guarded, given):
    header = {"Authorization": f"Bearer {given}".encode()}
    problem(guarded.get("/readyz", headers=header), 401)
    assert "token" in refusal(guarded, path=f"{STREAM}?token={given}")
    assert guarded.post("/login", data={"token": given}, follow_redirects=False).status_code == 401
    assert COOKIE not in guarded.cookies


def test_the_token_is_accepted_in_a_header(guarded):
    headers = {"Authorization": f"Bearer {TOKEN}"}
    assert guarded.get("/readyz", headers=headers).status_code == 200
    assert not refusal(guarded, **headers)


def test_the_token_is_accepted_in_the_query_of_a_websocket_only(guarded):
    assert not refusal(guarded, path=f"{STREAM}?token={TOKEN}")
    problem(guarded.get(f"/readyz?token={TOKEN}"), 401)


def logged_in(guarded):
    """Log in and return the answer; the client keeps its cookies."""
    answer = guarded.post("/login", data={"token": TOKEN}, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    return answer


def test_a_login_sets_a_cookie_that_does_not_hold_the_token(guarded):
    cookie, of_page = logged_in(guarded).headers.get_list("set-cookie")
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert TOKEN not in cookie + of_page
    assert "HttpOnly" not in of_page
    assert guarded.get("/readyz").status_code == 200
    assert not refusal(guarded, cookie=cookie.partition(";")[0])
    of_page = of_page.partition(";")[0]
    assert "token" in refusal(guarded, cookie=of_page)


def test_a_token_in_a_login_link_is_refused(guarded):
    answer = guarded.get("/login", params={"token": TOKEN}, follow_redirects=False)
    assert answer.status_code == 400
    assert 'type="password"' in answer.text
    assert not answer.headers.get_list("set-cookie")


def test_a_link_logs_in_once(guarded):
    tokens = guarded.app.state.store.tokens
    link = f"/login?link={tokens.make_link(tokens.add('Ann', 'admin')[0].id)}"
    assert guarded.head(link).status_code == 200  # a preview of the link does not use it
    assert guarded.get(link, follow_redirects=False).status_code == 303
    assert guarded.get("/readyz").status_code == 200
    guarded.cookies.clear()
    for used in (link, "/login?link=", "/login?link=another"):
        assert "has expired" in guarded.get(used).text
        assert COOKIE not in guarded.cookies


def test_a_logout_ends_every_copy_of_the_cookie(guarded):
    logged_in(guarded)
    copy = {"cookie": f"{COOKIE}={guarded.cookies[COOKIE]}"}
    problem(guarded.get("/logout"), 405)
    answer = guarded.post("/logout", follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/login")
    assert not guarded.cookies
    problem(guarded.get("/readyz", headers=copy), 401)
    assert "token" in refusal(guarded, **copy)


async def watched(sessions: Sessions, ends: str) -> list[dict[str, Any]]:
    """Messages to a browser, and the end of the route, of a WebSocket whose session ends."""
    admission, messages = Admission(Person("Ann", "viewer")), []
    key = sessions.start(admission)
    to_route: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
    to_route.put_nowait({"type": "websocket.connect"})

    async def route(scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        to_route.put_nowait({"type": "websocket.receive", "text": "credit"})
        assert (await receive())["text"] == "credit"
        if ends == "by logging out":
            sessions.end(key)
        if ends == "with its token":
            admission.is_revoked = True
        try:
            await receive()
        except asyncio.CancelledError:
            messages.append({"type": "cancelled"})
            raise

    async def send(message: Any) -> None:
        messages.append(message)

    headers = [(b"host", b"127.0.0.1"), (b"cookie", f"{COOKIE}={key}".encode())]
    scope = {"type": "websocket", "path": STREAM, "headers": headers, "query_string": b""}
    guard = Guard(route, Settings(token=TOKEN), People(TOKEN), sessions, Audit())
    await guard(scope, to_route.get, send)
    return messages


@pytest.mark.parametrize("ends", ["by logging out", "by its time", "with its token"])
def test_a_websocket_ends_with_its_session(ends: str) -> None:
    sessions = Sessions(0.05 if ends == "by its time" else 60.0)
    watching = asyncio.wait_for(watched(sessions, ends), 30)
    accepted, at_route, closed = asyncio.run(watching)
    assert accepted["type"] == "websocket.accept"
    assert (closed["type"], closed["code"]) == ("websocket.close", SESSION_OVER)
    assert at_route["type"] == "cancelled"


@pytest.mark.parametrize("by_token", [True, False], ids=["with its token", "by itself"])
def test_a_stream_of_events_ends_with_its_token(by_token: bool) -> None:
    admission, messages = Admission(Person("Ann", "viewer")), []
    sessions = Sessions(60.0)
    key = sessions.start(admission)
    before = {"type": "http.response.start", "status": 200, "headers": []}
    event = {"type": "http.response.body", "body": b"data: 1", "more_body": True}
    last = {"type": "http.response.body", "body": b""}

    async def route(scope: Any, receive: Any, send: Any) -> None:
        await send(before)
        await send(event)
        if by_token:
            admission.is_revoked = True
            await asyncio.Event().wait()
        await send(last)

    async def send(message: Any) -> None:
        messages.append(message)

    headers = [(b"host", b"127.0.0.1"), (b"cookie", f"{COOKIE}={key}".encode())]
    scope = {"type": "http", "method": "GET", "path": "/api/v1/jobs/j/events"}
    scope |= {"headers": headers, "query_string": b""}
    guard = Guard(route, Settings(token=TOKEN), People(TOKEN), sessions, Audit())
    asyncio.run(asyncio.wait_for(guard(scope, asyncio.Event().wait, send), 30))  # pyright: ignore
    assert messages == [before, event, last]


def test_another_site_cannot_log_a_person_out(guarded):
    logged_in(guarded)
    problem(guarded.post("/logout", headers={"sec-fetch-site": "cross-site"}), 403)
    assert guarded.get("/readyz").status_code == 200


def test_a_forged_cookie_is_refused(guarded):
    for forged in (TOKEN, "x" * 43, "", "é"):
        header = {"cookie": f"{COOKIE}={forged}".encode()}
        problem(guarded.get("/readyz", headers=header), 401)


def test_wrong_tokens_share_one_log_line_that_never_holds_them(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(login, "LOGGED_EVERY_S", 3600.0)
    with api(tmp_path, host="0.0.0.0", token=TOKEN) as client:
        for number in range(20):
            wrong = {"Authorization": f"Bearer guess {number}"}
            problem(client.get("/readyz", headers=wrong), 401)
        answer = client.post("/login", data={"token": "guess"}, follow_redirects=False)
        assert answer.status_code == 401
        assert "token" in refusal(client, path=f"{STREAM}?token=guess")
        right = {"Authorization": f"Bearer {TOKEN}"}
        assert client.get("/readyz", headers=right).status_code == 200
    (line,) = (text for record in caplog.records if "token" in (text := record.getMessage()))
    assert "testclient" in line
    assert "guess" not in line


def test_a_browser_without_the_token_gets_the_login_page(guarded):
    answer = guarded.get("/", headers={"accept": "text/html"}, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/login")
    page = guarded.get("/login")
    assert page.status_code == 200
    assert 'type="password"' in page.text
    assert TOKEN not in page.text


def test_a_large_login_is_refused(guarded):
    answer = guarded.post("/login", data={"token": TOKEN + "x" * 10_000}, follow_redirects=False)
    assert answer.status_code == 401


def test_a_body_is_limited_with_and_without_a_declared_length(client):
    kind = {"content-type": "application/json"}

    def endless():
        for _ in range(1000):
            yield b" " * 1024

    for body in (b" " * 2049, endless()):
        answer = client.post("/api/v1/datasets", content=body, headers=kind)
        assert "2048 bytes" in problem(answer, 413)
    assert client.post("/api/v1/datasets", content=b" " * 2048, headers=kind).status_code == 422


@pytest.mark.parametrize("path", ["/api/v1/recordings/none", "/api/v1/no-such-path"])
def test_a_body_too_large_is_refused_before_any_route_runs(client, path):
    answer = client.request("DELETE", path, content=b" " * 2049)
    assert "2048 bytes" in problem(answer, 413)


@pytest.mark.parametrize(
    ("path", "policy"),
    [
        ("/healthz", PAGE_POLICY),
        ("/api/v1/catalog", API_POLICY),
        ("/api/v1/no", API_POLICY),
        ("/scene/none/", SCENE_POLICY),
    ],
)
def test_every_answer_has_its_policy_and_headers(client, path, policy):
    headers = client.get(path).headers
    assert headers["content-security-policy"] == policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "same-origin"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert "server" not in headers


def test_refusals_have_the_headers_too(guarded):
    answer = guarded.get("/api/v1/catalog")
    assert answer.status_code == 401
    assert answer.headers["content-security-policy"] == API_POLICY
    assert answer.headers["cache-control"] == "no-store"


def test_no_policy_allows_outside_content():
    for policy in (PAGE_POLICY, API_POLICY, SCENE_POLICY):
        assert policy.startswith("default-src 'none'")
        assert "http" not in policy
        assert "*" not in policy
        assert "unsafe-eval" not in policy
    scripts = next(part for part in PAGE_POLICY.split("; ") if part.startswith("script-src"))
    assert scripts == "script-src 'self'"
