"""Every route with every role: a new route fails here until the table has it."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from fastapi.routing import iter_route_contexts
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from app.access.guard import REFUSED
from app.access.roles import ALLOWED, CHANGES_NOTHING, WEBSOCKET, allowed_to, rule_of
from app.main import create_app
from app.settings import Settings
from app.store.people import ROLES, Role
from tests.support.api import api, document, problem, store_of

NAMED = {"viewer": "Vi", "operator": "Op", "engineer": "Eng", "admin": "Ada"}


def routes() -> list[tuple[str, str]]:
    """Method and path of every served route, with ids filled in; OpenAPI lacks some of them."""
    app = create_app(Settings(data_dir=Path("unused")))
    described = {
        (method.upper(), path) for path, item in document()["paths"].items() for method in item
    }
    served = {
        (method, context.path or "")
        for context in iter_route_contexts(app.routes)
        for method in set(context.methods or (WEBSOCKET,)) - {"HEAD"}
    } - {(WEBSOCKET, "/docs/assets")}  # a folder of files
    assert described <= served
    return sorted((method, re.sub(r"{[^}]*}", "nothing", path)) for method, path in served)


ROUTES = routes()
PAGE = (
    "/",
    "/index.html",
    "/icon.svg",
    "/style.css",
    "/js/main.js",
    "/js/lib/api.js",
    "/docs/assets/swagger-ui.css",
)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with api(tmp_path_factory.mktemp("data"), token="t" * 16, max_jobs=0) as client:
        yield client


@pytest.fixture(scope="module")
def bearers(client: TestClient) -> dict[str, dict[str, str]]:
    """Headers of one person per role."""
    made = {role: store_of(client).tokens.add(NAMED[role], role)[1] for role in ROLES}
    client.portal.call(client.app.state.people.refresh)  # pyright: ignore
    return {role: {"Authorization": f"Bearer {token}"} for role, token in made.items()}


def refusal(
    client: TestClient, method: str, path: str, headers: dict[str, str]
) -> dict[str, Any] | None:
    """The problem document of a refused role, or None."""
    if method == WEBSOCKET:
        try:
            with client.websocket_connect(path, headers=headers | {"host": "127.0.0.1"}):
                return None
        except WebSocketDisconnect as error:
            return {"detail": error.reason} if error.code == REFUSED else None
    with client.stream(method, path, headers=headers, content="[]") as answer:  # some never end
        if answer.status_code != 403:
            return None
        answer.read()
    problem(answer, 403)
    assert answer.json()["type"] == "urn:forewarn:role"
    return answer.json()


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize(("method", "path"), ROUTES)
def test_a_route_is_refused_below_the_role_of_its_rule(
    client: TestClient, bearers: Any, role: Role, method: str, path: str
) -> None:
    rule = rule_of(method, path)
    assert rule.route, f"{method} {path} has no rule: add it to app/access/roles.py"
    refused = refusal(client, method, path, bearers[role])
    if ROLES.index(role) >= ROLES.index(rule.role):
        assert refused is None
    else:
        assert refused is not None
        for fact in (f"{method} {path}", rule.role, NAMED[role], role):
            assert fact in refused["detail"]


def test_a_route_without_a_rule_is_for_admins(client: TestClient, bearers: Any) -> None:
    for method, path in (("GET", "/api/v1/secrets"), ("PATCH", "/api/v1/flights"), ("PUT", "/")):
        for role in ("viewer", "operator", "engineer"):
            assert refusal(client, method, path, bearers[role])
        assert refusal(client, method, path, bearers["admin"]) is None


@pytest.mark.parametrize("path", PAGE)
def test_every_role_may_load_the_page(client: TestClient, bearers: Any, path: str) -> None:
    assert client.get(path, headers=bearers["viewer"]).status_code == 200


def test_viewers_only_read_and_operators_delete_nothing() -> None:
    reads = {route for route in ALLOWED["viewer"] if route.startswith(("GET ", f"{WEBSOCKET} "))}
    assert set(ALLOWED["viewer"]) - reads < set(CHANGES_NOTHING)
    assert not any("uplink" in route for route in ALLOWED["viewer"])
    deleting = [route for role in ("viewer", "operator") for route in allowed_to(role)]
    assert not any(route.startswith("DELETE") for route in deleting)
    for_others = {route for role in ROLES[:-1] for route in allowed_to(role)}
    assert not any("/tokens" in route or "/audit" in route for route in for_others)


@pytest.mark.parametrize(
    ("method", "path"),
    [("POST", "/api/v1/flights/f1/samples"), (WEBSOCKET, "/api/v1/flights/f1/uplink")],
)
def test_operators_may_push_samples(method: str, path: str) -> None:
    assert rule_of(method, path).role == "operator"


def test_every_role_of_the_store_has_its_rules() -> None:
    assert tuple(ALLOWED) == ROLES == get_args(Role)
