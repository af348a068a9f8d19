"""Several people on one server: roles, names and the audit log."""

import csv
import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.requests import HTTPConnection
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from app.access import audit as audit_module
from app.access.audit import Audit
from app.access.guard import SESSION_OVER
from app.access.people import Person
from app.cli import main
from app.store.people import Role
from app.store.store import StoreError
from core import __version__
from core.monitor import MonitorRecipe, train
from tests.support.api import api, problem, store_of
from tests.support.stored import alarm

TOKEN = "a-token-of-a-good-length"
TOKENS, ME, AUDIT = "/api/v1/tokens", "/api/v1/me", "/api/v1/audit"
FLIGHTS = "/api/v1/flights"
Headers = dict[str, str]


def bearer(token: str) -> Headers:
    return {"Authorization": f"Bearer {token}"}


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    with api(tmp_path, token=TOKEN, max_jobs=0) as client:
        yield client


def hired(client: TestClient, name: str, role: Role) -> tuple[str, Headers]:
    """A person's token: its id, and the header."""
    answer = client.post(TOKENS, headers=bearer(TOKEN), json={"name": name, "role": role})
    assert answer.status_code == 201, answer.text
    return answer.json()["id"], bearer(answer.json()["token"])


def logged(client: TestClient, **query: str) -> list[dict[str, Any]]:
    """The audit log, which holds all that was answered."""
    lines = client.get(AUDIT, headers=bearer(TOKEN), params=query).text.splitlines()
    return [json.loads(line) for line in lines]


def flight_with_alarms(client: TestClient, dataset: Any, n: int) -> str:
    store = store_of(client)
    monitor = store.monitors.add(train(dataset, MonitorRecipe(epsilon=0.2)), "m").id
    flight = store.flights.add({"kind": "simulated"}, monitor, 0.2)
    for k in range(n):
        store.alarms.add(flight, alarm(k + 1, k, 0.1 * k))
    store.flights.end(flight)
    return f"{FLIGHTS}/{flight}"


def test_requests_are_local_and_admin_if_no_token_is_required(tmp_path: Path) -> None:
    with api(tmp_path) as client:
        me = client.get(ME).json()
        assert (me["name"], me["role"], me["version"]) == ("local", "admin", __version__)
        assert "POST /api/v1/tokens" in me["allowed"]
        refused = client.post(TOKENS, json={"name": "Ann", "role": "viewer"})
        assert "forewarn token create" in problem(refused, 409)
        assert client.get(TOKENS).json() == []


def test_a_person_has_name_and_role_until_the_token_is_revoked(client: TestClient) -> None:
    token_id, ann = hired(client, "Ann", "operator")
    me = client.get(ME, headers=ann).json()
    assert (me["name"], me["role"]) == ("Ann", "operator")
    assert "POST /api/v1/flights/{}/transport" in me["allowed"]
    assert "DELETE /api/v1/flights/{}" not in me["allowed"]
    client.post("/login", data={"token": ann["Authorization"].partition(" ")[2]})
    assert client.get(ME).json()["name"] == "Ann"
    (listed,) = client.get(TOKENS, headers=bearer(TOKEN)).json()
    assert listed.keys() == {"id", "name", "role", "created", "expires", "revoked", "last_used"}
    assert listed["last_used"] is not None
    revoked = client.delete(f"{TOKENS}/{token_id}", headers=bearer(TOKEN)).json()
    assert revoked["revoked"] is not None
    problem(client.get(ME, headers=ann), 401)
    problem(client.get(ME), 401)
    problem(client.post(f"{TOKENS}/{token_id}/link", headers=bearer(TOKEN)), 409)


def test_a_websocket_closes_when_its_token_is_revoked(client: TestClient) -> None:
    token_id, ann = hired(client, "Ann", "viewer")
    flights: Any = client.app.state.flights  # pyright: ignore

    class Silent:
        """A flight that says nothing."""

        def watch(self, *screen: str) -> "Silent":
            return self

        def leave(self, watcher: Any) -> None:
            pass

        ended = is_done = False

        def next_message(self) -> None:
            pass

        newest_message = next_message

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flights, "get", lambda _: Silent())
        headers = ann | {"host": "127.0.0.1:8000"}
        with client.websocket_connect(f"{FLIGHTS}/f1/stream", headers=headers) as socket:
            client.delete(f"{TOKENS}/{token_id}", headers=bearer(TOKEN))
            with pytest.raises(WebSocketDisconnect) as closed:
                socket.receive_text()
    assert closed.value.code == SESSION_OVER


def test_a_link_logs_its_person_in_once(client: TestClient) -> None:
    token_id, _ = hired(client, "Ann", "viewer")
    link = client.post(f"{TOKENS}/{token_id}/link", headers=bearer(TOKEN)).json()["path"]
    assert client.get(link, follow_redirects=False).status_code == 303
    assert client.get(ME).json()["name"] == "Ann"
    client.cookies.clear()
    assert "has expired" in client.get(link).text


