import re
from copy import deepcopy
from dataclasses import replace
from typing import Any

import jsbsim  # noqa: F401  # its logger must not end with schemathesis' thread, after Python
import jsonschema_rs
import pytest
import schemathesis
from hypothesis import HealthCheck, settings
from schemathesis import checks
from schemathesis.python.asgi import get_client, shutdown_lifespans

from app.catalog import catalog
from app.main import create_app
from app.settings import Settings
from app.store.store import open_store
from core.monitor import MonitorRecipe, train
from tests.support.api import api, document
from tests.support.patience import PATIENCE
from tests.support.recorded import RECORDINGS, csv_of, uploaded
from tests.support.stored import EVALUATION

CHECKS = [
    checks.not_a_server_error,
    checks.status_code_conformance,
    checks.content_type_conformance,
    checks.response_headers_conformance,
    checks.response_schema_conformance,
    checks.unsupported_method,
]


def described() -> Any:
    return schemathesis.openapi.from_dict(deepcopy(document()))


few = described()
few.config.phases.coverage.enabled = False


@pytest.fixture(scope="module")
def known(tmp_path_factory, dataset, flights):
    """A store with one of each; its settings and what a path parameter may be."""
    data_dir = tmp_path_factory.mktemp("data")
    kept = Settings(data_dir=data_dir, allowed_hosts=("testserver",), max_jobs=0, max_flights=2)
    store = open_store(kept.url)
    dataset_id = store.datasets.add(dataset, "oscillator").id
    monitor = train(replace(dataset, recipe={}), MonitorRecipe(epsilon=0.2))
    evaluated = replace(monitor, evaluation=EVALUATION)
    monitor_id = store.monitors.add(evaluated, "oscillator", dataset_id).id
    job_id = store.jobs.add("study", {})
    store.jobs.update(job_id, status="done", result={"figures": {"a.svg": "<svg/>"}})
    flight_id = store.flights.add({"kind": "simulated"}, monitor_id, 0.2)
    store.flights.end(flight_id)
    store.close()
    with api(data_dir) as client:
        path = f"{RECORDINGS}/{uploaded(client, csv_of(flights[0]))['id']}"
        scoring = client.post(f"{path}/scorings", json={"monitor": monitor_id}).json()
        assert "recording" in scoring, scoring
        marker = client.post(f"{path}/markers", json={"t": 1.0, "text": "gust"}).json()
    ids = {
        "dataset_id": dataset_id,
        "monitor_id": monitor_id,
        "job_id": job_id,
        "flight_id": flight_id,
        "recording_id": scoring["recording"],
        "scoring_id": scoring["id"],
        "marker_id": marker["id"],
        "index": 0,
        "name": "a.svg",
    }
    return kept, ids


@pytest.fixture(scope="module")
def session(known):
    app: Any = create_app(known[0])
    with get_client(app) as session:
        yield session
    shutdown_lifespans()


CALLS = settings(
    deadline=None,
    derandomize=True,
    suppress_health_check=[
        HealthCheck.too_slow,
        HealthCheck.filter_too_much,
        HealthCheck.function_scoped_fixture,
        HealthCheck.large_base_example,
    ],
)


def answered(case, session, ids):
    """Call with what was drawn, then with what is there; each answer is as described."""
    case.call_and_validate(app=session.app, session=session, checks=CHECKS, timeout=PATIENCE)
    there = {key: ids[key] for key in case.path_parameters if key in ids}
    if there and case.method != "DELETE":
        case.path_parameters = case.path_parameters | there
        case.call_and_validate(app=session.app, session=session, checks=CHECKS, timeout=PATIENCE)


@few.parametrize()
@settings(CALLS, max_examples=3)
def test_every_answer_is_one_that_the_document_names(case, session, known):
    answered(case, session, known[1])


def test_every_operation_and_parameter_says_what_it_is():
    assert "SI units" in document()["info"]["description"]
    for path, item in document()["paths"].items():
        for method, operation in item.items():
            assert operation["description"], (method, path)
            assert operation["tags"], (method, path)
            for answer in operation["responses"].values():
                assert answer["description"], (method, path)


def test_every_request_body_has_an_example_that_fits_its_schema():
    whole = document()
    bodies = [
        (f"{method} {path} {media}", content)
        for path, item in whole["paths"].items()
        for method, operation in item.items()
        for media, content in operation.get("requestBody", {}).get("content", {}).items()
    ]
    assert len(bodies) > 30
    for where, content in bodies:
        schema = content["schema"] | {"components": whole["components"]}
        assert "example" in content, where
        assert jsonschema_rs.is_valid(schema, content["example"]), where


