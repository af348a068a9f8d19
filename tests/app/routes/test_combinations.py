"""Combinations of monitors over REST and on the command line."""

import asyncio
import json
from typing import Any

import numpy as np
import pytest

from app.cli import main
from app.flights.flights import Flights
from app.flights.request import FlightRequest
from app.recipes.recipes import to_plain
from app.store.store import open_store
from core.monitor import Monitor, MonitorRecipe, combine, load, train
from core.monitor.file.loading import from_bytes
from core.planned_test.collection import DatasetRecipe, collect, combination_failures
from tests.support.api import finished, problem, store_of
from tests.support.flying import ScriptedClock

RECIPE = DatasetRecipe(n_unsafe=20, n_obs=20, seed=4)
ORDER = {"lead": 0.5, "n_unsafe": 30, "n_test": 40, "epsilon": 0.2, "guarantee": "average"}


@pytest.fixture(scope="module")
def members() -> list[Monitor]:
    dataset = collect(RECIPE)
    return [train(dataset, MonitorRecipe(t_early=lead)) for lead in (0.25, 0.5)]


@pytest.fixture(scope="module")
def ids(client, members):
    return [store_of(client).monitors.add(m, f"{m.lead:g} s").id for m in members]


@pytest.fixture(scope="module")
def made(client, ids):
    order = ORDER | {"monitors": ids, "name": "both"}
    job = finished(client, client.post("/api/v1/monitors/combinations", json=order))
    assert job["status"] == "done", job
    return job["result"]["monitor"]


def test_a_job_makes_a_combination_as_python_does(client, members, made):
    twin = from_bytes(client.get(f"/api/v1/monitors/{made}/file").content)
    flights, _ = combination_failures(RECIPE, 30)
    expected = combine(members, flights, lead=0.5, epsilon=0.2)
    assert twin.alphas.tolist() == expected.alphas.tolist()
    info = client.get(f"/api/v1/monitors/{made}").json()
    assert (info["name"], info["n_unsafe"], info["lead"]) == ("both", 30, 0.5)
    kinds = [info["recipe"][part]["kind"] for part in ("predictor", "score")]
    assert kinds == ["combination", "highest_risk"]
    assert client.get(f"/api/v1/monitors/{made}/evaluation").json()["n_test"] == 40
    assert "both" in client.get(f"/api/v1/monitors/{made}/certificate").text


def test_a_combination_names_its_members(client, ids, members, made):
    told = client.get(f"/api/v1/monitors/{made}/calibration").json()["members"]
    assert [(one["lead"], one["n_unsafe"]) for one in told] == [(0.25, 20), (0.5, 20)]
    assert [one["recipe"] for one in told] == [to_plain(member.recipe) for member in members]
    page = client.get(f"/api/v1/monitors/{made}/certificate").text
    assert "Member 1</dt><dd>0.25\N{NO-BREAK SPACE}s ahead" in page
    assert "Member 2" in page
    assert client.get(f"/api/v1/monitors/{ids[0]}/calibration").json()["members"] == []


def test_a_combination_is_the_alarm_authority_of_a_flight(client, ids, made):
    source = {"kind": "simulated", "seed": 3}
    order = {"monitor": made, "monitors": ids, "source": source}
    answer = client.post("/api/v1/flights", json=order | {"accept_useless": True})
    assert answer.status_code == 201, answer.text
    flown = answer.json()["monitors"]
    assert [(one["id"], one["authority"]) for one in flown] == [
        (made, True),
        (ids[0], False),
        (ids[1], False),
    ]
    told = client.post("/api/v1/flights", json=order | {"monitor": ids})
    assert "POST /api/v1/monitors/combinations" in problem(told, 422)


def test_a_flight_shows_the_combinations_risk_and_alarms(tmp_path, members):
    flights, _ = combination_failures(RECIPE, 30)
    rule = combine(members, flights, lead=0.5, epsilon=0.2)

    async def run() -> None:
        store, clock = open_store(tmp_path / "store.db"), ScriptedClock()
        asked: dict[str, Any] = {"source": {"kind": "simulated", "outcome": "unsafe", "seed": 4}}
        asked["monitor"] = store.monitors.add(rule, "both").id
        async with Flights(store, clock=clock) as flown:
            flight = await flown.start(FlightRequest.model_validate(asked))
            clock.advance(12.0)
            await flown.stop(flight.id)
            frames = await flown.records.frames(flight.id, 0, 1000)
            alarms = await flown.records.alarms(flight.id)
        t, y = (np.array([frame[key] for frame in frames]) for key in "ty")
        told = rule.assess(t, y)
        assert [frame["p_value"] for frame in frames] == told.columns()["p_value"]
        assert told.alert.any()
        assert [a.t for a in alarms if a.kind == "risk"][:1] == [told.t[told.alert.argmax()]]

    asyncio.run(run())


@pytest.mark.parametrize(
    ("change", "status", "words"),
    [
        ({"monitors": "x"}, 422, "give the ids of 2 to 16"),
        ({"monitors": ["x", "x"]}, 422, "each once"),
        ({"monitors": ["x", "y"]}, 404, "x"),
        ({"lead": 0.75}, 422, "choose a member's lead"),
        ({"lead": -1}, 422, "the lead must be positive"),
        ({"epsilon": 0.001}, 422, "unsafe rollouts"),
        ({"t_early": 1}, 422, "has no 't_early'"),
        ({"n_test": -1}, 422, "n_test"),
    ],
)
def test_an_invalid_request_is_refused_at_once(client, ids, change, status, words):
    order = ORDER | {"monitors": ids} | change
    assert words in problem(client.post("/api/v1/monitors/combinations", json=order), status)


def test_a_combination_cannot_be_combined_or_trained_again(client, ids, made):
    order = ORDER | {"monitors": [made, *ids]}
    assert "is a combination" in problem(
        client.post("/api/v1/monitors/combinations", json=order), 422
    )
    recipe = {"predictor": {"kind": "combination"}, "score": {"kind": "highest_risk"}}
    trained = client.post("/api/v1/monitors", json={"dataset": {"n_unsafe": 12}} | recipe)
    assert "forewarn combine" in problem(trained, 422)


def test_the_command_combines_files(tmp_path, members, capsys):
    paths = [tmp_path / f"{number}.fwm" for number in range(2)]
    for member, path in zip(members, paths, strict=True):
        member.save(path)
    out = tmp_path / "both.fwm"
    options = ["--n-unsafe", "30", "--n-test", "40", "--guarantee", "95%", "--epsilon", "0.2"]
    assert main(["combine", *map(str, paths), *options, "-o", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    monitor = load(out)
    assert said["alert_above"] == monitor.alert_above() < 0.2
    assert said["evaluation"]["n_test"] == 40
    assert main(["combine", *map(str, paths), "--lead", "1", "-o", str(out)]) != 0
    assert "choose a member's lead" in capsys.readouterr().err