def test_an_acknowledgement_has_the_name_of_the_person_logged_in(
    client: TestClient, dataset: Any
) -> None:
    flight = flight_with_alarms(client, dataset, 2)
    _, ann = hired(client, "Ann", "operator")
    told = client.post(f"{flight}/alarms/1/acknowledge", headers=ann, json={"by": "Bo"})
    assert told.json()["by"] == "Ann"
    _, bo = hired(client, "Bo", "viewer")
    refused = client.post(f"{flight}/alarms/2/acknowledge", headers=bo)
    assert "needs the role operator; Bo has the role viewer" in problem(refused, 403)
    assert [alarm["by"] for alarm in client.get(f"{flight}/alarms", headers=bo).json()] == [
        "Ann",
        None,
    ]


def test_an_idempotency_key_belongs_to_its_sender(client: TestClient) -> None:
    made: list[str] = []
    for name in ("Ann", "Bo"):
        headers = hired(client, name, "engineer")[1] | {"Idempotency-Key": "k1"}
        for _ in range(2):
            made.append(client.post("/api/v1/datasets", headers=headers, json={}).json()["id"])
    assert made[0] == made[1] != made[2] == made[3]


def test_the_audit_log_has_changes_logins_and_refusals_of_roles(client: TestClient) -> None:
    _, ann = hired(client, "Ann", "viewer")
    client.get("/api/v1/flights", headers=ann)
    client.post(FLIGHTS, headers=ann, json={})
    client.post(FLIGHTS, headers=bearer(TOKEN), json={})  # refused: not a request at all
    client.post("/login", data={"token": ann["Authorization"].partition(" ")[2]})
    client.post("/logout")
    entries = logged(client)
    assert [(e["who"], e["role"], e["method"], e["path"], e["status"]) for e in entries] == [
        ("server", "admin", "POST", TOKENS, 201),
        ("Ann", "viewer", "POST", FLIGHTS, 403),
        ("Ann", "viewer", "POST", "/login", 303),
        ("Ann", "viewer", "POST", "/logout", 303),
    ]
    assert {e["address"] for e in entries} == {"testclient"}
    assert sorted(e["time"] for e in entries) == [e["time"] for e in entries]
    assert len(logged(client, who="Ann")) == 3
    assert logged(client, who="Ann", since=entries[2]["time"], until=entries[3]["time"]) == [
        entries[2]
    ]
    table = client.get(AUDIT, headers=bearer(TOKEN), params={"format": "csv"}).text
    rows = list(csv.DictReader(io.StringIO(table)))
    assert rows == [{key: str(value) for key, value in entry.items()} for entry in entries]
    assert "noon" in problem(
        client.get(AUDIT, headers=bearer(TOKEN), params={"since": "noon"}), 422
    )


def test_each_persons_first_push_to_a_flight_is_logged() -> None:
    audit = Audit()
    for name in ("Ann", "Ann", "Bo", "Ann"):
        for flight in ("f1", "f2"):
            scope = {"type": "http", "method": "POST", "path": f"{FLIGHTS}/{flight}/samples"}
            connection = HTTPConnection(scope | {"headers": [], "client": None})
            audit.note_answer(connection, Person(name, "operator"), 200)
    assert [(e.who, e.path[-10:-8]) for e in audit._waiting] == [
        ("Ann", "f1"),
        ("Ann", "f2"),
        ("Bo", "f1"),
        ("Bo", "f2"),
    ]


def test_entries_are_logged_once_the_store_accepts_writes(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = store_of(client)
    monkeypatch.setattr(audit_module, "STORE_EVERY_S", 0.01)

    def fail(entries: Any) -> None:
        raise StoreError("the disk is full")

    with monkeypatch.context() as full:
        full.setattr(store.audit, "add", fail)
        hired(client, "Ann", "viewer")
        hired(client, "Bo", "viewer")
        assert list(store.audit.read()) == []
    assert [entry["path"] for entry in logged(client)] == [TOKENS, TOKENS]


def test_tokens_and_log_by_the_command_line_of_a_running_server(
    client: TestClient, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*words: str) -> str:
        assert main([*words, "--data-dir", str(tmp_path)]) == 0
        return capsys.readouterr().out

    refresh: Callable[[], Any] = client.app.state.people.refresh  # pyright: ignore
    made = json.loads(said("token", "create", "Ann", "--role", "viewer", "--days", "2", "--json"))
    client.portal.call(refresh)  # pyright: ignore
    assert client.get(ME, headers=bearer(made["token"])).json()["name"] == "Ann"
    link = said("token", "link", "Ann", "--address", "http://range:1/").split()[-1]
    assert link.startswith("http://range:1/login?link=")
    path = link.removeprefix("http://range:1")
    assert client.get(path, follow_redirects=False).status_code == 303
    assert made["token"] not in said("token", "list")
    assert "revoked" in said("token", "revoke", "Ann")
    client.portal.call(refresh)  # pyright: ignore
    problem(client.get(ME, headers=bearer(made["token"])), 401)
    logged(client)
    lines = said("audit", "--json", "--who", "local").splitlines()
    assert [json.loads(line)["method"] for line in lines] == ["POST", "POST", "DELETE"]
    assert "command line of" in lines[0]
    assert said("audit").startswith("time,who,role,address,method,path,status\n")
    assert main(["token", "revoke", "Ann", "--data-dir", str(tmp_path)]) == 1
    assert "no valid token" in capsys.readouterr().err
