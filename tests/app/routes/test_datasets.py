import io
import json
from dataclasses import asdict

import numpy as np
import pytest

from app.recipes.recipes import as_ordered, dataset_recipe, from_plain, to_plain
from core.channels import KEYS
from core.monitor import train
from core.planned_test.amplitude import suggest_amplitude
from core.planned_test.collection import DatasetRecipe, collect
from core.simulation.aircraft import AIRCRAFT, MatrixAircraft
from tests.support.api import api, finished, problem, store_of

LAW = {"control_law": {"kind": "attas_damper"}}
RECIPE = {"n_unsafe": 5, "n_obs": 10, "seed": 3, "maneuver": {"amplitude_deg": 10.0}}


@pytest.fixture(scope="module")
def stored(client, dataset):
    return store_of(client).datasets.add(dataset, "oscillator").id


def test_a_job_makes_a_dataset_of_a_recipe(client):
    job = finished(client, client.post("/api/v1/datasets", json=RECIPE | {"name": "small"}))
    assert job["status"] == "done"
    info = client.get(f"/api/v1/datasets/{job['result']['dataset']}").json()
    twin = collect(from_plain(DatasetRecipe(), as_ordered(RECIPE)))
    assert info["name"] == "small"
    assert info["digest"] == twin.digest()
    assert info["recipe"]["maneuver"]["amplitude_deg"] == 10.0
    assert info["n_unsafe"] == 5
    assert any(entry["id"] == info["id"] for entry in client.get("/api/v1/datasets").json())


def test_a_collection_that_cannot_end_fails_with_the_reason(client):
    recipe = {"n_unsafe": 1000, "max_rollouts": 1000, "maneuver": {"amplitude_deg": 0.01}}
    job = finished(client, client.post("/api/v1/datasets", json=recipe))
    assert job["status"] == "failed"
    assert "raise the amplitude" in job["error"]


def test_auto_uses_the_suggested_amplitude(client):
    test = {"aircraft": {"kind": "attas_id_16kft"}, "limits": {"Ny": 0.3}}
    answer = client.post("/api/v1/datasets/amplitude", json=test | {"share": 0.25})
    assert answer.status_code == 200
    suggested = answer.json()
    assert suggested == asdict(
        suggest_amplitude(from_plain(DatasetRecipe(), as_ordered(test | LAW)))
    ) | {"maneuver": suggested["maneuver"]}
    assert suggested["maneuver"]["amplitude_deg"] == suggested["amplitude_deg"]
    auto = test | {"n_unsafe": 5, "n_obs": 10, "maneuver": {"amplitude_deg": "auto"}}
    job = finished(client, client.post("/api/v1/datasets", json=auto))
    info = client.get(f"/api/v1/datasets/{job['result']['dataset']}").json()
    assert info["recipe"]["maneuver"]["amplitude_deg"] == suggested["amplitude_deg"]


@pytest.mark.parametrize(
    ("test", "words"),
    [
        ({"limits": {"Ny": 29}}, "0 % of the rollouts exceed a limit even at 45 deg"),
        ({"share": 2}, "between 0 and 1"),
        ({"share": "half"}, "share is 'half'"),
        ({"maneuver": {"kind": "loop"}}, "'loop' is unknown"),
    ],
)
def test_the_reason_is_given_if_no_amplitude_fits(client, test, words):
    assert words in problem(client.post("/api/v1/datasets/amplitude", json=test), 422)


def test_a_users_model_is_sent_in_the_format_of_its_file(client):
    spread = {"A[1,0]": 0.15, "A[2,0]": 0.1}
    model = to_plain(AIRCRAFT["matrices"]) | {"uncertainty": {"spread": spread}}
    printed = {key.upper() if key in "abcd" else key: value for key, value in model.items()}
    del printed["kind"]
    flown = {"maneuver": {"amplitude_deg": 5.0}}
    small, capital = (dataset_recipe(flown | {"aircraft": one})[0] for one in (model, printed))
    assert isinstance(capital.aircraft, MatrixAircraft)
    assert capital == small
    both = client.post("/api/v1/datasets", json={"aircraft": printed | {"a": model["a"]}})
    assert "has the matrix A twice" in problem(both, 422)


