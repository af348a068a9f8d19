import hashlib
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from app.jobs.training import fly_test
from app.recipes.recipes import as_ordered, from_plain
from core.channels import KEYS, significant
from core.evaluation.certificate import UNCALIBRATED, warnings_of
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.calibration import confident_rank, rank, threshold
from core.monitor.file.loading import from_bytes
from core.monitor.file.portable import pack, unpack
from core.planned_test.collection import DatasetRecipe
from tests.support.api import finished, problem, store_of
from tests.support.glb_file import glb

DATASET = {"n_unsafe": 12, "n_obs": 20, "seed": 4}
AVERAGE = {"guarantee": "average"}


@pytest.fixture(scope="module")
def monitor(dataset):
    return train(dataset, MonitorRecipe(epsilon=0.2))


@pytest.fixture(scope="module")
def stored(client, monitor):
    return store_of(client).monitors.add(monitor, "oscillator").id


def telemetry(y, dt):
    t = (np.arange(len(y)) * dt).tolist()
    return {"t": t} | dict(zip(KEYS, y.T.tolist(), strict=True))


def test_a_monitor_without_calibrated_validity_has_a_warning(client, monitor, stored):
    path, body = f"/api/v1/monitors/{stored}", telemetry(np.zeros((3, 6)), monitor.dt)
    for answer in (client.get(path), client.post(f"{path}/score", json=body)):
        assert UNCALIBRATED in answer.json()["warnings"]
    assert UNCALIBRATED not in warnings_of(monitor.evaluation, 0.2, is_calibrated=True)


def test_a_score_names_the_first_sample_beyond_a_limit(client, monitor, stored):
    y = np.zeros((40, 6))
    y[30:35] = 10.0
    path = f"/api/v1/monitors/{stored}/score"
    answer = client.post(path, json=telemetry(y, monitor.dt)).json()
    assert answer["exceeded_t"] == pytest.approx(30 * monitor.dt)
    assert client.post(path, json=telemetry(y[:20], monitor.dt)).json()["exceeded_t"] is None


def test_warnings_are_those_at_the_requested_epsilon(client, monitor):
    curves = {"epsilon": [0.2, 0.5], "misses": [4, 4], "false_alerts": [195, 0]}
    at_epsilon = {"misses": 4, "false_alerts": 195}
    counts = {"epsilon": 0.2, "n_unsafe": 100, "n_safe": 200}
    tested = replace(monitor, evaluation=counts | {"at_epsilon": at_epsilon, "curves": curves})
    path = f"/api/v1/monitors/{store_of(client).monitors.add(tested, 'tested').id}"
    useless, unchecked = client.get(path).json()["warnings"]
    assert useless.startswith("the monitor is of no use: ")
    assert client.get(path, params={"epsilon": 0.5}).json()["warnings"] == [unchecked]
    problem(client.get(path, params={"epsilon": "nan"}), 422)


def test_a_job_trains_and_tests_a_monitor(client):
    order = {"dataset": DATASET, "t_early": 0.2, "n_test": 60, "name": "trained"} | AVERAGE
    job = finished(client, client.post("/api/v1/monitors", json=order))
    assert job["status"] == "done", job
    made = job["result"]
    info = client.get(f"/api/v1/monitors/{made['monitor']}").json()
    assert (info["name"], info["dataset_id"]) == ("trained", made["dataset"])
    assert (info["h"], info["lead"]) == (4, pytest.approx(0.2))

    twin = from_bytes(client.get(f"/api/v1/monitors/{made['monitor']}/file").content)
    support = twin.support
    assert support is not None
    n_safe, n_unsafe = len(support.safe), len(support.unsafe)
    assert info["support"] == {"n_safe": n_safe, "n_unsafe": n_unsafe, "level": 0.02}
    assert info in client.get("/api/v1/monitors").json()
    found = client.get(f"/api/v1/monitors/{made['monitor']}/evaluation").json()
    test = fly_test(twin, from_plain(DatasetRecipe(), as_ordered(DATASET)), 60)
    assert found["n_unsafe"] + found["n_safe"] == 60
    assert found["curves"]["misses"] == test.curves.misses.tolist()
    assert found["curves"]["power"] == test.curves.power.tolist()
    assert found["at_epsilon"]["epsilon"] == twin.check_epsilon()
    heard = sum(found["leads"]["counts"]) + found["leads"]["n_without"]
    starts = np.array(found["leads"]["edges"][:-1])
    late = np.array(found["leads"]["counts"])[starts < 0.2 - 0.03].sum()
    assert late == found["n_unsafe"] - found["leads"]["n_without"] - found["leads"]["n_timely"]
    assert heard == found["n_unsafe"]


