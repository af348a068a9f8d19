"""The Grafana dashboard of the server's metrics, and what Prometheus makes of them."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path
from typing import Any

import httpx2
import pytest

from app.main import STATIC
from app.settings import Settings
from app.store.store import open_store
from tests.support.api import api
from tests.support.live_server import live_server
from tests.support.patience import PATIENCE, until
from tests.support.postgresql import free_port

DASHBOARD = json.loads((STATIC / "grafana" / "forewarn.json").read_text(encoding="utf-8"))
GUIDE = (STATIC / "guide" / "grafana.md").read_text(encoding="utf-8")
PANELS = DASHBOARD["panels"]
QUERIES = [target["expr"] for panel in PANELS for target in panel["targets"]]
VARIABLES = {each["name"]: each for each in DASHBOARD["templating"]["list"]}
NAME = re.compile(r"\b(?:forewarn|process)_\w+")


def query_of(title: str) -> str:
    (panel,) = [panel for panel in PANELS if panel["title"] == title]
    (target,) = panel["targets"]
    return target["expr"]


def exposed(text: str) -> set[str]:
    return set(re.findall(r"^(\w+)(?:{.*})? ", text, re.MULTILINE))


def test_every_metric_of_the_dashboard_and_the_guide_is_exposed(tmp_path: Path):
    with api(tmp_path) as client:
        client.get("/healthz")
        names = exposed(client.get("/metrics").text)
        assert client.get("/grafana/forewarn.json").json() == DASHBOARD
    used = {name for query in QUERIES for name in NAME.findall(query)}
    assert len(used) > 15
    assert used <= names
    assert VARIABLES["job"]["definition"] == VARIABLES["job"]["query"]["query"]
    assert {*NAME.findall(VARIABLES["job"]["definition"])} <= names
    histograms = {name.removesuffix("_bucket") for name in names}
    told = set(re.findall(r"`(forewarn_\w+)`", GUIDE))
    assert told <= names | histograms
    assert {name for name in used if name.startswith("forewarn")} <= told | {
        f"{name}_bucket" for name in told
    }


def test_the_dashboard_has_the_form_that_grafana_provisions():
    assert DASHBOARD["id"] is None
    assert DASHBOARD["uid"] == "forewarn"
    assert DASHBOARD["schemaVersion"] >= 36  # from then on data sources are named by type and uid
    assert VARIABLES["datasource"]["type"] == "datasource"
    assert VARIABLES["datasource"]["query"] == "prometheus"
    source = {"type": "prometheus", "uid": "${datasource}"}
    assert len({panel["id"] for panel in PANELS}) == len(PANELS)
    for panel in PANELS:
        assert panel["type"] in ("stat", "timeseries")
        assert panel["title"]
        assert panel["description"]
        assert panel["datasource"] == source
        assert panel["fieldConfig"]["defaults"]["noValue"] == "NO DATA"
        steps = panel["fieldConfig"]["defaults"]["thresholds"]["steps"]
        assert [step["value"] for step in steps[:1]] == [None]
        names = [target["refId"] for target in panel["targets"]]
        assert len(set(names)) == len(names) > 0
        assert all(target["datasource"] == source for target in panel["targets"])
    for query in QUERIES:
        assert set(re.findall(r"\$(\w+)", query)) == {"job"}


def test_no_panel_lies_on_another_or_beyond_the_24_columns():
    places = [panel["gridPos"] for panel in PANELS]
    for place in places:
        assert 0 <= place["x"] <= 24 - place["w"]
    for one, other in combinations(places, 2):
        apart_x = one["x"] + one["w"] <= other["x"] or other["x"] + other["w"] <= one["x"]
        apart_y = one["y"] + one["h"] <= other["y"] or other["y"] + other["h"] <= one["y"]
        assert apart_x or apart_y


def test_a_flight_is_counted_in_the_metrics(tmp_path: Path):
    with live_server(tmp_path) as server:
        body = {"source": {"kind": "live", "trim": "none"}, "monitor": server.monitor_id}
        flights = f"{server.url}/api/v1/flights"
        flight = httpx2.post(flights, json=body).json()["id"]

        def metric(name: str) -> float:
            text = httpx2.get(f"{server.url}/metrics").text
            (value,) = re.findall(rf"^forewarn_{name} (\S+)$", text, re.MULTILINE)
            return float(value)

        assert str(metric("sample_age_seconds")) == "nan"
        assert metric("stale_flights") == 1.0  # its source is silent
        values = {"p": 0.0, "r": 0.0, "beta": 0.0, "delta_a": 0.0, "delta_r": 0.0}
        for k, n_y in enumerate((0.0, 2.0)):
            sample = {"t": 0.05 * k, "Ny": n_y, **values}
            httpx2.post(f"{flights}/{flight}/samples", json=sample).raise_for_status()
        until(lambda: metric("samples") == 2.0)
        assert metric("flights") == 1.0
        assert metric("open_warnings") >= 1.0
        assert metric("sample_age_seconds") >= 0.0
        until(lambda: metric("stale_flights") == 1.0)
        assert metric("open_cautions") >= 1.0
        assert 0.0 < metric("disk_free_bytes") <= metric("disk_bytes")
        httpx2.post(f"{flights}/{flight}/end").raise_for_status()
        assert (metric("flights"), metric("samples")) == (0.0, 2.0)


def _is_ready(address: str) -> bool:
    try:
        return httpx2.get(f"{address}/-/ready").status_code == 200
    except httpx2.HTTPError:
        return False


@contextmanager
def prometheus(folder: Path, configuration: str) -> Iterator[str]:
    """A Prometheus with this configuration; its address."""
    for program in ("prometheus", "promtool"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed: it is in the Debian package prometheus")
    file, port = folder / "prometheus.yml", free_port()
    file.write_text(configuration)
    subprocess.run(["promtool", "check", "config", str(file)], check=True, capture_output=True)
    call = ["prometheus", f"--config.file={file}", f"--storage.tsdb.path={folder / 'data'}"]
    with subprocess.Popen(
        [*call, f"--web.listen-address=127.0.0.1:{port}"], stderr=subprocess.DEVNULL
    ) as process:
        try:
            address = f"http://127.0.0.1:{port}"
            until(lambda: _is_ready(address))
            yield address
        finally:
            process.terminate()
            process.wait(PATIENCE)


@pytest.mark.services
def test_prometheus_reads_with_a_viewers_token_and_counts_a_flight_of_two_addresses_once(
    tmp_path: Path,
):
    store = open_store(Settings(data_dir=tmp_path).url)
    _, token = store.tokens.add("Prometheus", "viewer", None)
    _, operator = store.tokens.add("Ann", "operator", None)
    store.close()
    (tmp_path / "forewarn.token").write_text(token)
    (scrape, _) = re.findall(r"```yaml\n(.*?)```", GUIDE, re.DOTALL)
    with live_server(tmp_path) as server:
        port = server.url.rpartition(":")[2]
        both = [f"127.0.0.1:{port}", f"localhost:{port}"]  # as a server and one that relays to it
        scrape = scrape.replace('["127.0.0.1:8000"]', json.dumps(both))
        scrape = scrape.replace("/etc/prometheus", str(tmp_path)).replace("5s", "1s")
        body = {"source": {"kind": "live"}, "monitor": server.monitor_id}
        login = {"Authorization": f"Bearer {operator}"}
        httpx2.post(f"{server.url}/api/v1/flights", json=body, headers=login).raise_for_status()
        with prometheus(tmp_path, scrape) as address:

            def answer(query: str) -> list[Any]:
                about = {"query": query.replace("$job", "forewarn")}
                found = httpx2.get(f"{address}/api/v1/query", params=about).json()
                assert found["status"] == "success", found
                return found["data"]["result"]

            def value(query: str) -> str:
                return "".join(series["value"][1] for series in answer(query))

            until(lambda: value('count(forewarn_flights{job="forewarn"})') == "2")
            assert value(query_of("Addresses that answer")) == "2"
            assert value(query_of("Flights in progress")) == "1"
            for query in QUERIES:
                if 'status=~"5.."' in query:  # no request fails here
                    assert answer(query) == []
                else:
                    assert until(lambda query=query: answer(query)), query


@pytest.mark.services
def test_the_first_failed_request_of_a_route_is_counted(tmp_path: Path):
    """The rate of a counter that begins with 1 is 0."""
    if shutil.which("promtool") is None:
        pytest.skip("promtool is not installed: it is in the Debian package prometheus")
    series = 'forewarn_requests_total{job="forewarn",instance="a",route="/x",status="503"}'
    labels = '{route="/x",status="503"}'
    file = tmp_path / "test.yml"
    expected = ((100, []), (400, [1]), (590, [2]), (610, [1]), (950, [0]))
    query = query_of("Errors").replace("$job", "forewarn")
    checks = [
        {
            "expr": f"round({query})",
            "eval_time": f"{t}s",
            "exp_samples": [{"labels": labels, "value": value} for value in values],
        }
        for t, values in expected
    ]
    given = [{"series": series, "values": "_x60 1x42 2x90"}]
    test = {"interval": "5s", "input_series": given, "promql_expr_test": checks}
    file.write_text(json.dumps({"tests": [test]}))  # JSON is YAML
    call = ["promtool", "test", "rules", str(file)]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