@pytest.mark.parametrize("name", ["limits", "specification"])
def test_limits_are_read_by_both_names_and_sent_as_limits(client, name):
    job = finished(client, client.post("/api/v1/datasets", json=RECIPE | {name: {"Ny": 0.4}}))
    info = client.get(f"/api/v1/datasets/{job['result']['dataset']}").json()
    assert info["limits"]["Ny"] == info["recipe"]["limits"]["Ny"] == 0.4
    assert job["request"]["limits"]["Ny"] == 0.4
    assert "specification" not in json.dumps([info, job])
    assert store_of(client).datasets.info(info["id"]).recipe["specification"]["Ny"] == 0.4


@pytest.mark.parametrize(
    ("recipe", "words"),
    [
        ({"n_unsaf": 3}, "dataset has no 'n_unsaf': did you mean n_unsafe?"),
        ({"aircraft": {"kind": "f17"}}, "f16_sl_h0_v502"),
        ({"aircraft": {"kind": "f16_sl_h0_v502", "states": 3}}, "did you mean n_states?"),
        ({"maneuver": {"amplitude_deg": "much"}}, "amplitude_deg is 'much'"),
        ({"maneuver": 5}, "must be an object"),
        ({"n_unsafe": 1}, "at least 2"),
        ({"dt": 0.07}, "whole number of steps"),
        ({"n_unsafe": 10**12}, "FOREWARN_MAX_ARRAY_BYTES"),
        ({"dt": 1e-9, "n_obs": 1}, "at most 20000 steps fit"),
        ({"control_law": {"kind": "f16_sl_ofb"}}, "feeds back phi"),
        ({"name": ""}, "1 to 200 characters"),
        ({"limits": {"Ny": None}}, "no limit was given"),
        ({"limits": {"Nz": 1}}, "dataset.limits has no 'Nz'"),
        ({"specification": {"Nz": 1}}, "dataset.limits has no 'Nz'"),
        ({"limits": {"Ny": 0.4}, "specification": {"Ny": 0.4}}, "two names of one parameter"),
        ({"limits": {"beta": 7}}, "beta is 7 rad, which is 401 deg"),
        ({"limits": {"Ny": 38}}, "values beyond 30 g"),
    ],
)
def test_an_invalid_recipe_is_refused_with_the_valid_values(client, recipe, words):
    assert words in problem(client.post("/api/v1/datasets", json=recipe), 422)


@pytest.mark.parametrize(
    ("body", "kind", "status"),
    [
        (b"{", "application/json", 422),
        (b"[]", "application/json", 422),
        (b'{"dt": NaN}', "application/json", 422),
        (b"{}", "text/plain", 415),
    ],
)
def test_a_body_must_be_an_object(client, body, kind, status):
    answer = client.post("/api/v1/datasets", content=body, headers={"content-type": kind})
    text = problem(answer, status)
    assert ("null, not NaN" in text) == (body in (b"{", b'{"dt": NaN}'))


def test_a_form_in_place_of_json_is_named_by_its_type(client):
    text = problem(client.post("/api/v1/flights", data={"a": "b"}), 415)
    assert "application/x-www-form-urlencoded" in text


def test_arrays_are_returned_as_stored(client, stored, dataset):
    answer = client.get(f"/api/v1/datasets/{stored}/arrays")
    with np.load(io.BytesIO(answer.content), allow_pickle=False) as arrays:
        for name in ("unsafe", "fail_index", "safe", "safe_times", "theta_unsafe", "theta_safe"):
            np.testing.assert_array_equal(arrays[name], getattr(dataset, name))
        assert arrays["dt"] == dataset.dt
        assert tuple(arrays["theta_names"]) == dataset.theta_names
        units = dict(zip(arrays["channels"], arrays["units"], strict=True))
        assert (units["beta"], units["r"], units["Ny"]) == ("rad", "rad/s", "g")