def test_a_monitor_is_trained_on_a_stored_dataset(client, dataset):
    stored = store_of(client).datasets.add(dataset, "oscillator").id
    order = {"dataset": stored, "epsilon": 0.2, "predictor": {"kind": "identity"}} | AVERAGE
    job = finished(client, client.post("/api/v1/monitors", json=order))
    assert job["status"] == "done", job
    assert "methods" not in job["result"]
    info = client.get(f"/api/v1/monitors/{job['result']['monitor']}").json()
    assert info["dataset_id"] == stored
    assert info["recipe"]["predictor"] == {"kind": "identity"}
    # the oscillator is no recipe that could be flown afresh
    assert info["support"] is None
    evaluation = client.get(f"/api/v1/monitors/{info['id']}/evaluation").json()
    assert sum(evaluation["flights"].values()) == len(dataset.unsafe) + len(dataset.safe)


def test_half_of_stored_failures_calibrates(client, dataset):
    stored = store_of(client).datasets.add(dataset, "oscillator").id
    order = {"dataset": stored, "epsilon": 0.1} | AVERAGE
    refused = problem(client.post("/api/v1/monitors", json=order), 422)
    assert "needs at least 9 unsafe rollouts; this monitor has 6" in refused
    job = finished(client, client.post("/api/v1/monitors", json=order | {"epsilon": 0.2}))
    assert job["status"] == "done", job
    (chosen,) = (tried["name"] for tried in job["result"]["methods"] if tried["chosen"])
    path = f"/api/v1/monitors/{job['result']['monitor']}"
    n_unsafe = client.get(f"{path}/calibration").json()["n_unsafe"]
    assert n_unsafe == (3 if chosen == "ensemble" else 6)


@pytest.mark.parametrize(
    ("order", "status", "words"),
    [
        ({}, 422, "give the id of a stored dataset"),
        ({"dataset": "nothing"}, 404, "nothing"),
        ({"dataset": DATASET, "lead": 1}, 422, "monitor has no 'lead': choose t_early"),
        ({"dataset": DATASET, "predictor": {"kind": "oracle"}}, 422, "linear"),
        (
            {"dataset": DATASET, "t_early": 9},
            422,
            "monitor.t_early=9.0 s was given: the manoeuvre lasts 6 s",
        ),
        ({"dataset": DATASET, "epsilon": 0.01} | AVERAGE, 422, "99 unsafe rollouts"),
        ({"dataset": DATASET, "epsilon": 0.01}, 422, "299 unsafe rollouts"),
        ({"dataset": DATASET, "n_test": -1}, 422, "n_test"),
        ({"dataset": DATASET, "n_test": 10**9}, 422, "n_test"),
        ({"dataset": DATASET, "score": {"kind": "negative_magnitude", "key": "q"}}, 422, "key"),
    ],
)
def test_an_invalid_request_is_refused_at_once(client, order, status, words):
    assert words in problem(client.post("/api/v1/monitors", json=order), status)


def test_a_lead_longer_than_a_stored_datasets_manoeuvre_is_refused_at_once(client, dataset):
    stored = store_of(client).datasets.add(dataset, "oscillator").id
    lasts = (dataset.safe.shape[1] - 1) * dataset.dt
    order = {"dataset": stored, "t_early": lasts, "epsilon": 0.2} | AVERAGE
    before = store_of(client).jobs.all()
    words = problem(client.post("/api/v1/monitors", json=order), 422)
    assert f"the manoeuvre lasts {lasts:g} s, choose a shorter warning lead time" in words
    assert store_of(client).jobs.all() == before


def test_scores_equal_those_of_the_stream(client, stored, monitor, flights):
    for y in flights[:3]:
        answer = client.post(f"/api/v1/monitors/{stored}/score", json=telemetry(y, monitor.dt))
        said = answer.json()["assessments"]
        stream = monitor.stream()
        for sample, (t, values) in enumerate(zip(np.arange(len(y)) * monitor.dt, y, strict=True)):
            expected = stream.update(t, values).as_dict()
            exemplars = {"nearest_unsafe", "nearest_safe"}
            assert said[sample] == {k: x for k, x in expected.items() if k not in exemplars}


