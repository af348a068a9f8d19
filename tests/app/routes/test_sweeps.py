"""Sweeps over leads and choices of epsilon over REST: jobs and refusals."""

import pytest

from core.evaluation.lead_sweep import METHODS, SweepRecipe, sweep
from core.monitor import train
from core.planned_test.collection import DatasetRecipe, collect
from tests.support.api import finished, problem, store_of

SMALL = {"leads_s": [0.25, 1.6], "n_unsafe": 25, "n_monitors": 1, "n_test": 60}
RIDGE = "peaks ahead: rest"


@pytest.fixture(scope="module")
def monitor(client) -> str:
    return (
        store_of(client).monitors.add(train(collect(DatasetRecipe(n_unsafe=40, seed=2))), "it").id
    )


def test_a_sweep_of_named_tests_gives_the_librarys_result(client):
    order = SMALL | {"tests": ["ATTAS"], "methods": [RIDGE]}
    job = finished(client, client.post("/api/v1/sweeps", json=order))
    assert job["status"] == "done", job
    result = client.get(f"/api/v1/jobs/{job['id']}").json()["result"]
    recipe = SweepRecipe(
        tests=("ATTAS",),
        methods=(RIDGE,),
        leads_s=(0.25, 1.6),
        n_unsafe=25,
        n_monitors=1,
        n_test=60,
    )
    expected = sweep(recipe)["ATTAS"]
    found = result["tests"]["ATTAS"]
    assert found["earliest_s"] == expected.earliest_s
    assert found["hopeless_s"] == [1.6]
    cells = {(cell["method"], cell["lead"]): cell for cell in found["cells"]}
    for (method, _), cell in expected.cells.items():
        told = cells[method, cell.lead]
        assert told["power"] == cell.power
        assert told["prevented_alike"] == cell.prevented_alike_share.tolist()
    assert "no method lets safe flights pass 1.6 s ahead" in result["table"]
    (link,) = result["figures"].values()
    assert b"<svg" in client.get(link).content
    listed = next(j for j in client.get("/api/v1/jobs").json() if j["id"] == job["id"])
    assert listed["result"] is None


def test_a_sweep_of_a_dataset_uses_its_planned_test(client):
    maneuver = {"kind": "frequency_sweep", "amplitude_deg": 11.1}
    dataset = {"n_unsafe": 12, "n_obs": 20, "maneuver": maneuver, "imperfections": "none"}
    order = SMALL | {"leads_s": [0.25], "dataset": dataset}
    job = finished(client, client.post("/api/v1/sweeps", json=order))
    assert job["status"] == "done", job
    (name,) = job["request"]["tests"]
    assert "frequency sweep" in name
    (found,) = job["result"]["tests"].values()
    assert {cell["method"] for cell in found["cells"]} == {
        name for name in METHODS if not name.startswith("test card")
    }


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tests": ["Concorde"]}, "planned test 'Concorde' was given: choose F-16"),
        ({"leads_s": []}, "give at least one time above 0 s"),
        ({"leads_s": [9.0]}, "choose shorter warning lead times"),
        ({"n_monitors": 1000}, "n_monitors is 1000: this server allows at most 100"),
        ({"speed": 1}, "sweep has no 'speed'"),
        ({"n_test": "many"}, "sweep.n_test is 'many': give a number"),
        ({"dataset": {}, "tests": ["F-16"]}, "leave them out"),
        ({"dataset": {}, "ceiling": True}, "works only without imperfections"),
        ({"dataset": 5}, "give the id of a stored dataset"),
    ],
)
def test_an_invalid_sweep_is_refused(client, change, words):
    assert words in problem(client.post("/api/v1/sweeps", json=SMALL | change), 422)


def test_an_epsilon_is_chosen_by_a_job(client, monitor):
    where = f"/api/v1/monitors/{monitor}/epsilon"
    job = finished(client, client.post(where, json={"cost_of_miss": 5, "n_test": 400}))
    assert job["status"] == "done", job
    found = job["result"]
    assert found["n_unsafe"] + found["n_safe"] == 200
    assert found["cost"] == (5 * found["misses"] + found["false_alerts"]) / 200
    assert f"epsilon {found['epsilon']:.4g}" in found["words"]
    targets = {"most_missed": 0.01, "most_false_alarms": 0.9, "n_test": 400}
    failed = finished(client, client.post(where, json=targets))
    assert failed["status"] == "failed"
    assert "out of reach: missed at most 1 %" in failed["error"]


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ({}, "Give both most_missed"),
        ({"most_missed": 2, "most_false_alarms": 0.1}, "give a share between 0 and 1"),
        ({"cost_of_miss": "dear"}, "cost_of_miss is 'dear': give a number"),
        ({"cost_of_miss": 1, "n_test": 0}, "n_test=0"),
        ({"cost": 1}, "has no 'cost': "),
    ],
)
def test_an_invalid_choice_is_refused(client, monitor, order, words):
    assert words in problem(client.post(f"/api/v1/monitors/{monitor}/epsilon", json=order), 422)


def test_a_choice_for_an_unknown_monitor_is_not_found(client):
    problem(client.post("/api/v1/monitors/none/epsilon", json={"cost_of_miss": 1}), 404)