def test_rollouts_are_numbered_unsafe_first(client, stored, dataset):
    n_unsafe, n_safe = len(dataset.unsafe), len(dataset.safe)
    for n, rows in ((0, dataset.unsafe), (n_unsafe - 1, dataset.unsafe), (n_unsafe, dataset.safe)):
        rollout = client.get(f"/api/v1/datasets/{stored}/rollouts/{n}").json()
        index = n if n < n_unsafe else n - n_unsafe
        expected = rows[index]
        if n < n_unsafe:
            assert rollout["fail_index"] == dataset.fail_index[index]
            expected = expected[: rollout["fail_index"] + 1]
        else:
            assert rollout["fail_index"] is None
        y = np.column_stack([rollout["telemetry"][key] for key in KEYS])
        np.testing.assert_array_equal(y, expected)
        assert rollout["telemetry"]["t"][1] == pytest.approx(dataset.dt)
        assert tuple(rollout["theta"]) == dataset.theta_names
    for n in (-1, n_unsafe + n_safe):
        assert problem(client.get(f"/api/v1/datasets/{stored}/rollouts/{n}"), 404)


def test_rollouts_are_listed_by_outcome(client, stored, dataset):
    path = f"/api/v1/datasets/{stored}/rollouts"
    listed = client.get(path, params={"outcome": "safe", "first": 1, "count": 2}).json()
    assert [rollout["n"] for rollout in listed] == [len(dataset.unsafe) + i for i in (1, 2)]
    assert client.get(path, params={"first": 10**6}).json() == []
    assert problem(client.get(path, params={"count": 0}), 422)


def test_a_dataset_in_use_is_kept_and_names_its_monitors(client, dataset):
    store = store_of(client)
    used = store.datasets.add(dataset, "used").id
    monitor = store.monitors.add(train(dataset), "its monitor", used)
    words = problem(client.delete(f"/api/v1/datasets/{used}"), 409)
    assert "its monitor" in words
    assert monitor.id in words
    assert client.delete(f"/api/v1/monitors/{monitor.id}").status_code == 204
    assert client.delete(f"/api/v1/datasets/{used}").status_code == 204
    assert problem(client.get(f"/api/v1/datasets/{used}"), 404)


@pytest.mark.parametrize("path", ["", "/arrays", "/rollouts", "/rollouts/0"])
def test_an_unknown_dataset_is_not_found(client, path):
    assert "nothing" in problem(client.get(f"/api/v1/datasets/nothing{path}"), 404)


@pytest.mark.parametrize("order", [{"n_unsafe": "50"}, {"dt": "0.05"}, {"n_unsafe": True}])
def test_a_number_in_quotes_is_refused(client, order):
    assert "give a number" in problem(client.post("/api/v1/datasets", json=order), 422)


def test_stability_margins_label_rollouts_of_a_dataset_and_its_monitor(tmp_path):
    aircraft = {"kind": "attas_id_16kft"}
    test = {"aircraft": aircraft, "margins": {"phase_deg": 73.0}, "n_unsafe": 30}
    with api(tmp_path) as client:
        job = finished(client, client.post("/api/v1/datasets", json=test))
        dataset = client.get(f"/api/v1/datasets/{job['result']['dataset']}").json()
        assert dataset["limits"] == "requirement phase margin > 73 deg"
        order = {"dataset": dataset["id"], "epsilon": 0.2, "n_test": 60, "guarantee": "average"}
        method = {"predictor": {"kind": "linear"}, "score": {"kind": "nearest_neighbor"}}
        job = finished(client, client.post("/api/v1/monitors", json=order | method))
        monitor = client.get(f"/api/v1/monitors/{job['result']['monitor']}").json()
        assert monitor["limits"] == dataset["limits"]
        evaluation = client.get(f"/api/v1/monitors/{monitor['id']}/evaluation").json()
        assert "prevention" not in evaluation, "a stopped flight keeps its aircraft"
        assert "opposite_input" in evaluation["robustness"]
        many = test | {"margins": {"phase_deg": 400.0}}
        assert "below 180" in problem(client.post("/api/v1/datasets", json=many), 422)
        for resource in ("studies", "sweeps"):
            refused = client.post(f"/api/v1/{resource}", json={"dataset": dataset["id"]})
            assert "give limits instead" in problem(refused, 422)
        asked = client.post("/api/v1/datasets/amplitude", json=test)
        assert "choose it yourself" in problem(asked, 422)


def test_a_campaign_by_margins_is_refused(client):
    conditions = [{"name": "Mach 0.6", "dataset": {"margins": {"phase_deg": 100.0}}}]
    plan = {"name": "margins", "conditions": conditions}
    assert "a campaign needs limits" in problem(client.post("/api/v1/campaigns", json=plan), 422)
