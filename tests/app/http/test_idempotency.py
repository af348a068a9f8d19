"""Requests that come twice are carried out once."""

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


def order(client: TestClient, key: str = "k1", **body: Any) -> Any:
    return client.post(DATASETS, json=BODY | body, headers={"Idempotency-Key": key})


def test_the_same_request_gets_the_same_answer_and_is_carried_out_once(client: TestClient) -> None:
    first, again = order(client), order(client, '"k1"')
    assert (first.status_code, again.status_code) == (202, 202)
    assert again.content == first.content
    assert again.headers["location"] == first.headers["location"]
    assert again.headers["content-type"] == first.headers["content-type"]
    assert "idempotent-replayed" not in first.headers
    assert again.headers["idempotent-replayed"] == "true"
    assert again.headers["x-content-type-options"] == "nosniff"
    assert len(store_of(client).jobs.all()) == 1
    assert order(client, "k2").headers["location"] != first.headers["location"]


def test_the_same_key_with_another_request_is_refused(client: TestClient) -> None:
    order(client)
    assert "another request" in problem(order(client, seed=2), 422)
    assert len(store_of(client).jobs.all()) == 1


def test_a_request_that_was_refused_may_come_again(client: TestClient) -> None:
    problem(order(client, n_unsafe=-1), 422)
    assert order(client).status_code == 202


def test_a_key_is_forgotten_after_its_time(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    order(client)
    monkeypatch.setattr(answers, "KEEP_FOR", timedelta(0))
    assert order(client, seed=2).status_code == 202


def test_a_request_that_the_servers_end_cut_off_is_not_done_twice(client: TestClient) -> None:
    store_of(client).answers.start(DATASETS, "local k1", "")
    assert "the server ended" in problem(order(client), 409)
    assert store_of(client).jobs.all() == []


@pytest.mark.parametrize("key", ["", "a b", "x" * 201])
def test_what_is_no_key_is_refused(client: TestClient, key: str) -> None:
    assert "1 to 200" in problem(order(client, key), 422)


def test_a_request_that_comes_while_the_first_is_carried_out_is_told_to_wait(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, began, go_on = store_of(client), threading.Event(), threading.Event()
    add = store.jobs.add

    def slowly(*what: Any) -> str:
        began.set()
        go_on.wait()
        return add(*what)

    monkeypatch.setattr(store.jobs, "add", slowly)
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(order, client)
        assert began.wait(30)
        assert "being carried out" in problem(order(client), 409)
        go_on.set()
        assert first.result().status_code == 202
    assert len(store.jobs.all()) == 1


def test_uploads_scorings_markers_and_monitors_are_made_once(
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
        first, again = (client.post(url, **request) for _ in range(2))
        assert first.status_code == again.status_code == 201, first.text
        assert first.json() == again.json()
    assert len(store_of(client).monitors.all()) == 1
    assert len(store_of(client).recordings.all()) == 2
    (marker,) = client.get(f"{path}/markers").json()
    (scoring,) = client.get(f"{path}/scorings").json()
    for made in (f"markers/{marker['id']}", f"scorings/{scoring['id']}"):
        assert client.delete(f"{path}/{made}").status_code == 204
        url = f"{path}/{made.partition('/')[0]}"
        assert "was deleted since" in problem(client.post(url, **posts[url]), 410)


def test_what_was_deleted_since_is_said_to_be_gone_and_not_made_again(
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
    assert "was deleted since" in problem(start(), 410)
    assert client.get(FLIGHTS).json() == []


def test_a_store_that_takes_nothing_is_said_before_anything_is_done(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*what: Any) -> None:
        raise StoreError("the disk is full")

    with monkeypatch.context() as broken:
        broken.setattr(store_of(client).answers, "start", full)
        assert "the disk is full" in problem(order(client), 503)
    assert store_of(client).jobs.all() == []
    with monkeypatch.context() as broken:
        broken.setattr(store_of(client).answers, "finish", full)
        assert order(client).status_code == 202
    assert "see whether it was" in problem(order(client), 409)
    assert len(store_of(client).jobs.all()) == 1


def test_an_answer_is_kept_over_a_restart(tmp_path: Path) -> None:
    with api(tmp_path, max_jobs=0) as client:
        first = order(client)
    with api(tmp_path, max_jobs=0) as client:
        assert order(client).content == first.content
        assert isinstance(store_of(client).answers.find(DATASETS, "local k1"), Answer)


def test_the_document_says_where_a_key_is_honoured(client: TestClient) -> None:
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