def test_tags_operations_server_and_licence_are_described():
    whole = document()
    operations = [each for item in whole["paths"].values() for each in item.values()]
    names = [operation["operationId"] for operation in operations]
    assert len(set(names)) == len(names)
    described = {tag["name"] for tag in whole["tags"] if tag["description"]}
    assert {tag for operation in operations for tag in operation["tags"]} == described
    assert [server["url"] for server in whole["servers"]] == ["/"]
    assert whole["info"]["contact"]["name"]
    assert whole["info"]["license"]["identifier"] == "MIT"


def test_errors_are_described_as_problems():
    assert "HTTPValidationError" not in document()["components"]["schemas"]
    for path, item in document()["paths"].items():
        for method, operation in item.items():
            for status, answer in operation["responses"].items():
                if int(status) >= 400:
                    assert list(answer["content"]) == ["application/problem+json"], (method, path)


def test_requests_have_examples_that_fit_their_schema():
    for path in ("/api/v1/datasets", "/api/v1/monitors", "/api/v1/studies", "/api/v1/sweeps"):
        body = document()["paths"][path]["post"]["requestBody"]["content"]["application/json"]
        schema = body["schema"] | {"components": document()["components"]}
        jsonschema_rs.validate(schema, body["example"])


def test_units_are_in_the_document():
    body = document()["paths"]["/api/v1/monitors"]["post"]["requestBody"]["content"]
    name = body["application/json"]["schema"]["$ref"].rpartition("/")[2]
    assert document()["components"]["schemas"][name]["properties"]["t_early"]["x-unit"] == "s"
    assert catalog()["recipes"]["dataset"]["schema"]["properties"]["dt"]["x-unit"] == "s"


def test_every_method_that_is_not_allowed_is_answered_by_those_that_are(session):
    paths = document()["paths"]
    for path in paths:
        address = re.sub(r"\{[^}]+\}", "0", path)
        described = {
            method.upper()
            for template, item in paths.items()
            if re.fullmatch(re.sub(r"\{[^}]+\}", "[^/]+", template), address)
            for method in item
        }
        for method in {"GET", "POST", "PUT", "PATCH", "DELETE", "TRACE"} - described:
            answer = session.request(method, address)
            assert answer.status_code == 405, (method, path)
            assert set(answer.headers["allow"].split(", ")) - {"HEAD"} == described, (method, path)


NUMBERS = [
    ("POST", "/flights", {"source": {"kind": "simulated", "seed": 1}, "epsilon": 0.2}),
    ("POST", "/flights/{flight_id}/transport", {"action": "seek", "value": 2.5}),
    ("POST", "/recordings/{recording_id}/scorings", {"epsilon": 0.2, "trim": 2.0}),
    ("POST", "/recordings/{recording_id}/scorings", {"manoeuvres": [{"start": 0.1, "end": 1.5}]}),
    ("POST", "/recordings/{recording_id}/markers", {"t": 1.0, "end": 2.0, "text": "gust"}),
    ("POST", "/recordings/{recording_id}/preview", {"mapping": {}, "bins": 120}),
    ("POST", "/monitors/{monitor_id}/score", {"t": [0.0], "beta": [0.0]}),
    ("POST", "/datasets", {"n_unsafe": 50, "dt": 0.05}),
    ("POST", "/datasets/amplitude", {"share": 0.25}),
    ("POST", "/monitors", {"t_early": 0.25, "n_test": 0}),
]


def in_quotes(plain: Any) -> Any:
    """The same with each number once a string: [body, ...]."""
    if isinstance(plain, dict):
        return [plain | {k: new} for k, value in plain.items() for new in in_quotes(value)]
    if isinstance(plain, list):
        return [[new] for value in plain for new in in_quotes(value)]
    return [str(plain)] if isinstance(plain, (int, float)) else []


def test_a_refusal_names_the_field_and_what_it_needs(session, known):
    path = f"/api/v1/flights/{known[1]['flight_id']}/transport"
    told = session.post(path, json={"action": "seek", "value": "x", "to": 1}).json()
    assert told["errors"] == [
        {"where": "body.value", "reason": "is 'x': give true or false, or a number"},
        {"where": "body.to", "reason": "is unknown: leave it out, or correct its name"},
    ]
    assert told["detail"].startswith("value is 'x': give true or false, or a number; to is unknown")
    path = "/api/v1/datasets/none/rollouts"
    told = session.get(path, params={"first": "soon"}).json()
    assert told["detail"] == "first is 'soon': give a whole number"


@pytest.mark.parametrize(("method", "path", "body"), NUMBERS)
def test_a_number_in_quotes_is_refused_everywhere(method, path, body, session, known):
    address = "/api/v1" + path.format(**known[1])
    wants_monitor = path == "/flights" or "scorings" in path
    more = {"monitor": known[1]["monitor_id"]} if wants_monitor else {}
    for changed in in_quotes(body):
        told = session.request(method, address, json=changed | more)
        assert told.status_code == 422, (changed, told.text)
        assert "Input should" not in told.text
        assert "about:blank" not in told.json()["type"]
