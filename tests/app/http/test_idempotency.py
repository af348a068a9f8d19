"""Repeated requests with a key are carried out once."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from app.store import answers
from app.store.answers import Answer
from app.store.store import StoreError
from core.dataset import Dataset
from core.monitor import train
from tests.support.api import api, problem, store_of
from tests.support.oscillator import Array
from tests.support.recorded import RECORDINGS, csv_of, uploaded

DATASETS, FLIGHTS = "/api/v1/datasets", "/api/v1/flights"
BODY = {"name": "a", "n_unsafe": 2, "seed": 1}


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    with api(tmp_path, max_jobs=0) as client:
        yield client


def post(client: TestClient, key: str = "k1", **body: Any) -> Any:
    return client.post(DATASETS, json=BODY | body, headers={"Idempotency-Key": key})


def test_the_same_request_gets_the_same_answer_and_is_carried_out_once(client: TestClient) -> None:
    first, repeated = post(client), post(client, '"k1"')
    assert (first.status_code, repeated.status_code) == (202, 202)
    assert repeated.content == first.content
    assert repeated.headers["location"] == first.headers["location"]
    assert repeated.headers["content-type"] == first.headers["content-type"]
    assert "idempotent-replayed" not in first.headers
    assert repeated.headers["idempotent-replayed"] == "true"
    assert repeated.headers["x-content-type-options"] == "nosniff"
    assert len(store_of(client).jobs.all()) == 1
    assert post(client, "k2").headers["location"] != first.headers["location"]


def test_the_same_key_with_another_request_is_refused(client: TestClient) -> None:
    post(client)
    assert "another request" in problem(post(client, seed=2), 422)
    assert len(store_of(client).jobs.all()) == 1


def test_a_refused_request_may_be_sent_again(client: TestClient) -> None:
    problem(post(client, n_unsafe=-1), 422)
    assert post(client).status_code == 202


def test_a_key_expires(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    post(client)
    monkeypatch.setattr(answers, "KEEP_FOR", timedelta(0))
    assert post(client, seed=2).status_code == 202


def test_a_request_cut_off_by_the_servers_end_is_not_repeated(client: TestClient) -> None:
    store_of(client).answers.start(DATASETS, "local k1")
    assert "the server stopped" in problem(post(client), 409)
    assert store_of(client).jobs.all() == []


@pytest.mark.parametrize("key", ["", "a b", "x" * 201])
def test_an_invalid_key_is_refused(client: TestClient, key: str) -> None:
    assert "1 to 200" in problem(post(client, key), 422)


def test_a_repeat_during_the_first_request_is_refused(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, started, go_on = store_of(client), threading.Event(), threading.Event()
    add = store.jobs.add

    def slowly(*arguments: Any) -> str:
        started.set()
        go_on.wait()
        return add(*arguments)

    monkeypatch.setattr(store.jobs, "add", slowly)
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(post, client)
        assert started.wait(30)
        assert "in progress" in problem(post(client), 409)
        go_on.set()
        assert first.result().status_code == 202
    assert len(store.jobs.all()) == 1


def test_uploads_scorings_markers_and_monitors_are_created_once(
    client: TestClient, dataset: Dataset, flights: Array
) -> None:
    key = {"Idempotency-Key": "once"}
    monitor = train(replace(dataset, recipe={})).to_bytes()
    binary = key | {"Content-Type": "application/octet-stream"}
    made = [client.post("/api/v1/monitors", content=monitor, headers=binary) for _ in range(2)]
    assert made[0].json() == made[1].json()
    path = f"{RECORDINGS}/{uploaded(client, csv_of(flights[0]))['id']}"
    file = csv_of(flights[1])
    posts = {
        RECORDINGS: {"content": file, "headers": binary, "params": {"name": "f.csv"}},
        f"{path}/markers": {"json": {"t": 1.0, "text": "gust"}, "headers": key},
        f"{path}/scorings": {"json": {"monitor": made[0].json()["id"]}, "headers": key},
    }
    for url, request in posts.items():
        first, repeated = (client.post(url, **request) for _ in range(2))
        assert first.status_code == repeated.status_code == 201, first.text
        assert first.json() == repeated.json()
    assert len(store_of(client).monitors.all()) == 1
    assert len(store_of(client).recordings.all()) == 2
    (marker,) = client.get(f"{path}/markers").json()
    (scoring,) = client.get(f"{path}/scorings").json()
    for made in (f"markers/{marker['id']}", f"scorings/{scoring['id']}"):
        assert client.delete(f"{path}/{made}").status_code == 204
        url = f"{path}/{made.partition('/')[0]}"
        assert "deleted" in problem(client.post(url, **posts[url]), 410)


def test_a_repeat_after_a_deletion_is_gone_and_creates_nothing(
    client: TestClient, dataset: Dataset
) -> None:
    monitor = store_of(client).monitors.add(train(dataset), "oscillator").id
    kept = store_of(client).datasets.add(dataset, "oscillator").id
    source = {"kind": "replay", "dataset": kept, "outcome": "safe", "rollout": 0}
    body = {"source": source, "monitor": monitor, "epsilon": 0.2}
    start = lambda: client.post(FLIGHTS, json=body, headers={"Idempotency-Key": "f1"})  # noqa: E731
    first = start()
    assert first.status_code == 201, first.text
    flight = f"{FLIGHTS}/{first.json()['id']}"
    client.post(f"{flight}/end")
    assert start().json() == first.json()
    assert client.delete(flight).status_code == 204
    assert "deleted" in problem(start(), 410)
    assert client.get(FLIGHTS).json() == []


def test_a_store_that_fails_refuses_the_request_before_it_runs(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: Any) -> None:
        raise StoreError("the disk is full")

    with monkeypatch.context() as broken:
        broken.setattr(store_of(client).answers, "start", full)
        assert "the disk is full" in problem(post(client), 503)
    assert store_of(client).jobs.all() == []
    with monkeypatch.context() as broken:
        broken.setattr(store_of(client).answers, "finish", full)
        assert post(client).status_code == 202
    assert "the server stopped" in problem(post(client), 409)
    assert len(store_of(client).jobs.all()) == 1


def test_a_stored_answer_survives_a_restart(tmp_path: Path) -> None:
    with api(tmp_path, max_jobs=0) as client:
        first = post(client)
    with api(tmp_path, max_jobs=0) as client:
        assert post(client).content == first.content
        assert isinstance(store_of(client).answers.find(DATASETS, "local k1"), Answer)


def test_the_document_lists_the_operations_with_keys(client: TestClient) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    honoured = {
        path
        for path, item in paths.items()
        for parameter in item.get("post", {}).get("parameters", [])
        if parameter["name"] == "Idempotency-Key"
    }
    assert {path.rpartition("/")[2] for path in honoured} == {
        "datasets",
        "monitors",
        "recordings",
        "flights",
        "studies",
        "sweeps",
        "scorings",
        "markers",
    }
