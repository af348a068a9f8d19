import re
import threading

import httpx2
import pytest

from app.store import store as health
from app.store.store import StoreError
from core import __version__
from tests.support.api import api, problem, served, store_of


@pytest.fixture
def client(tmp_path):
    with api(tmp_path) as client:
        yield client


def test_the_server_is_alive_and_ready(client):
    assert client.get("/healthz").json() == {"status": "ok"}
    ready = {"status": "ready", "version": __version__, "unwritten": 0, "lost": 0}
    ready |= {"damaged": [], "older": ""}
    assert client.get("/readyz").json() == ready


def test_head_answers_with_the_headers_of_get(client):
    for path in ("/healthz", "/readyz"):
        plain = {"accept-encoding": "identity"}
        whole, head = client.get(path, headers=plain), client.head(path, headers=plain)
        assert head.content == b""
        assert head.status_code == whole.status_code
        assert head.headers == whole.headers
    refused = client.head("/api/v1/flights/none/end")
    assert (refused.status_code, refused.headers["allow"]) == (405, "POST")
    assert client.post("/healthz").headers["allow"] == "GET, HEAD"
    assert 'method="HEAD",route="/healthz",status="200"' in client.get("/metrics").text


def test_the_server_sends_the_head_of_a_page_without_an_error(tmp_path, caplog):
    with served(tmp_path) as (origin, _):
        for path in ("/", "/readyz", "/style.css"):
            assert httpx2.head(f"{origin}{path}").status_code == 200
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


def test_a_server_without_its_store_is_alive_but_not_ready(client, monkeypatch):
    def broken():
        raise OSError("disk gone")

    monkeypatch.setattr(store_of(client).jobs, "all", broken)
    assert "disk gone" not in problem(client.get("/readyz"), 503)
    assert client.get("/healthz").status_code == 200


def test_a_read_only_store_is_not_ready(client, monkeypatch):
    def full():
        raise StoreError("the disk is full")

    with monkeypatch.context() as broken:
        broken.setattr(store_of(client), "touch", full)
        assert "cannot be written" in problem(client.get("/readyz"), 503)
    assert client.get("/readyz").status_code == 200


def test_a_hanging_store_is_not_ready_and_checked_once(client, monkeypatch):
    free, asked = threading.Event(), []

    def hang():
        asked.append(1)
        free.wait()

    monkeypatch.setattr(health, "ANSWER_S", 0.05)
    monkeypatch.setattr(store_of(client), "touch", hang)
    for _ in range(3):
        assert "has not answered" in problem(client.get("/readyz"), 503)
    free.set()
    assert len(asked) == 1


def test_requests_are_counted_by_route(client):
    for name in ("a", "b", "c"):
        client.get(f"/api/v1/datasets/{name}")
    client.get("/nowhere/at/all")
    text = client.get("/metrics").text
    line = re.escape('{method="GET",route="/api/v1/datasets/{dataset_id}",status="404"} 3.0')
    assert re.search(rf"^forewarn_requests_total{line}$", text, re.MULTILINE)
    assert "nowhere" not in text
    assert "forewarn_jobs_running 0.0" in text
    assert "forewarn_flights 0.0" in text
    assert "forewarn_samples_unwritten 0.0" in text
    assert "forewarn_samples_lost 0.0" in text
    assert "process_resident_memory_bytes" in text


def test_applications_count_separately(client, tmp_path):
    client.get("/healthz")
    with api(tmp_path / "other") as other:
        assert 'route="/healthz"' not in other.get("/metrics").text


def test_documentation_needs_no_internet(client):
    page = client.get("/docs").text
    files = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert len(files) == 4
    for file in files:
        assert file.startswith("/")
        assert client.get(file).status_code == 200
    assert "http" not in page
    start = client.get("/docs/start.js").text
    assert client.get(re.findall(r'url: "([^"]+)"', start)[0]).json()["openapi"]


@pytest.mark.parametrize("path", ["/nothing", "/api/v1/nothing", "/docs/assets/nothing.js"])
def test_an_unknown_path_is_a_problem(client, path):
    problem(client.get(path), 404)


def test_a_wrong_method_is_a_problem(client):
    answer = client.post("/api/v1/catalog")
    problem(answer, 405)
    assert "GET" in answer.headers["allow"]


def test_an_internal_error_shows_no_details(client, monkeypatch):
    def broken():
        raise RuntimeError("secret")

    monkeypatch.setattr(store_of(client).datasets, "all", broken)
    answer = client.get("/api/v1/datasets")
    assert "secret" not in problem(answer, 500) + answer.text
    assert answer.json()["reference"] in answer.json()["detail"]
    assert answer.headers["x-content-type-options"] == "nosniff"