def test_epsilon_decides_the_alerts(client, stored, monitor, flights):
    body = telemetry(flights[0], monitor.dt)
    for epsilon in (0.1, 0.5):
        path = f"/api/v1/monitors/{stored}/score?epsilon={epsilon}"
        scored = client.post(path, json=body).json()
        for said in scored["assessments"]:
            assert said["alert"] == (said["p_value"] > scored["epsilon"])
    path = f"/api/v1/monitors/{stored}/score?epsilon=0.01"
    assert "99 unsafe rollouts" in problem(client.post(path, json=body), 422)


def test_a_missing_value_is_never_assessed(client, stored, monitor, flights):
    body = telemetry(flights[0], monitor.dt)
    body["Ny"][7] = None
    said = client.post(f"/api/v1/monitors/{stored}/score", json=body).json()["assessments"]
    assert said[7]["state"] == "invalid"
    assert said[7]["p_value"] is said[7]["alert"] is said[7]["y_hat"] is None
    assert said[6]["state"] == "ok"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"Ny": None}, "missing channel: Ny"),
        ({"Ny": 0.0}, "Ny is not an array"),
        ({"Ny": [0.0]}, "Ny has 1 samples, t has 3"),
        ({"q": [0.0, 0.0, 0.0]}, "no channel 'q': choose t, beta"),
        ({"t": [0.0, None, 0.1]}, "the time of each sample"),
        ({"t": []}, "t has 0 samples"),
        ({"beta": ["0", "1", "2"]}, "beta is not an array"),
        ({"beta": [[0.0], 1.0, 2.0]}, "beta is not an array"),
    ],
)
def test_invalid_telemetry_is_refused(client, stored, change, words):
    body = telemetry(np.zeros((3, 6)), 0.05) | change
    assert words in problem(client.post(f"/api/v1/monitors/{stored}/score", json=body), 422)


def test_a_missing_channel_is_named(client, stored):
    body = telemetry(np.zeros((3, 6)), 0.05)
    del body["r"]
    assert "missing channel: r" in problem(
        client.post(f"/api/v1/monitors/{stored}/score", json=body), 422
    )


def test_a_promise_with_confidence_has_its_alert_level(client, monitor):
    sure = replace(monitor, recipe=replace(monitor.recipe, epsilon=0.3, guarantee="95%"))
    stored = store_of(client).monitors.add(sure, "sure").id
    above = confident_rank(0.3, monitor.n_unsafe) / (monitor.n_unsafe + 1)
    found = client.get(f"/api/v1/monitors/{stored}/calibration").json()
    assert (found["guarantee"], found["alert_above"]) == ("95%", above)
    assert found["smallest_epsilon"] == pytest.approx(1 - 0.05 ** (1 / monitor.n_unsafe))
    assert client.get(f"/api/v1/monitors/{stored}").json()["recipe"]["guarantee"] == "95%"
    y = monitor.unsafe_points[:1].repeat(20, axis=0)
    said = client.post(f"/api/v1/monitors/{stored}/score", json=telemetry(y, monitor.dt)).json()
    assert {sample["alert_above"] for sample in said["assessments"]} <= {above, None}
    assert any(sample["alert_above"] for sample in said["assessments"])
    problem(
        client.post(f"/api/v1/monitors/{stored}/score?epsilon=0.05", json=telemetry(y, 0.05)), 422
    )


def trained_by(client, part: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any], Monitor]:
    """Train a small monitor; its order, the job's result, and the monitor."""
    order = {"dataset": DATASET | {"n_unsafe": 20}, "n_test": 60} | AVERAGE | part
    job = finished(client, client.post("/api/v1/monitors", json=order))
    assert job["status"] == "done", job
    return order, job["result"], store_of(client).monitors.get(job["result"]["monitor"])


def test_a_test_card_needs_a_manoeuvre_of_steps(client):
    card = {"predictor": {"kind": "response_filter"}, "score": {"kind": "card_window"}}
    order, result, trained = trained_by(client, card)
    assert trained.forecast is not None
    again = order | {"dataset": result["dataset"]}
    assert finished(client, client.post("/api/v1/monitors", json=again))["status"] == "done"
    sweep = order | {"dataset": DATASET | {"maneuver": {"kind": "frequency_sweep"}}}
    told = problem(client.post("/api/v1/monitors", json=sweep), 422)
    assert "not a sequence of steps" in told
    assert told.endswith("choose the predictor peak_ridge")
    alone = order | {"score": {"kind": "nearest_neighbor"}}
    told = problem(client.post("/api/v1/monitors", json=alone), 422)
    assert "go with the score rest_of_card or card_window" in told


