import threading

import pytest

from app.store.store import open_store
from core.evaluation.baselines import BASELINES
from core.evaluation.study import METHODS
from tests.support.api import api, events, finished, problem
from tests.support.patience import PATIENCE

STUDY = {"dataset": {"n_unsafe": 12, "n_obs": 20}, "n_monitors": 2, "n_test": 40}


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with api(tmp_path_factory.mktemp("data"), max_queued_jobs=1) as client:
        yield client


@pytest.fixture
def held(client):
    """A job that runs until the test ends."""
    begun, go_on = threading.Event(), threading.Event()

    def work(task):
        begun.set()
        go_on.wait(PATIENCE)
        task.progress("going on", 1, 1)
        return {}

    job_id = client.app.state.jobs.submit("test", {}, work)
    assert begun.wait(PATIENCE)
    yield job_id
    go_on.set()
    events(client, f"/api/v1/jobs/{job_id}")


def test_the_study_compares_the_five_methods_and_the_rules_of_others(client):
    job = finished(client, client.post("/api/v1/studies", json=STUDY))
    assert job["status"] == "done", job
    result = client.get(f"/api/v1/jobs/{job['id']}").json()["result"]
    assert set(result["methods"]) == set(result["ranking"]) == {*METHODS, *BASELINES}
    assert result["others"].keys() == BASELINES.keys()
    for curves in result["methods"].values():
        assert len(curves["epsilon"]) == len(curves["power"]) == len(curves["miss_interval"])
    assert sorted(result["figures"]) == [
        "miss_and_power.svg",
        "safe_flight.svg",
        "unsafe_flight.svg",
    ]
    for name, link in result["figures"].items():
        answer = client.get(link)
        assert answer.headers["content-type"] == "image/svg+xml", name
        assert b"<svg" in answer.content
    listed = next(j for j in client.get("/api/v1/jobs").json() if j["id"] == job["id"])
    assert listed["result"] is None
    assert "choose" in problem(client.get(f"/api/v1/jobs/{job['id']}/figures/none.svg"), 404)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"n_monitors": 0}, "n_monitors"),
        ({"n_test": 1e9}, "n_test"),
        ({"methods": 5}, "study has no 'methods'"),
        ({"dataset": None}, "give the id of a stored dataset"),
        ({"monitor": {"lead": 1}}, "choose t_early"),
    ],
)
def test_an_invalid_study_is_refused(client, change, words):
    assert words in problem(client.post("/api/v1/studies", json=STUDY | change), 422)


def test_events_end_with_the_job_and_do_not_restart(client):
    job = finished(client, client.post("/api/v1/datasets", json={"n_unsafe": 3}))
    location = f"/api/v1/jobs/{job['id']}"
    with client.stream("GET", f"{location}/events") as stream:
        lines = [line for line in stream.iter_lines() if line]
    assert lines[-1] == "id: end"
    assert len(lines) == 2
    again = client.get(f"{location}/events", headers={"Last-Event-ID": "end"})
    assert again.status_code == 204


def test_a_job_is_cancelled_once(client, held):
    answer = client.post(f"/api/v1/jobs/{held}/cancel")
    assert answer.status_code == 202
    assert answer.json()["status"] == "running"
    assert answer.json()["message"].startswith("cancelling")


def test_an_ended_job_is_not_cancelled(client):
    job = finished(client, client.post("/api/v1/datasets", json={"n_unsafe": 3}))
    assert "already done" in problem(client.post(f"/api/v1/jobs/{job['id']}/cancel"), 409)


def test_a_request_is_refused_if_the_queue_is_full(client, held):
    first = client.post("/api/v1/datasets", json={"n_unsafe": 3})
    assert first.status_code == 202
    assert "wait" in problem(client.post("/api/v1/datasets", json={"n_unsafe": 3}), 429)
    assert client.post(f"{first.headers['location']}/cancel").json()["status"] == "cancelled"


@pytest.mark.parametrize("path", ["", "/events", "/figures/safe_flight.svg"])
def test_an_unknown_job_is_not_found(client, path):
    assert "nothing" in problem(client.get(f"/api/v1/jobs/nothing{path}"), 404)
    assert "nothing" in problem(client.post("/api/v1/jobs/nothing/cancel"), 404)


def test_a_job_of_a_killed_server_is_interrupted_with_advice(tmp_path):
    dying = open_store(f"sqlite:///{tmp_path / 'forewarn.db'}")
    job_id = dying.jobs.add("monitor", {"asked": 1})
    dying.jobs.update(job_id, status="running", message="training")
    dying.close()
    with api(tmp_path) as client:
        job = client.get(f"/api/v1/jobs/{job_id}").json()
        assert job["status"] == "interrupted"
        assert "submit it again" in job["error"]
        assert events(client, f"/api/v1/jobs/{job_id}") == [job]
