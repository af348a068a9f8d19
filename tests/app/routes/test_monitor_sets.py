"""Monitor sets over REST: made, refused, deleted, and flown."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from core.monitor import MonitorRecipe, train
from tests.support import oscillator
from tests.support.api import api, problem, store_of

URL, FLIGHTS = "/api/v1/monitor-sets", "/api/v1/flights"
SLOW, FAST = ({"mach": [None, 0.8]}, {"mach": [0.8, None], "altitude": [3000.0, None]})


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    with api(tmp_path) as client:
        yield client


def stored(client: TestClient, name: str, t_early: float = 0.25) -> str:
    dataset = oscillator.collect(np.random.default_rng(11), n_unsafe=12)
    return store_of(client).monitors.add(train(dataset, MonitorRecipe(t_early=t_early)), name).id


def add(client: TestClient, slow: str, fast: str, ranges: Any = FAST) -> Any:
    cases = [
        {"name": "slow", "ranges": SLOW, "monitor": slow},
        {"name": "fast", "ranges": ranges, "monitor": fast},
    ]
    return client.post(URL, json={"name": "doublet", "cases": cases, "by": "Ann", "text": "why"})


def test_a_set_is_made_read_and_deleted(client: TestClient) -> None:
    slow, fast = stored(client, "slow one"), stored(client, "fast one")
    made = add(client, slow, fast)
    assert made.status_code == 201, made.text
    made = made.json()
    assert made["id"] in problem(add(client, slow, fast), 422)
    assert [(case["monitor"], case["monitor_name"]) for case in made["cases"]] == [
        (slow, "slow one"),
        (fast, "fast one"),
    ]
    assert (made["by"], made["text"], made["cases"][1]["ranges"]) == ("Ann", "why", FAST)
    assert client.get(URL).json() == [made]
    assert client.get(f"{URL}/{made['id']}").json() == made
    used = problem(client.delete(f"/api/v1/monitors/{slow}"), 409)
    assert f"monitor set doublet ({made['id']})" in used
    assert client.delete(f"{URL}/{made['id']}").status_code == 204
    problem(client.get(f"{URL}/{made['id']}"), 404)
    problem(client.delete(f"{URL}/{made['id']}"), 404)
    assert client.delete(f"/api/v1/monitors/{slow}").status_code == 204


def test_an_invalid_set_is_refused_with_the_reason(client: TestClient) -> None:
    slow, early = stored(client, "slow one"), stored(client, "early one", 0.5)
    included = problem(add(client, slow, slow, {"mach": [0.7, 0.75]}), 422)
    assert "slow includes all of fast" in included
    assert "slow and fast differ in their lead time" in problem(add(client, slow, early), 422)
    problem(add(client, slow, "nothing"), 404)
    everywhere = {"name": "one", "cases": [{"name": "all", "monitor": slow}]}
    assert "all has no range" in problem(client.post(URL, json=everywhere), 422)
    assert client.get(URL).json() == []


def test_a_flight_shows_its_set_and_the_monitor_in_use(client: TestClient) -> None:
    slow, fast = stored(client, "slow one"), stored(client, "fast one")
    made = add(client, slow, fast).json()
    asked = {"source": {"kind": "live", "trim": "none"}, "monitor_set": made["id"]}
    started = client.post(FLIGHTS, json=asked | {"condition": {"altitude": 5000.0}})
    assert started.status_code == 201, started.text
    path = f"{FLIGHTS}/{started.json()['id']}"
    assert started.json()["monitor_set"]["reason"] == "not applicable: Mach number is missing"
    sample = dict.fromkeys(("beta", "p", "r", "Ny", "delta_a", "delta_r"), 0.0)
    assert started.json()["monitor"] is None
    flown = (0.6, "slow", slow), (0.9, "fast", fast), (None, "", None)
    for k, (mach, case, monitor) in enumerate(flown):
        samples = {key: [value] * 4 for key, value in sample.items()}
        t = [0.05 * (4 * k + i) for i in range(4)]
        body = {"sequence": k, "t": t, "mach": [mach] * 4} | samples
        assert client.post(f"{path}/samples", json=body).status_code == 200
        now = client.get(path).json()
        assert (now["monitor_set"]["case"], now["monitor"]) == (case, monitor)
        held = client.get(f"{path}/limits").json()
        assert (held[-1]["monitor"], held[-1]["t"]) == (monitor or "", t[0])
        assert held[-1]["limits"]["Ny"] == 0.5
    client.post(f"{path}/end")
    ended = client.get(path).json()
    assert ended["monitor_set"]["name"] == "doublet"
    assert ended["warnings"] == list(client.get(f"/api/v1/monitors/{slow}").json()["warnings"])
    assert ended["monitor_set"]["fixed"] == {"altitude": 5000.0}
    assert ended["monitor"] is None
    assert [each["monitor"] for each in ended["limits_held"]][-3:] == [slow, fast, ""]
    assert client.get(f"{path}/limits").json() == ended["limits_held"]
    assert "flight" in problem(client.delete(f"{URL}/{made['id']}"), 409)
