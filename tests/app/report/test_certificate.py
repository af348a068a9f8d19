"""The certificate: as a page, over REST and by the command line."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from app.cli import main
from app.report.certificate import certificate_page
from core import __version__
from core.monitor import Monitor, MonitorRecipe, train
from tests.support import oscillator
from tests.support.api import api, problem
from tests.support.stored import EVALUATION

DOUBLED = EVALUATION["robustness"]["doubled_noise"]


@pytest.fixture(scope="module")
def monitor() -> Monitor:
    recipe = MonitorRecipe(guarantee="95%", epsilon=0.1)
    trained = train(oscillator.collect(np.random.default_rng(1), n_unsafe=40), recipe)
    return replace(trained, evaluation=EVALUATION)


def test_it_states_the_guarantee_and_the_test_on_fresh_flights(monitor: Monitor) -> None:
    page = certificate_page(monitor, "Night <shift>", "ab12", "2026-11-22T10:00:00Z")
    assert "Night &lt;shift&gt;" in page
    assert "with 95 % confidence in this monitor" in page
    assert "9.0% (9 of 100 failing flights; 95 % interval 4.2% to 16.4%)" in page
    assert "90.0%" in page  # prevented within 0.25 s
    assert "Safe flights stopped unnecessarily: 20 of 200" in page
    above = f"{monitor.alert_above():.4g}"
    assert f"above {above}, the threshold for ε = 0.1 with 95 % confidence" in page
    assert "sensor noise twice as large" in page
    assert "limit exceeded first: p limit first" in page
    assert "20.0%" in page  # missed of that group
    assert "ab12" in page
    assert "&#34;t_early&#34;: 0.25" in page
    assert "&#34;dataset&#34;: " in page
    assert f"certificate written by {__version__} at 20" in page
    assert "http" not in page.replace("http-equiv", "")


def test_an_invalid_safe_flight_is_neither_quiet_nor_a_false_alarm(monitor: Monitor) -> None:
    page = certificate_page(monitor, "it", "ab12")
    assert "4 of 200 safe flights: no false alarm" in page
    assert "88.0% (176 of 200 safe flights" in page
    assert "10.0% (20 of 200 safe flights" in page
    differing = next(line for line in page.splitlines() if "sensor noise twice" in line)
    cells = re.findall(r'<td class="number">([^<]*)</td>', differing)
    assert cells[4:] == ["210", "14.3%", "81.0%", "4.8%"]
    older = {key: n for key, n in DOUBLED.items() if key != "safe_withdrawn"}
    evaluation = EVALUATION | {"robustness": {"doubled_noise": older}}
    page = certificate_page(replace(monitor, evaluation=evaluation), "it", "ab12")
    differing = next(line for line in page.splitlines() if "sensor noise twice" in line)
    assert re.findall(r'<td class="number">([^<]*)</td>', differing)[5:] == [
        "14.3%",
        "not counted",
        "not counted",
    ]


def test_near_aircraft_are_counted_one_by_one(monitor: Monitor) -> None:
    page = certificate_page(monitor, "it", "ab12")
    row = next(line for line in page.splitlines() if "factor of 1.25" in line)
    assert "30 aircraft; the worst missed 3 of 5" in row
    cells = re.findall(r'<td class="number">([^<]*)</td>', row)
    assert cells[:3] == ["80", "12.5%", "6.0% to 22.0%"]
    assert "no method keeps ε for each single aircraft" in page


def test_another_type_has_a_row_or_the_reason_why_not(monitor: Monitor) -> None:
    reason = "Another type of aircraft: not flown"
    assert reason in certificate_page(monitor, "it", "ab12")
    row = EVALUATION["robustness"]["near"] | {"words": "another type of aircraft"}
    flown = EVALUATION | {"robustness": {"other_type": row}}
    page = certificate_page(replace(monitor, evaluation=flown), "it", "ab12")
    assert "another type of aircraft (30 aircraft" in page
    assert reason not in page
    of_own_flights = {key: value for key, value in EVALUATION.items() if key != "robustness"}
    of_own_flights["flights"] = {"certify": 300}
    page = certificate_page(replace(monitor, evaluation=of_own_flights), "it", "ab12")
    assert "no others can be simulated" in page
    assert reason not in page


def test_an_untested_monitor_has_no_certificate(monitor: Monitor) -> None:
    with pytest.raises(ValueError, match="nothing to certify: train it with test flights"):
        certificate_page(replace(monitor, evaluation=None), "it", "")


def test_an_evaluation_of_an_older_version_has_a_certificate(monitor: Monitor) -> None:
    new = ("prevention", "robustness", "leads", "groups")
    older = {key: value for key, value in EVALUATION.items() if key not in new}
    uncounted = {"misses": 9, "false_alerts": 20}
    page = certificate_page(
        replace(monitor, evaluation=older | {"at_epsilon": uncounted}), "it", "ab12"
    )
    assert "not counted by the version that tested it" in page
    assert "Prevented failures" not in page
    assert "Flights that differ" not in page
    assert "Missed in each group" not in page


def test_it_is_written_and_served(monitor: Monitor, tmp_path, capsys) -> None:
    file, out = tmp_path / "it.fwm", tmp_path / "it.html"
    monitor.save(file)
    assert main(["certificate", str(file), "-o", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["evaluation"]["prevention"] == EVALUATION["prevention"]
    assert printed["digest"] in out.read_text()
    with api(tmp_path / "data") as client:
        stored = client.post("/api/v1/monitors", content=file.read_bytes()).json()
        answer = client.get(f"/api/v1/monitors/{stored['id']}/certificate")
        assert answer.headers["content-type"].startswith("text/html")
        assert "style-src 'unsafe-inline'" in answer.headers["content-security-policy"]
        assert printed["digest"] in answer.text
        untested = replace(monitor, evaluation=None).to_bytes()
        bare = client.post("/api/v1/monitors", content=untested).json()["id"]
        missing = client.get(f"/api/v1/monitors/{bare}/certificate")
        assert "nothing to certify" in problem(missing, 404)