def test_a_monitor_with_groups_has_calibration_and_misses_of_each(client):
    grouping = {"kind": "largest_deflection"}
    _, result, trained = trained_by(client, {"groups": grouping, "epsilon": 0.3})
    where = f"/api/v1/monitors/{result['monitor']}"
    calibration = client.get(f"{where}/calibration").json()
    assert [len(group["alphas"]) for group in calibration["groups"]] == [trained.n_unsafe] * 3
    collected = store_of(client).datasets.info(result["dataset"])
    assert collected.recipe["groups"]["kind"] == "largest_deflection"
    assert calibration["n_unsafe"] == trained.n_unsafe == collected.recipe["n_unsafe"]
    assert len(calibration["alphas"]) == collected.n_unsafe > 3 * trained.n_unsafe
    assert calibration["alert_above"] == 0.3
    y = store_of(client).datasets.get(result["dataset"]).safe[0]
    told = client.post(f"{where}/score", json=telemetry(y, trained.dt)).json()["assessments"]
    names = [group["name"] for group in calibration["groups"]]
    assert told[2]["group"] is None
    assert told[-1]["group"] in names
    missed = client.get(f"{where}/evaluation").json()["groups"]
    assert [g["name"] for g in missed if g["rule"] == grouping["kind"]] == names
    page = client.get(f"{where}/certificate").text
    assert "in each group by: largest deflection before the failure" in page
    for group in calibration["groups"]:
        level = threshold(calibration["alert_above"], np.array(group["alphas"]))
        assert f"{significant(level)} for {group['name']}" in page


def test_a_forecast_of_the_peak_is_learned_from_the_dataset_alone(client):
    peaks = {"predictor": {"kind": "peak_ridge"}, "score": {"kind": "rest_of_card"}}
    _, result, trained = trained_by(client, peaks)
    flown = store_of(client).datasets.get(result["dataset"]).safe[0]
    where = f"/api/v1/monitors/{result['monitor']}/score"
    told = client.post(where, json=telemetry(flown, trained.dt)).json()["assessments"]
    assert [sample["p_value"] for sample in told if sample["state"] == "ok"]


def test_calibration_is_that_of_the_monitor(client, stored, monitor):
    found = client.get(f"/api/v1/monitors/{stored}/calibration").json()
    alphas = [np.inf if alpha is None else alpha for alpha in found["alphas"]]
    np.testing.assert_array_equal(alphas, monitor.alphas)
    assert found["smallest_epsilon"] == monitor.smallest_epsilon == pytest.approx(1 / 13)


@pytest.mark.parametrize("guarantee", ["average", "95%"])
def test_the_rule_of_each_epsilon_is_that_of_the_method(client, monitor, guarantee):
    recipe = replace(monitor.recipe, epsilon=0.3, guarantee=guarantee)
    stored = store_of(client).monitors.add(replace(monitor, recipe=recipe), "ruled").id
    rules = client.get(f"/api/v1/monitors/{stored}/calibration").json()["rules"]
    n = monitor.n_unsafe
    assert [rule["epsilon"] for rule in rules] == sorted(rule["epsilon"] for rule in rules)
    assert any(rule["epsilon"] == 0.3 for rule in rules)
    for rule in rules:
        epsilon = rule["epsilon"]
        j = confident_rank(epsilon, n) if guarantee == "95%" else n + 1 - rank(epsilon, n)
        assert rule["rank"] == n + 1 - j
        assert rule["alert_above"] == pytest.approx(
            epsilon if guarantee == "average" else j / (n + 1)
        )
        assert rule["scores"] == [monitor.alphas[n - j]]
        expected = stats.beta.ppf([0.05, 0.95], j, n + 1 - j)
        assert rule["miss_rates"] == pytest.approx(expected.tolist())


def test_a_portable_monitor_round_trips(client, stored, monitor):
    file = client.get(f"/api/v1/monitors/{stored}/file").content
    kind = {"content-type": "application/octet-stream"}
    answer = client.post("/api/v1/monitors", content=file, headers=kind, params={"name": "copy"})
    assert answer.status_code == 201
    copy = client.get(answer.headers["location"]).json()
    assert copy == answer.json()
    assert copy["name"] == "copy"
    assert copy["digest"] == hashlib.sha256(file).hexdigest()
    assert from_bytes(file).alphas.tolist() == monitor.alphas.tolist()
    evaluation = client.get(f"{answer.headers['location']}/evaluation")
    assert "not evaluated" in problem(evaluation, 404)


