"""Limit sets over REST: versions, and the record of putting one in force."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from core.monitor import MonitorRecipe, train
from tests.support import oscillator
from tests.support.api import api, problem, store_of

URL = "/api/v1/limit-sets"
SLOW = {"name": "slow", "ranges": {"mach": [None, 0.8]}, "limits": {"Ny": 0.5}}
FAST = {"name": "fast", "ranges": {"mach": [0.8, None]}, "limits": {"Ny": 0.4}}


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    with api(tmp_path) as client:
        yield client


def add(client: TestClient, path: str = URL, **more: Any) -> Any:
    return client.post(path, json={"cases": [SLOW, FAST]} | more)


def test_versions_of_a_set_do_not_change(client: TestClient) -> None:
    first = add(client, name="envelope", by="Ann").json()
    path = f"{URL}/{first['limit_set']}"
    second = add(client, f"{path}/versions", cases=[SLOW], text="no faster", by="Ben").json()
    assert (first["version"], second["version"]) == (1, 2)
    assert client.get(path).json()[-1] == first
    assert client.get(path).json() == [second, first]
    assert first["cases"][0]["limits"]["Ny"] == 0.5
    (listed,) = client.get(URL).json()
    assert (listed["name"], listed["newest"]) == ("envelope", 2)
    assert client.put(f"{path}/versions", json={}).status_code == 405


def test_invalid_sets_are_refused_with_the_reason(client: TestClient) -> None:
    overlapping = [SLOW, {**FAST, "ranges": {"mach": [0.7, 0.9]}}]
    assert "overlap" in problem(add(client, name="envelope", cases=overlapping), 422)
    nothing = [{**SLOW, "limits": {}}]
    assert "no limit was given" in problem(add(client, name="envelope", cases=nothing), 422)
    never = [{**SLOW, "limits": {"Ny": 30.0}}]
    assert "the limit Ny 30 g" in problem(add(client, name="envelope", cases=never), 422)
    assert client.get(URL).json() == []


def test_the_person_and_version_in_force_are_stored(client: TestClient) -> None:
    set_id = add(client, name="envelope").json()["limit_set"]
    dataset = oscillator.collect(np.random.default_rng(11), n_unsafe=12)
    monitor = store_of(client).monitors.add(train(dataset, MonitorRecipe()), "oscillator").id
    asked = {"source": {"kind": "live", "trim": "none"}, "monitor": monitor}
    unnamed = client.post("/api/v1/flights", json=asked | {"condition": {"mach": 0.6}})
    assert "limit_set" in problem(unnamed, 422)
    flight = client.post("/api/v1/flights", json=asked).json()
    assert flight["limits"] is None
    path = f"/api/v1/flights/{flight['id']}/limits"
    put = client.put(path, json={"limit_set": set_id, "fixed": {"mach": 0.9}, "by": "Ben"})
    assert put.status_code == 200, put.text
    assert (put.json()["case"], put.json()["limits"]["Ny"]) == ("fast", 0.4)
    client.put(path, json={"limit_set": set_id, "version": 1, "by": "Cy"})
    client.post(f"/api/v1/flights/{flight['id']}/end")
    kept = [(one["number"], one["by"], one["fixed"]) for one in client.get(path).json()]
    assert kept == [(1, "Ben", {"mach": 0.9}), (2, "Cy", {"mach": 0.9})]
    problem(client.put(path, json={"limit_set": set_id}), 404)
    problem(client.get("/api/v1/flights/nothing/limits"), 404)