def test_a_portable_monitor_is_accepted_in_a_form_or_with_any_type(client, monitor):
    content = monitor.to_bytes()
    sent = [
        client.post("/api/v1/monitors", files={"file": ("my.fwm", content)}),
        client.post("/api/v1/monitors", content=content, headers={"content-type": "text/plain"}),
    ]
    assert [answer.status_code for answer in sent] == [201, 201]
    assert [answer.json()["name"] for answer in sent] == ["my", "uploaded monitor"]
    recipe = client.post("/api/v1/monitors", content=b' {"t_early": 1}')
    assert "send it as application/json" in problem(recipe, 415)


@pytest.mark.parametrize("cut", [0, 10, 1000, -1])
def test_a_truncated_monitor_file_is_refused(client, monitor, cut):
    kind = {"content-type": "application/octet-stream"}
    file = monitor.to_bytes()[:cut]
    before = client.get("/api/v1/monitors").json()
    assert problem(client.post("/api/v1/monitors", content=file, headers=kind), 422)
    assert client.get("/api/v1/monitors").json() == before


@pytest.mark.parametrize("path", ["", "/calibration", "/evaluation", "/file"])
def test_an_unknown_monitor_is_not_found(client, path):
    assert "nothing" in problem(client.get(f"/api/v1/monitors/nothing{path}"), 404)


def with_header(content: bytes, **changes: object) -> bytes:
    """The same monitor file with other values in its header, signed again."""
    sections = unpack(content, "m")
    monitor = sections["monitor"]
    changed = monitor._replace(header={**monitor.header, **changes})
    return pack({**sections, "monitor": changed}.values())


@pytest.mark.parametrize(
    "changes",
    [
        {"dt": math.nan},
        {"dt": 0},
        {"h": -3},
        {"dataset_recipe": {"n_unsafe": math.inf}},
        {"dataset_recipe": {"kind": "\ud800"}},
        {"version": "0" * 10_000_000},
    ],
    ids=lambda changes: str(changes)[:40],
)
def test_an_inconsistent_monitor_file_is_refused(client, monitor, changes):
    content = with_header(monitor.to_bytes(), **changes)
    assert len(problem(upload(client, content), 422)) < 500


@pytest.mark.parametrize("number", [2**63, 2**64, 10**400, -(10**400)])
def test_a_number_of_any_size_is_quoted_or_refused(client, monitor, number):
    content = with_header(monitor.to_bytes(), dataset_recipe={"seed": number})
    answer = upload(client, content)
    if answer.status_code != 201:
        problem(answer, 422)
    assert client.get("/api/v1/monitors").status_code == 200


def upload(client, content):
    """Send a portable monitor."""
    headers = {"content-type": "application/octet-stream"}
    return client.post("/api/v1/monitors", content=content, headers=headers)


def test_an_own_aircraft_is_stored_replaced_and_removed(client, stored):
    path = f"/api/v1/monitors/{stored}/airframe"
    assert client.get(path).json() is None
    small, large = (glb(((10, 1, size), (0, 0, 0))) for size in (4, 8))
    for content in (small, large):
        answer = client.post(path, content=content, headers={"Content-Type": "model/gltf-binary"})
        assert answer.status_code == 201, answer.text
        assert answer.json()["digest"] == hashlib.sha256(content).hexdigest()
    assert client.get(path).json() == answer.json()
    assert store_of(client).airframes.file(stored) == large
    sent = client.post(path, files={"file": ("own.glb", small)})
    assert sent.json()["size"] == len(small)
    refused = problem(client.post(path, content=b"solid"), 422)
    assert "no binary glTF" in refused
    assert client.get(path).json()["size"] == len(small)
    assert client.delete(path).status_code == 204
    assert client.get(path).json() is None
    problem(client.get("/api/v1/monitors/000000000000/airframe"), 404)
    problem(client.post("/api/v1/monitors/000000000000/airframe", content=small), 404)


def test_a_flight_is_drawn_with_its_monitors_own_aircraft(client, stored):
    path = f"/api/v1/monitors/{stored}/airframe"
    client.post(path, content=glb(((10, 1, 8), (0, 0, 0))))
    order = {"source": {"kind": "live", "trim": "none"}, "monitor": stored}
    flight = client.post("/api/v1/flights", json=order).json()["id"]
    drawn = client.app.state.scenes.get(flight)._picture._parts
    assert list(drawn) == ["own_0"]
    client.post(f"/api/v1/flights/{flight}/end")
    client.delete(path)
